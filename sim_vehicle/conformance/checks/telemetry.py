"""Telemetry on the ground: units, ranges, agreement between messages."""

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import flying, plans
from sim_vehicle.conformance.assertions import CheckFailed, Skip, equal, holds, near
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.vehicle import VehicleUnderTest

STILL_M_S = 1.0  # a vehicle at rest is slower
AGREE_M = 8.0  # at rest, GPS position and estimate are nearer to each other
FINITE_KINDS = ("ATTITUDE", "VFR_HUD", "LOCAL_POSITION_NED", "ATTITUDE_QUATERNION")  # checked for NaN


def _degrees_apart(a: float, b: float) -> float:
    return abs((a - b + 180) % 360 - 180)


def _both(vehicle: VehicleUnderTest, first: str, second: str) -> tuple[Any, Any]:
    found = vehicle.sample({first: 5.0, second: 5.0}, 1.5)
    return found[first][-1], found[second][-1]


@check("telemetry.time.goes_forward")
def time_goes_forward(vehicle: VehicleUnderTest) -> str:
    """time_boot_ms does not decrease within one kind of message."""
    kinds = {"ATTITUDE": 10.0, "GLOBAL_POSITION_INT": 5.0}
    with vehicle.streaming(kinds):
        mark = vehicle.wait(4.0)
    for kind, rate_hz in kinds.items():
        seen = len(vehicle.since(mark, kind))
        holds(seen >= rate_hz, f"expected {kind} at {rate_hz:g} Hz, saw {seen} in 4 s")
    newest = dict.fromkeys(kinds, 0)
    for entry in vehicle.received[mark:]:
        if entry.kind in newest:
            boot_ms, before_ms = entry.message.time_boot_ms, newest[entry.kind]
            holds(boot_ms >= before_ms, f"{entry.kind}: {boot_ms} ms after {before_ms} ms")
            newest[entry.kind] = boot_ms
    return f"{len(vehicle.received) - mark} messages"


@check("telemetry.time.is_milliseconds")
def time_is_milliseconds(vehicle: VehicleUnderTest) -> str:
    """time_boot_ms counts milliseconds of vehicle time."""
    with vehicle.streaming({"ATTITUDE": 10.0}):
        mark = vehicle.wait(5.0)
    entries = [e for e in vehicle.received[mark:] if e.kind == "ATTITUDE"]
    holds(len(entries) > 2, f"expected ATTITUDE at 10 Hz, saw {len(entries)} in 5 s")
    reported_s = (entries[-1].message.time_boot_ms - entries[0].message.time_boot_ms) / 1000
    near(reported_s, entries[-1].at_s - entries[0].at_s, 0.5, "seconds reported")
    return f"{reported_s:.2f} s"


@check("telemetry.numbers_are_finite")
def numbers_are_finite(vehicle: VehicleUnderTest) -> str:
    """No number of an attitude, VFR_HUD or local position message is NaN or infinite."""
    for kind, messages in vehicle.sample(dict.fromkeys(FINITE_KINDS, 4.0), 2.0).items():
        for message in messages:
            for name, value in message.to_dict().items():
                if isinstance(value, float) and name != "repr_offset_q" and not math.isfinite(value):
                    raise CheckFailed(f"{kind}.{name} is {value}")
    return ", ".join(FINITE_KINDS)


# -- position and altitude -------------------------------------------------------------------------------


@check("telemetry.position.agrees_with_gps", limit_s=200)
def agrees_with_gps(vehicle: VehicleUnderTest) -> str:
    """GLOBAL_POSITION_INT is less than 8 m from GPS_RAW_INT."""
    flying.wait_ready(vehicle)
    estimate, gps = _both(vehicle, "GLOBAL_POSITION_INT", "GPS_RAW_INT")
    away_m = plans.distance_m((estimate.lat, estimate.lon), (gps.lat, gps.lon))
    holds(away_m < AGREE_M, f"expected less than {AGREE_M:g} m apart, saw {away_m:.1f} m")
    return f"{away_m:.2f} m apart"


@check("telemetry.position.is_in_range")
def position_in_range(vehicle: VehicleUnderTest) -> str:
    """Latitude, longitude and heading are within their ranges."""
    message = flying.position(vehicle)
    holds(abs(message.lat) <= 900_000_000, f"expected lat within ±900000000, saw {message.lat}")
    holds(abs(message.lon) <= 1_800_000_000, f"expected lon within ±1800000000, saw {message.lon}")
    holds(message.hdg < 36_000 or message.hdg == 65_535, f"expected hdg below 36000, saw {message.hdg}")
    return f"{message.lat / 1e7:.6f}, {message.lon / 1e7:.6f}"


