"""Telemetry on the ground: units, ranges, agreement between messages."""

import math
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import flying, plans
from sim_vehicle.conformance.assertions import at_least, at_most, equal, holds, near, within
from sim_vehicle.conformance.outcomes import CheckFailed, Skip
from sim_vehicle.conformance.registry import check, checks, row
from sim_vehicle.conformance.vehicle import VehicleUnderTest

STILL_M_S = 1.0  # a vehicle at rest is slower
AGREE_M = 8.0  # at rest, GPS position and estimate are nearer to each other
FINITE_KINDS = ("ATTITUDE", "VFR_HUD", "LOCAL_POSITION_NED", "ATTITUDE_QUATERNION")  # checked for NaN
GYRO = mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO


def _degrees_apart(a: float, b: float) -> float:
    return abs((a - b + 180) % 360 - 180)


def _position_in_range(m: Any) -> str:
    within(m.lat, -900_000_000, 900_000_000, "lat")
    within(m.lon, -1_800_000_000, 1_800_000_000, "lon")
    holds(m.hdg < 36_000 or m.hdg == 65_535, f"expected hdg below 36000, saw {m.hdg}")
    return f"{m.lat / 1e7:.6f}, {m.lon / 1e7:.6f}"


def _gps_fix(m: Any) -> str:
    at_least(m.fix_type, mavlink.GPS_FIX_TYPE_3D_FIX, "fix_type")
    at_least(m.satellites_visible, 4, "satellites_visible")
    holds(abs(m.lat) <= 900_000_000 and (m.lat or m.lon), f"no position: {m.lat}, {m.lon}")
    return f"fix_type {m.fix_type}, {m.satellites_visible} satellites"


def _gps_quality(m: Any) -> str:
    return f"eph {within(m.eph, 10, 1000, 'eph') / 100:.2f}, epv {within(m.epv, 10, 1000, 'epv') / 100:.2f}"


def _sensors(m: Any) -> str:
    present, enabled = m.onboard_control_sensors_present, m.onboard_control_sensors_enabled
    wrong = enabled & ~present & m.onboard_control_sensors_health
    holds(wrong == 0, f"enabled and healthy, but not present: {wrong:#x}")
    holds(present & GYRO, "no gyroscope is present")
    return f"present {present:#x}"


def _on_ground(m: Any) -> str:
    equal(m.landed_state, mavlink.MAV_LANDED_STATE_ON_GROUND, "landed_state")
    return "ON_GROUND"


def _battery_in_range(m: Any) -> str:
    within(m.battery_remaining, -1, 100, "battery_remaining")
    at_least(m.current_consumed, -1, "current_consumed")
    known = [i for i, v in enumerate(m.voltages) if v != 65_535]
    equal(known, list(range(len(known))), "cells with a voltage")
    return f"{m.battery_remaining} %, {m.current_consumed} mAh"


def _altitude_of_home(home: Any, position: Any) -> str:
    altitude_m = (position.alt - position.relative_alt) / 1000
    return f"{near(altitude_m, home.altitude / 1000, 1.0, 'altitude of home [m]'):.2f} m"


def _pressure(pressure: Any, position: Any) -> str:
    expected = 1013.25 * (1 - 2.25577e-5 * position.alt / 1000) ** 5.25588
    return f"{near(pressure.press_abs, expected, 0.05 * expected, 'press_abs [hPa]'):.1f} hPa"


def _requested(vehicle: VehicleUnderTest, test: Callable[..., str], *kinds: str) -> str:
    return test(*map(vehicle.request, kinds))


