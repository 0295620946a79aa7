"""Sensor messages: satellites, battery, inertia, pressure, wind, clocks."""

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.epoch import EPOCH_US
from sim_vehicle.physics.geodesy import Floats
from sim_vehicle.physics.gps import EPH_M, SATELLITES
from sim_vehicle.physics.motion import GRAVITY_M_S2
from sim_vehicle.wire.telemetry.view import (
    UNKNOWN,
    UNKNOWN_I16,
    UNKNOWN_U16,
    Columns,
    View,
    north_east_down,
    vectors,
)

SEA_LEVEL_HPA, SEA_LEVEL_K = 1013.25, 288.15
FIELD_MGAUSS = (214.0, 9.0, 421.0)  # the earth's magnetic field in Ljubljana: north, east, down


def gps_raw_int(v: View) -> Columns:
    gps, i = v.world.gps, v.i
    fix = v.status.gps_seen[i] & (gps.fix_type[i] >= mavlink.GPS_FIX_TYPE_3D_FIX)
    lat_deg, lon_deg = gps.geodetic()
    velocity = v.world.dynamics.velocity_m_s[i]
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    course_deg = np.rad2deg(np.arctan2(velocity[:, 0], velocity[:, 1])) % 360
    return {
        "time_usec": v.since_boot_us(),
        "fix_type": np.where(fix, gps.fix_type[i], mavlink.GPS_FIX_TYPE_NO_FIX),
        "lat": np.where(fix, lat_deg[i], 0) * 1e7,
        "lon": np.where(fix, lon_deg[i], 0) * 1e7,
        "alt": np.where(fix, gps.position_m[i, 2], 0) * 1000,
        "alt_ellipsoid": np.where(fix, gps.position_m[i, 2], 0) * 1000,
        "eph": np.where(fix, EPH_M * 100, UNKNOWN_U16),
        "epv": np.where(fix, EPH_M * 160, UNKNOWN_U16),
        "vel": np.where(fix, speed * 100, UNKNOWN_U16),
        "cog": np.where(fix, course_deg * 100 % 36_000, UNKNOWN_U16),
        "satellites_visible": np.where(fix, SATELLITES, 0),
        "h_acc": np.where(fix, EPH_M * 1000, 0),
        "v_acc": np.where(fix, EPH_M * 1600, 0),
    }


def battery_status(v: View) -> Columns:
    batteries, i = v.world.batteries, v.i
    voltages = np.full((len(i), 10), UNKNOWN_U16)
    voltages[:, 0] = np.rint(batteries.voltage_v[i] * 1000).clip(0, UNKNOWN_U16 - 1)
    share, current_a = batteries.remaining[i], batteries.current_a[i]
    remaining_s = share * batteries.capacity_mah[i] * 3.6 / np.maximum(current_a, 0.01)
    return {
        "battery_function": mavlink.MAV_BATTERY_FUNCTION_ALL,
        "type": mavlink.MAV_BATTERY_TYPE_LIPO,
        "temperature": UNKNOWN_I16,
        "voltages": voltages,
        "current_battery": current_a * 100,
        "current_consumed": batteries.used_mah[i],
        "energy_consumed": np.where(v.is_px4(), UNKNOWN, batteries.used_j[i] / 100),
        "battery_remaining": share * 100,
        "time_remaining": remaining_s,
        "charge_state": v.status.battery_state[i],
    }


def system_time(v: View) -> Columns:
    unix_us = np.where(v.status.gps_seen[v.i], EPOCH_US + round(v.now * 1e6), 0)
    return {"time_unix_usec": unix_us.astype(np.uint64), "time_boot_ms": v.since_boot_ms()}


def timesync(v: View) -> Columns:
    """Return a TIMESYNC request of the vehicle: tc1 is 0, ts1 the vehicle's clock [ns]."""
    return {"ts1": np.rint(v.since_boot_s() * 1e9).astype(np.int64)}


def wind(v: View) -> Columns:
    """Return the true wind in ArduPilot's WIND; `direction` is the direction from which the wind blows."""
    east, north, up = v.world.wind.wind_m_s[v.i].T
    return {
        "direction": np.rad2deg(np.arctan2(-east, -north)),
        "speed": np.hypot(east, north),
        "speed_z": -up,
    }