@check("telemetry.altitude.relative_is_from_home")
def relative_is_from_home(vehicle: VehicleUnderTest) -> str:
    """alt minus relative_alt is the altitude of home."""
    home, message = vehicle.request("HOME_POSITION"), flying.position(vehicle)
    near((message.alt - message.relative_alt) / 1000, home.altitude / 1000, 1.0, "altitude of home [m]")
    return f"{home.altitude / 1000:.2f} m"


@check("telemetry.altitude.hud_agrees")
def hud_agrees(vehicle: VehicleUnderTest) -> str:
    """VFR_HUD.alt [m] agrees with GLOBAL_POSITION_INT.alt [mm]."""
    position, hud = _both(vehicle, "GLOBAL_POSITION_INT", "VFR_HUD")
    near(hud.alt, position.alt / 1000, 2.0, "VFR_HUD.alt [m]")
    return f"{hud.alt:.2f} m"


@check("telemetry.altitude.gps_agrees")
def gps_agrees(vehicle: VehicleUnderTest) -> str:
    """GPS_RAW_INT.alt [mm, above sea level] is within 15 m of GLOBAL_POSITION_INT.alt."""
    position, gps = _both(vehicle, "GLOBAL_POSITION_INT", "GPS_RAW_INT")
    near(gps.alt / 1000, position.alt / 1000, 15.0, "GPS altitude [m]")
    return f"{gps.alt / 1000:.1f} m"


@check("telemetry.local.at_rest")
def local_at_rest(vehicle: VehicleUnderTest) -> str:
    """At rest LOCAL_POSITION_NED agrees with the distance from the local origin; the speed is below 1 m/s."""
    message = vehicle.sample({"LOCAL_POSITION_NED": 4.0}, 1.0)["LOCAL_POSITION_NED"][-1]
    origin = vehicle.request("GPS_GLOBAL_ORIGIN")
    away_m = plans.distance_m((origin.latitude, origin.longitude), plans.current_position(vehicle))
    near(math.hypot(message.x, message.y), away_m, 3.0, "distance from the origin [m]")
    speed_m_s = math.hypot(message.vx, message.vy, message.vz)
    holds(speed_m_s < STILL_M_S, f"LOCAL_POSITION_NED: {speed_m_s:.2f} m/s")
    return f"{message.x:.2f}, {message.y:.2f}, {message.z:.2f} m"


@check("telemetry.speed.is_zero_at_rest")
def speed_is_zero(vehicle: VehicleUnderTest) -> str:
    """The reported speeds of a vehicle on the ground are below 1 m/s."""
    position, hud = _both(vehicle, "GLOBAL_POSITION_INT", "VFR_HUD")
    speed_m_s = math.hypot(position.vx, position.vy, position.vz) / 100
    holds(speed_m_s < STILL_M_S, f"GLOBAL_POSITION_INT: {speed_m_s:.2f} m/s")
    at_rest = hud.groundspeed < STILL_M_S and abs(hud.climb) < STILL_M_S
    holds(at_rest, f"VFR_HUD: groundspeed {hud.groundspeed:.2f} m/s, climb {hud.climb:.2f} m/s")
    return f"{speed_m_s:.2f} m/s"


# -- attitude --------------------------------------------------------------------------------------------


@check("telemetry.attitude.is_in_range")
def attitude_in_range(vehicle: VehicleUnderTest) -> str:
    """Roll and yaw are within ±pi rad, pitch is within ±pi / 2 rad."""
    for message in vehicle.sample({"ATTITUDE": 10.0}, 2.0)["ATTITUDE"]:
        holds(abs(message.roll) <= math.pi + 1e-5, f"roll {message.roll} rad")
        holds(abs(message.pitch) <= math.pi / 2 + 1e-5, f"pitch {message.pitch} rad")
        holds(abs(message.yaw) <= math.pi + 1e-5, f"yaw {message.yaw} rad")
    return f"yaw {math.degrees(message.yaw):.1f} deg"


@check("telemetry.attitude.is_level_at_rest")
def level_at_rest(vehicle: VehicleUnderTest) -> str:
    """A vehicle on the ground is level within 15 degrees and turns by less than 0.2 rad/s."""
    message = vehicle.sample({"ATTITUDE": 5.0}, 1.0)["ATTITUDE"][-1]
    tilt_deg = math.degrees(max(abs(message.roll), abs(message.pitch)))
    holds(tilt_deg < 15, f"the vehicle is tilted by {tilt_deg:.1f} deg")
    speed_rad_s = max(abs(message.rollspeed), abs(message.pitchspeed), abs(message.yawspeed))
    holds(speed_rad_s < 0.2, f"the vehicle turns at {speed_rad_s:.2f} rad/s")
    return f"{tilt_deg:.2f} deg"