checks(
    "telemetry", _requested,
    row("position.is_in_range", "Latitude, longitude and heading are within their ranges.",
        _position_in_range, "GLOBAL_POSITION_INT"),
    row("gps.has_a_fix", "GPS_RAW_INT reports a position and a 3D fix with at least four satellites.",
        _gps_fix, "GPS_RAW_INT"),
    row("gps.reports_its_quality",
        "GPS_RAW_INT.eph and epv, dilution of precision times 100, are 10 to 1000.",
        _gps_quality, "GPS_RAW_INT"),
    row("sensors.are_consistent",
        "Every enabled sensor in SYS_STATUS is present or unhealthy, and a gyroscope is present.",
        _sensors, "SYS_STATUS",
        source="PX4 SYS_STATUS.hpp, fillOutComponent: a required sensor that is missing is enabled and "
        "unhealthy"),
    row("sensors.load_is_a_share", "The load is 0 to 1000 per mille.",
        lambda m: f"{within(m.load, 0, 1000, 'load') / 10:.1f} %", "SYS_STATUS"),
    row("landed.on_ground", "EXTENDED_SYS_STATE reports ON_GROUND.", _on_ground, "EXTENDED_SYS_STATE"),
    row("hud.throttle_is_a_percentage", "VFR_HUD.throttle of a disarmed vehicle is 0.",
        lambda m: f"{equal(m.throttle, 0, 'throttle')} %", "VFR_HUD"),
    row("battery.is_in_range",
        "Charge is -1 to 100 %, consumption at least -1 mAh, and unused cells (65535) come last.",
        _battery_in_range, "BATTERY_STATUS"),
    row("altitude.relative_is_from_home", "alt minus relative_alt is the altitude of home.",
        _altitude_of_home, "HOME_POSITION", "GLOBAL_POSITION_INT"),
    row("pressure.fits_the_altitude", "The absolute pressure agrees with the altitude within 5 %.",
        _pressure, "SCALED_PRESSURE", "GLOBAL_POSITION_INT"),
)  # fmt: skip


def _speed_is_zero(position: Any, hud: Any) -> str:
    speed_m_s = math.hypot(position.vx, position.vy, position.vz) / 100
    at_most(hud.groundspeed, STILL_M_S, "groundspeed [m/s]")
    near(hud.climb, 0.0, STILL_M_S, "climb [m/s]")
    return f"{at_most(speed_m_s, STILL_M_S, 'speed of GLOBAL_POSITION_INT [m/s]'):.2f} m/s"


def _level(attitude: Any) -> str:
    tilt_deg = math.degrees(max(abs(attitude.roll), abs(attitude.pitch)))
    speed_rad_s = max(abs(attitude.rollspeed), abs(attitude.pitchspeed), abs(attitude.yawspeed))
    at_most(speed_rad_s, 0.2, "turn [rad/s]")
    return f"{at_most(tilt_deg, 15, 'tilt [deg]'):.2f} deg"


def _quaternion(euler: Any, q: Any) -> str:
    w, x, y, z = q.q1, q.q2, q.q3, q.q4
    near(math.sqrt(w * w + x * x + y * y + z * z), 1.0, 1e-3, "length of the quaternion")
    roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x))))
    yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    for name, seen in (("roll", roll), ("pitch", pitch), ("yaw", yaw)):
        apart_deg = _degrees_apart(math.degrees(seen), math.degrees(getattr(euler, name)))
        at_most(apart_deg, 3, f"difference of {name} [deg]")
    return "agrees within 3 deg"


def _heading(position: Any, hud: Any, attitude: Any) -> str:
    yaw_deg = math.degrees(attitude.yaw) % 360
    within(hud.heading, 0, 360, "heading")
    at_most(_degrees_apart(hud.heading, yaw_deg), 4, "difference of heading and yaw [deg]")
    if position.hdg != 65_535:
        at_most(_degrees_apart(position.hdg / 100, yaw_deg), 4, "difference of hdg and yaw [deg]")
    return f"{yaw_deg:.1f} deg"


def _battery_agrees(status: Any, battery: Any) -> str:
    cells = [v for v in battery.voltages if v not in (0, 65_535)]
    if not cells or status.voltage_battery == 65_535:
        raise Skip("the voltage is not known")
    near(sum(cells) / 1000, status.voltage_battery / 1000, 0.3, "voltage [V]")
    if battery.battery_remaining >= 0 and status.battery_remaining >= 0:
        near(battery.battery_remaining, status.battery_remaining, 2, "charge [%]")
    return f"{status.voltage_battery / 1000:.2f} V, {status.battery_remaining} %"