def wind_cov(v: View) -> Columns:
    return {
        "time_usec": v.since_boot_us(),
        **north_east_down("wind_x", "wind_y", "wind_z", v.world.wind.wind_m_s[v.i]),
        "wind_alt": v.world.estimate_m[v.i, 2],
    }


def _pressure_hpa(up_m: Floats) -> Floats:
    return np.asarray(SEA_LEVEL_HPA * (1 - 2.25577e-5 * up_m) ** 5.25588)


def scaled_pressure(v: View) -> Columns:
    up_m = v.world.estimate_m[v.i, 2]
    return {
        "time_boot_ms": v.since_boot_ms(),
        "press_abs": _pressure_hpa(up_m),
        "temperature": (SEA_LEVEL_K - 0.0065 * up_m - 273.15) * 100,
    }


def magnetic_field_mgauss(v: View) -> Floats:
    """Return the earth's magnetic field forward and right of each vehicle's heading, and down, (n, 3)."""
    yaw = v.world.dynamics.attitude_rad[v.i, 2]
    north, east, down = FIELD_MGAUSS
    forward = north * np.cos(yaw) + east * np.sin(yaw)
    right = -north * np.sin(yaw) + east * np.cos(yaw)
    return np.column_stack([forward, right, np.full(len(yaw), down)])


def scaled_imu(v: View) -> Columns:
    return {
        **vectors("xacc", "yacc", "zacc", v.world.dynamics.specific_force_m_s2[v.i] / GRAVITY_M_S2 * 1000),
        **vectors("xgyro", "ygyro", "zgyro", v.world.dynamics.rates_rad_s[v.i] * 1000),
        **vectors("xmag", "ymag", "zmag", magnetic_field_mgauss(v)),
    }


def scaled_imu_since_boot(v: View) -> Columns:
    return {"time_boot_ms": v.since_boot_ms(), **scaled_imu(v)}


def raw_imu(v: View) -> Columns:
    return {"time_usec": v.since_boot_us(), **scaled_imu(v)}


def highres_imu(v: View) -> Columns:
    up_m = v.world.estimate_m[v.i, 2]
    return {
        "time_usec": v.since_boot_us(),
        **vectors("xacc", "yacc", "zacc", v.world.dynamics.specific_force_m_s2[v.i]),
        **vectors("xgyro", "ygyro", "zgyro", v.world.dynamics.rates_rad_s[v.i]),
        **vectors("xmag", "ymag", "zmag", magnetic_field_mgauss(v) / 1000),
        "abs_pressure": _pressure_hpa(up_m),
        "pressure_alt": up_m,
        "temperature": SEA_LEVEL_K - 0.0065 * up_m - 273.15,
        "fields_updated": 0x1FFF & ~0x0400,  # no differential pressure
    }


def vibration(v: View) -> Columns:
    return {"time_usec": v.since_boot_us(), "vibration_x": np.where(v.world.dynamics.airborne[v.i], 0.3, 0.0)}


def power_status(_v: View) -> Columns:
    return {"Vcc": 5000, "Vservo": 5000, "flags": mavlink.MAV_POWER_STATUS_BRICK_VALID}


def rc_channels(v: View) -> Columns:
    channels = {f"chan{n + 1}_raw": v.status.rc_us[v.i, n] for n in range(18)}
    rssi = np.where(v.is_px4(), 100, 255)  # of an override; ArduPilot: unknown
    return {"time_boot_ms": v.since_boot_ms(), "chancount": v.status.rc_count[v.i], "rssi": rssi, **channels}


def output_us(v: View) -> Floats:
    """Return the pulse width of each output [us]: 1000 disarmed, 1100 to 1900 by throttle if armed."""
    return np.where(v.world.armed[v.i], 1100 + 800 * v.world.dynamics.throttle[v.i], 1000.0)


def servo_output_raw(v: View) -> Columns:
    pulse_us = output_us(v)
    outputs = {f"servo{n}_raw": pulse_us for n in range(1, 5)}
    return {"time_usec": np.asarray(v.since_boot_us() % (1 << 32), dtype=np.uint32), **outputs}