@check("telemetry.attitude.quaternion_agrees")
def quaternion_agrees(vehicle: VehicleUnderTest) -> str:
    """ATTITUDE_QUATERNION has length 1 and agrees with ATTITUDE."""
    euler, q = _both(vehicle, "ATTITUDE", "ATTITUDE_QUATERNION")
    w, x, y, z = q.q1, q.q2, q.q3, q.q4
    near(math.sqrt(w * w + x * x + y * y + z * z), 1.0, 1e-3, "length of the quaternion")
    roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x))))
    yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    for name, seen, expected in (
        ("roll", roll, euler.roll),
        ("pitch", pitch, euler.pitch),
        ("yaw", yaw, euler.yaw),
    ):
        apart_deg = _degrees_apart(math.degrees(seen), math.degrees(expected))
        holds(apart_deg < 3, f"{name}: {apart_deg:.1f} deg apart")
    return "agrees within 3 deg"


@check("telemetry.heading.agrees")
def heading_agrees(vehicle: VehicleUnderTest) -> str:
    """hdg [cdeg], VFR_HUD.heading [deg] and yaw [rad] agree."""
    found = vehicle.sample({"GLOBAL_POSITION_INT": 5.0, "VFR_HUD": 5.0, "ATTITUDE": 5.0}, 1.5)
    position, hud, attitude = (found[k][-1] for k in ("GLOBAL_POSITION_INT", "VFR_HUD", "ATTITUDE"))
    yaw_deg = math.degrees(attitude.yaw) % 360
    holds(0 <= hud.heading <= 360, f"expected a heading of 0 to 360, saw {hud.heading}")
    holds(_degrees_apart(hud.heading, yaw_deg) < 4, f"VFR_HUD {hud.heading} deg, ATTITUDE {yaw_deg:.1f} deg")
    if position.hdg != 65_535:
        holds(
            _degrees_apart(position.hdg / 100, yaw_deg) < 4,
            f"hdg {position.hdg / 100} deg, yaw {yaw_deg:.1f} deg",
        )
    return f"{yaw_deg:.1f} deg"


# -- GPS, estimator, sensors -----------------------------------------------------------------------------


@check("telemetry.gps.has_a_fix")
def gps_fix(vehicle: VehicleUnderTest) -> str:
    """GPS_RAW_INT reports a position and a 3D fix with at least four satellites."""
    gps = vehicle.request("GPS_RAW_INT")
    holds(gps.fix_type >= mavlink.GPS_FIX_TYPE_3D_FIX, f"expected a 3D fix, saw fix_type {gps.fix_type}")
    holds(gps.satellites_visible >= 4, f"expected 4 satellites, saw {gps.satellites_visible}")
    holds(abs(gps.lat) <= 900_000_000 and (gps.lat or gps.lon), f"no position: {gps.lat}, {gps.lon}")
    return f"fix_type {gps.fix_type}, {gps.satellites_visible} satellites"


@check("telemetry.gps.reports_its_quality")
def gps_quality(vehicle: VehicleUnderTest) -> str:
    """GPS_RAW_INT.eph and epv, dilution of precision times 100, are 10 to 1000."""
    gps = vehicle.request("GPS_RAW_INT")
    for name, value in (("eph", gps.eph), ("epv", gps.epv)):
        holds(10 <= value <= 1000, f"expected {name} of 10 to 1000, saw {value}")
    return f"eph {gps.eph / 100:.2f}, epv {gps.epv / 100:.2f}"


@check("telemetry.estimator.has_a_position")
def estimator(vehicle: VehicleUnderTest) -> str:
    """The estimator report of a ready vehicle has attitude and position."""
    flying.wait_ready(vehicle)
    kind = "EKF_STATUS_REPORT" if vehicle.dialect.name == "ardupilot" else "ESTIMATOR_STATUS"
    flags = vehicle.request(kind).flags
    needed = mavlink.ESTIMATOR_ATTITUDE | mavlink.ESTIMATOR_POS_HORIZ_ABS
    equal(flags & needed, needed, f"{kind} flags {flags:#x} of attitude and position")
    return f"{kind} {flags:#x}"


@check(
    "telemetry.sensors.are_consistent",
    source="PX4 SYS_STATUS.hpp, fillOutComponent: a required sensor that is missing is enabled and unhealthy",
)
def sensors(vehicle: VehicleUnderTest) -> str:
    """Every enabled sensor in SYS_STATUS is present or unhealthy, and a gyroscope is present."""
    status = vehicle.request("SYS_STATUS")
    present, enabled = status.onboard_control_sensors_present, status.onboard_control_sensors_enabled
    wrong = enabled & ~present & status.onboard_control_sensors_health
    holds(wrong == 0, f"enabled and healthy, but not present: {wrong:#x}")
    holds(present & mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO, "no gyroscope is present")
    return f"present {present:#x}"