POSITION = "GLOBAL_POSITION_INT"


def _latest(vehicle: VehicleUnderTest, *kinds: str) -> list[Any]:
    found = vehicle.sample(dict.fromkeys(kinds, 5.0), 1.5)
    return [found[kind][-1] for kind in kinds]


def _agrees(vehicle: VehicleUnderTest, test: Callable[..., str], *kinds: str) -> str:
    return test(*_latest(vehicle, *kinds))


checks(
    "telemetry", _agrees,
    row("altitude.hud_agrees", "VFR_HUD.alt [m] agrees with GLOBAL_POSITION_INT.alt [mm].",
        lambda position, hud: f"{near(hud.alt, position.alt / 1000, 2.0, 'VFR_HUD.alt [m]'):.2f} m",
        POSITION, "VFR_HUD"),
    row("altitude.gps_agrees",
        "GPS_RAW_INT.alt [mm, above sea level] is within 15 m of GLOBAL_POSITION_INT.alt.",
        lambda position, gps: f"{near(gps.alt / 1000, position.alt / 1000, 15.0, 'GPS altitude [m]'):.1f} m",
        POSITION, "GPS_RAW_INT"),
    row("speed.is_zero_at_rest", "The reported speeds of a vehicle on the ground are below 1 m/s.",
        _speed_is_zero, POSITION, "VFR_HUD"),
    row("attitude.is_level_at_rest",
        "A vehicle on the ground is level within 15 degrees and turns by less than 0.2 rad/s.",
        _level, "ATTITUDE"),
    row("attitude.quaternion_agrees", "ATTITUDE_QUATERNION has length 1 and agrees with ATTITUDE.",
        _quaternion, "ATTITUDE", "ATTITUDE_QUATERNION"),
    row("heading.agrees", "hdg [cdeg], VFR_HUD.heading [deg] and yaw [rad] agree.",
        _heading, POSITION, "VFR_HUD", "ATTITUDE"),
    row("battery.messages_agree", "SYS_STATUS and BATTERY_STATUS agree on voltage and charge.",
        _battery_agrees, "SYS_STATUS", "BATTERY_STATUS"),
)  # fmt: skip


@check("telemetry.position")
def agrees_with_gps(vehicle: VehicleUnderTest) -> str:
    """GLOBAL_POSITION_INT is less than 8 m from GPS_RAW_INT."""
    flying.wait_ready(vehicle)
    position, gps = _latest(vehicle, POSITION, "GPS_RAW_INT")
    away_m = plans.distance_m((position.lat, position.lon), (gps.lat, gps.lon))
    return f"{at_most(away_m, AGREE_M, 'metres apart'):.2f} m apart"


@check("telemetry.time")
def goes_forward(vehicle: VehicleUnderTest) -> str:
    """time_boot_ms does not decrease within one kind of message."""
    kinds = {"ATTITUDE": 10.0, POSITION: 5.0}
    found = vehicle.sample(kinds, 4.0)
    for kind, rate_hz in kinds.items():
        times = [message.time_boot_ms for message in found[kind]]
        at_least(len(times), rate_hz, f"{kind} in 4 s")
        equal(times, sorted(times), f"time_boot_ms of {kind}")
    return f"{sum(map(len, found.values()))} messages"


@check("telemetry.time")
def is_milliseconds(vehicle: VehicleUnderTest) -> str:
    """time_boot_ms counts milliseconds of vehicle time."""
    with vehicle.streaming({"ATTITUDE": 10.0}):
        entries = [e for e in vehicle.wait(5.0) if e.kind == "ATTITUDE"]
    at_least(len(entries), 3, "ATTITUDE in 5 s")
    reported_s = (entries[-1].message.time_boot_ms - entries[0].message.time_boot_ms) / 1000
    return f"{near(reported_s, entries[-1].at_s - entries[0].at_s, 0.5, 'seconds reported'):.2f} s"


@check("telemetry")
def numbers_are_finite(vehicle: VehicleUnderTest) -> None:
    """No number of an attitude, VFR_HUD or local position message is NaN or infinite."""
    for kind, messages in vehicle.sample(dict.fromkeys(FINITE_KINDS, 4.0), 2.0).items():
        for message in messages:
            for name, value in message.to_dict().items():
                if isinstance(value, float) and name != "repr_offset_q" and not math.isfinite(value):
                    raise CheckFailed(f"{kind}.{name} is {value}")


@check("telemetry.attitude")
def is_in_range(vehicle: VehicleUnderTest) -> str:
    """Roll and yaw are within ±pi rad, pitch is within ±pi / 2 rad."""
    for message in vehicle.sample({"ATTITUDE": 10.0}, 2.0)["ATTITUDE"]:
        for name, most in (("roll", math.pi), ("pitch", math.pi / 2), ("yaw", math.pi)):
            near(getattr(message, name), 0.0, most + 1e-5, f"{name} [rad]")
    return f"yaw {math.degrees(message.yaw):.1f} deg"


@check("telemetry.imu")
def measures_gravity(vehicle: VehicleUnderTest) -> str:
    """At rest the accelerometer shows 9.8 m/s2 on average, with a negative z axis (z points down)."""
    for kind, scale in (("SCALED_IMU", 9.80665e-3), ("RAW_IMU", 9.80665e-3), ("HIGHRES_IMU", 1.0)):
        try:
            found = vehicle.sample({kind: 10.0}, 3.0)[kind]
        except Skip:
            continue
        axes = [(m.xacc, m.yacc, m.zacc) for m in found]
        acceleration = [scale * sum(values) / len(axes) for values in zip(*axes, strict=True)]
        near(math.hypot(*acceleration), 9.81, 0.6, f"{kind} m/s2")
        return f"{kind} {at_most(acceleration[2], 0, f'{kind}.zacc [m/s2]'):.2f} m/s2"
    raise Skip("the vehicle sends no acceleration")


@check("telemetry.local")
def at_rest(vehicle: VehicleUnderTest) -> str:
    """At rest LOCAL_POSITION_NED agrees with the distance from the local origin; the speed is below 1 m/s."""
    message = vehicle.sample({"LOCAL_POSITION_NED": 4.0}, 1.0)["LOCAL_POSITION_NED"][-1]
    origin = vehicle.request("GPS_GLOBAL_ORIGIN")
    away_m = plans.distance_m((origin.latitude, origin.longitude), plans.current_position(vehicle))
    near(math.hypot(message.x, message.y), away_m, 3.0, "distance from the origin [m]")
    at_most(math.hypot(message.vx, message.vy, message.vz), STILL_M_S, "speed [m/s]")
    return f"{message.x:.2f}, {message.y:.2f}, {message.z:.2f} m"


@check("telemetry.estimator")
def has_a_position(vehicle: VehicleUnderTest) -> str:
    """The estimator report of a ready vehicle has attitude and position."""
    flying.wait_ready(vehicle)
    kind = "EKF_STATUS_REPORT" if vehicle.dialect.name == "ardupilot" else "ESTIMATOR_STATUS"
    flags = vehicle.request(kind).flags
    needed = mavlink.ESTIMATOR_ATTITUDE | mavlink.ESTIMATOR_POS_HORIZ_ABS
    equal(flags & needed, needed, f"{kind} flags {flags:#x} of attitude and position")
    return f"{kind} {flags:#x}"


@check(
    "telemetry.battery", source="PX4 BATTERY_STATUS.hpp: 100 times the current, also of an unknown one (-1 A)"
)
def current_is_centiamperes(vehicle: VehicleUnderTest) -> str:
    """A disarmed vehicle draws less than 10 A, or reports -1 (PX4: -100) for an unknown current."""
    current = vehicle.request("BATTERY_STATUS").current_battery
    unknown = (-1, -100) if vehicle.dialect.name == "px4" else (-1,)
    holds(current in unknown or 0 <= current < 1000, f"expected less than 1000 cA, saw {current}")
    return f"{current / 100:.2f} A"