@check("telemetry.sensors.load_is_a_share")
def load(vehicle: VehicleUnderTest) -> str:
    """The load is 0 to 1000 per mille."""
    value = vehicle.request("SYS_STATUS").load
    holds(0 <= value <= 1000, f"expected 0 to 1000, saw {value}")
    return f"{value / 10:.1f} %"


@check("telemetry.imu.measures_gravity")
def imu(vehicle: VehicleUnderTest) -> str:
    """At rest the accelerometer shows 9.8 m/s2 on average, with a negative z axis (z points down)."""
    for kind, scale in (("SCALED_IMU", 9.80665e-3), ("RAW_IMU", 9.80665e-3), ("HIGHRES_IMU", 1.0)):
        try:
            found = vehicle.sample({kind: 10.0}, 3.0)[kind]
        except Skip:
            continue
        axes = [(m.xacc, m.yacc, m.zacc) for m in found]
        acceleration = [scale * sum(values) / len(axes) for values in zip(*axes, strict=True)]
        near(math.hypot(*acceleration), 9.81, 0.6, f"{kind} m/s2")
        holds(acceleration[2] < 0, f"{kind}.zacc: expected a negative value, saw {acceleration[2]:.2f} m/s2")
        return f"{kind} {acceleration[2]:.2f} m/s2"
    raise Skip("the vehicle sends no acceleration")


@check("telemetry.pressure.fits_the_altitude")
def pressure(vehicle: VehicleUnderTest) -> str:
    """The absolute pressure agrees with the altitude within 5 %."""
    message, position = vehicle.request("SCALED_PRESSURE"), flying.position(vehicle)
    expected = 1013.25 * (1 - 2.25577e-5 * position.alt / 1000) ** 5.25588
    near(message.press_abs, expected, 0.05 * expected, "press_abs [hPa]")
    return f"{message.press_abs:.1f} hPa"


@check("telemetry.landed.on_ground")
def on_ground(vehicle: VehicleUnderTest) -> str:
    """EXTENDED_SYS_STATE reports ON_GROUND."""
    state = vehicle.request("EXTENDED_SYS_STATE").landed_state
    equal(state, mavlink.MAV_LANDED_STATE_ON_GROUND, "landed_state")
    return "ON_GROUND"


@check("telemetry.hud.throttle_is_a_percentage")
def throttle(vehicle: VehicleUnderTest) -> str:
    """VFR_HUD.throttle of a disarmed vehicle is 0."""
    value = vehicle.request("VFR_HUD").throttle
    equal(value, 0, "throttle")
    return "0 %"


# -- battery ---------------------------------------------------------------------------------------------


@check("telemetry.battery.messages_agree")
def battery_agrees(vehicle: VehicleUnderTest) -> str:
    """SYS_STATUS and BATTERY_STATUS agree on voltage and charge."""
    status, battery = _both(vehicle, "SYS_STATUS", "BATTERY_STATUS")
    cells = [v for v in battery.voltages if v not in (0, 65_535)]
    if not cells or status.voltage_battery == 65_535:
        raise Skip("the voltage is not known")
    near(sum(cells) / 1000, status.voltage_battery / 1000, 0.3, "voltage [V]")
    if battery.battery_remaining >= 0 and status.battery_remaining >= 0:
        near(battery.battery_remaining, status.battery_remaining, 2, "charge [%]")
    return f"{status.voltage_battery / 1000:.2f} V, {status.battery_remaining} %"


@check("telemetry.battery.is_in_range")
def battery_in_range(vehicle: VehicleUnderTest) -> str:
    """Charge is -1 to 100 %, consumption at least -1 mAh, and unused cells (65535) come last."""
    battery = vehicle.request("BATTERY_STATUS")
    holds(-1 <= battery.battery_remaining <= 100, f"battery_remaining {battery.battery_remaining}")
    holds(battery.current_consumed >= -1, f"current_consumed {battery.current_consumed}")
    known = [i for i, v in enumerate(battery.voltages) if v != 65_535]
    equal(known, list(range(len(known))), "cells with a voltage")
    return f"{battery.battery_remaining} %, {battery.current_consumed} mAh"


@check(
    "telemetry.battery.current_is_centiamperes",
    source="PX4 BATTERY_STATUS.hpp: 100 times the current, also of an unknown one (-1 A)",
)
def battery_current(vehicle: VehicleUnderTest) -> str:
    """A disarmed vehicle draws less than 10 A, or reports -1 (PX4: -100) for an unknown current."""
    current = vehicle.request("BATTERY_STATUS").current_battery
    unknown = (-1, -100) if vehicle.dialect.name == "px4" else (-1,)
    holds(current in unknown or 0 <= current < 1000, f"expected less than 1000 cA, saw {current}")
    return f"{current / 100:.2f} A"
