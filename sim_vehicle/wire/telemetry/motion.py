"""Estimated position, motion and targets of a vehicle."""

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.physics.attitude import quaternions
from sim_vehicle.physics.geodesy import Floats
from sim_vehicle.physics.gps import EPH_M
from sim_vehicle.physics.motion import Bools, MotionOrder
from sim_vehicle.wire.telemetry.view import Columns, Ints, View, north_east_down, vectors

EKF_NO_POSITION = (
    mavlink.EKF_ATTITUDE | mavlink.EKF_VELOCITY_VERT | mavlink.EKF_POS_VERT_ABS | mavlink.EKF_CONST_POS_MODE
)
EKF_POSITION = (
    mavlink.EKF_ATTITUDE
    | mavlink.EKF_VELOCITY_HORIZ
    | mavlink.EKF_VELOCITY_VERT
    | mavlink.EKF_POS_HORIZ_REL
    | mavlink.EKF_POS_HORIZ_ABS
    | mavlink.EKF_POS_VERT_ABS
    | mavlink.EKF_PRED_POS_HORIZ_REL
    | mavlink.EKF_PRED_POS_HORIZ_ABS
)


def global_position_int(v: View) -> Columns:
    lat, lon = v.e7()
    velocity = v.world.estimate_velocity_m_s[v.i] * 100
    return {
        "time_boot_ms": v.since_boot_ms(),
        "lat": lat,
        "lon": lon,
        "alt": v.world.estimate_m[v.i, 2] * 1000,
        "relative_alt": v.height_m() * 1000,
        **north_east_down("vx", "vy", "vz", velocity),
        "hdg": np.rint(v.heading_deg() * 100) % 36_000,
    }


def local_position_ned(v: View) -> Columns:
    return {"time_boot_ms": v.since_boot_ms(), **place_and_velocity(v)}


def place_and_velocity(v: View) -> Columns:
    """Return the position relative to the origin, and the velocity."""
    offset_m = v.world.estimate_m[v.i] - v.status.origin_m[v.i]
    velocity = v.world.estimate_velocity_m_s[v.i]
    return {**north_east_down("x", "y", "z", offset_m), **north_east_down("vx", "vy", "vz", velocity)}


def attitude(v: View) -> Columns:
    return {
        "time_boot_ms": v.since_boot_ms(),
        **vectors("roll", "pitch", "yaw", v.world.dynamics.attitude_rad[v.i]),
        **body_rates(v),
    }


def body_rates(v: View) -> Columns:
    return vectors("rollspeed", "pitchspeed", "yawspeed", v.world.dynamics.rates_rad_s[v.i])


def quaternion(v: View) -> Columns:
    """Return the attitude as w, x, y, z."""
    q = quaternions(v.world.dynamics.attitude_rad[v.i])
    return {"q1": q[:, 0], "q2": q[:, 1], "q3": q[:, 2], "q4": q[:, 3]}


def attitude_quaternion(v: View) -> Columns:
    return {
        "time_boot_ms": v.since_boot_ms(),
        **quaternion(v),
        **body_rates(v),
    }


def vfr_hud(v: View) -> Columns:
    velocity = v.world.estimate_velocity_m_s[v.i]
    return {
        "airspeed": v.world.dynamics.airspeed_m_s[v.i],
        "groundspeed": np.hypot(velocity[:, 0], velocity[:, 1]),
        "heading": np.rint(v.heading_deg()) % 360,
        "throttle": v.world.dynamics.throttle[v.i] * 100,
        "alt": v.world.estimate_m[v.i, 2],
        "climb": velocity[:, 2],
    }


def nav_controller_output(v: View) -> Columns:
    dynamics, i = v.world.dynamics, v.i
    error = dynamics.target_m[i] - v.world.estimate_m[i]
    bearing_deg = np.rint(np.rad2deg(np.arctan2(error[:, 0], error[:, 1])))
    angles_deg = np.rad2deg(dynamics.attitude_rad[i])
    return {
        "nav_roll": angles_deg[:, 0],
        "nav_pitch": angles_deg[:, 1],
        "nav_bearing": bearing_deg,
        "target_bearing": bearing_deg,
        "wp_dist": np.hypot(error[:, 0], error[:, 1]),
        "alt_error": error[:, 2],
    }


# POSITION_TARGET_TYPEMASK: ignored parts of a target.
IGNORE_XYZ, IGNORE_Z, IGNORE_VELOCITY = 0x0007, 0x0004, 0x0038
IGNORE_ACCELERATION, IGNORE_YAW = 0x01C0, 0x0C00  # IGNORE_YAW includes the yaw rate
POSITION_ONLY = IGNORE_VELOCITY | IGNORE_ACCELERATION | IGNORE_YAW
UNUSED_BITS = 0xF000  # set by ArduPilot in POSITION_TARGET_GLOBAL_INT
XYZ_BITS = np.array([[1], [2], [4]])
TO_A_POINT = (MotionOrder.POSITION, MotionOrder.FOLLOW)  # orders of a flight to a position
SET_POINT = ("vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate")

NED_SIGNS = np.array([[1.0], [1.0], [-1.0]])  # factors from north, east, up to north, east, down


def _flying(v: View) -> Bools:
    return np.asarray(v.world.dynamics.airborne[v.i] & v.world.dynamics.armed[v.i])


def is_steered(v: View) -> Bools:
    """Return the mask of vehicles with a navigation controller: not an ArduPlane in MANUAL, mode 0."""
    manual = v.world.dynamics.planes[v.i] & (v.status.custom_mode[v.i] == 0) & ~v.is_px4()
    return np.asarray(~manual)


def has_global_target(v: View) -> Bools:
    """Return the mask of vehicles with a global target: ArduCopter and PX4 only in flight."""
    dynamics, i, px4 = v.world.dynamics, v.i, v.is_px4()
    has_position = px4 | np.isin(dynamics.order[i], TO_A_POINT)
    return np.asarray(v.status.has_place[i] & ((dynamics.planes[i] & ~px4) | (has_position & _flying(v))))


def has_local_target(v: View) -> Bools:
    """Return the mask of vehicles with a local target: none under MotionOrder.TILT, PX4 only in flight."""
    status, i = v.status, v.i
    reports = (_flying(v) | ~v.is_px4()) & (v.world.dynamics.order[i] != MotionOrder.TILT)
    return np.asarray(status.has_setpoint[i] & status.has_origin[i] & reports)


def _set_points(v: View, px4: Bools) -> Floats:
    """Return the values of SET_POINT beside a position, (8, n): 0 on ArduPilot, NaN for PX4 planes."""
    dynamics, i = v.world.dynamics, v.i
    set_points = np.zeros((len(SET_POINT), len(i)))
    if px4.any():
        set_points[:3] = _ned(dynamics.estimate_velocity[:, i])
        set_points[3:6] = _ned(dynamics.acceleration[:, i])
        set_points[6] = dynamics.wanted_heading_rad[i]
        set_points[7] = dynamics.wanted_yaw_rate_rad_s[i]
        set_points[:, dynamics.planes[i]] = np.nan
        set_points[:, ~px4] = 0.0
    follows = dynamics.order[i] == MotionOrder.FOLLOW
    if follows.any():
        set_points[:6, follows] = _followed(v, i[follows], px4[follows])
    return set_points


def _followed(v: View, i: Ints, px4: Bools) -> Floats:
    """Return velocity and acceleration of set-points, (6, n): as received, of PX4 after its control."""
    follow = v.world.dynamics.follow
    velocity = np.where(px4, follow.wanted_velocity_m_s[:, i], np.nan_to_num(follow.velocity_m_s[:, i]))
    acceleration = np.where(px4, follow.wanted_acceleration_m_s2[:, i], follow.acceleration_m_s2[:, i])
    return np.vstack([_ned(velocity), _ned(acceleration)])


def _ned(east_north_up: Floats) -> Floats:
    """Convert east, north, up to north, east, down, (3, n)."""
    return np.asarray(east_north_up[[1, 0, 2]] * NED_SIGNS)


def position_target_global_int(v: View) -> Columns:
    dynamics, i, px4 = v.world.dynamics, v.i, v.is_px4()
    lat_deg, lon_deg = v.world.frame.to_geodetic(dynamics.target_m[i, 0], dynamics.target_m[i, 1])
    return {
        "time_boot_ms": v.since_boot_ms(),
        "coordinate_frame": np.where(px4, mavlink.MAV_FRAME_GLOBAL_INT, mavlink.MAV_FRAME_GLOBAL),
        "type_mask": np.where(px4, 0, POSITION_ONLY | UNUSED_BITS),
        "lat_int": lat_deg * 1e7,
        "lon_int": lon_deg * 1e7,
        "alt": dynamics.target_m[i, 2],
        **dict(zip(SET_POINT, _set_points(v, px4), strict=True)),
    }


def _local_mask(v: View, px4: Bools, flies_velocity: Bools) -> Ints:
    """Return POSITION_TARGET_TYPEMASK; ArduPilot sends a position in take-off and flight to a point only."""
    status, dynamics, i = v.status, v.world.dynamics, v.i
    order = dynamics.order[i]
    mask = np.where(flies_velocity, IGNORE_XYZ, np.where(order == MotionOrder.RATE, IGNORE_Z, 0))
    mask[dynamics.planes[i]] = POSITION_ONLY
    has_position = np.zeros(len(i), dtype=bool)
    if not px4.all():
        takes_off = status.landed_state[i] == mavlink.MAV_LANDED_STATE_TAKEOFF
        has_position = takes_off | (status.has_place[i] & np.isin(order, TO_A_POINT) & _flying(v))
        mask = np.where(px4, mask, np.where(has_position, POSITION_ONLY, IGNORE_XYZ | IGNORE_YAW))
    follows = order == MotionOrder.FOLLOW
    if follows.any():
        ignored = np.isnan(dynamics.follow.position_m[:, i])
        mask = np.where(follows & px4, (ignored * XYZ_BITS).sum(axis=0), mask)
        moving = follows & ~px4 & ~has_position & ~ignored.any(axis=0)
        mask = np.where(moving, IGNORE_YAW, mask)
    return mask


def position_target_local_ned(v: View) -> Columns:
    """Return a position target or a velocity set-point; an ignored position is 0 on ArduPilot, NaN on PX4."""
    dynamics, i, px4 = v.world.dynamics, v.i, v.is_px4()
    flies_velocity = (dynamics.order[i] == MotionOrder.VELOCITY) & ~dynamics.planes[i]
    mask, set_points = _local_mask(v, px4, flies_velocity), _set_points(v, px4)
    position_m = _ned(dynamics.target[:, i] - v.status.origin_m[i].T)
    ignored = mask & XYZ_BITS != 0
    if ignored.any():
        position_m = np.where(ignored, np.where(px4, np.nan, 0.0), position_m)
    if flies_velocity.any():
        horizontal_m_s = dynamics.wanted_velocity[:, i[flies_velocity]]
        vertical_m_s = dynamics.rate_m_s[i[flies_velocity]]
        set_points[:3, flies_velocity] = _ned(np.vstack([horizontal_m_s, vertical_m_s]))
    return {
        "time_boot_ms": v.since_boot_ms(),
        "coordinate_frame": mavlink.MAV_FRAME_LOCAL_NED,
        "type_mask": mask,
        **dict(zip("xyz", position_m, strict=True)),
        **dict(zip(SET_POINT, set_points, strict=True)),
    }


def altitude(v: View) -> Columns:
    up_m, height_m = v.world.estimate_m[v.i, 2], v.height_m()
    return {
        "time_usec": v.since_boot_us(),
        "altitude_monotonic": up_m,
        "altitude_amsl": up_m,
        "altitude_local": up_m - v.status.origin_m[v.i, 2],
        "altitude_relative": height_m,
        "altitude_terrain": up_m - v.world.dynamics.ground_m[v.i],
        "bottom_clearance": np.nan,
    }


def ekf_status_report(v: View) -> Columns:
    return {
        "flags": np.where(v.status.position_known[v.i], EKF_POSITION, EKF_NO_POSITION),
        "velocity_variance": 0.02,
        "pos_horiz_variance": 0.03,
        "pos_vert_variance": 0.03,
        "compass_variance": 0.02,
    }


def estimator_status(v: View) -> Columns:
    known = v.status.position_known[v.i]
    eph_m = np.where(known, EPH_M, np.nan)
    # Up to PRED_POS_HORIZ_ABS the bits are equal to those of EKF_STATUS_REPORT.
    return {
        "time_usec": v.since_boot_us(),
        "flags": np.where(known, EKF_POSITION, EKF_NO_POSITION),
        "vel_ratio": 0.1,
        "pos_horiz_ratio": 0.1,
        "pos_vert_ratio": 0.1,
        "mag_ratio": 0.1,
        "pos_horiz_accuracy": eph_m,
        "pos_vert_accuracy": eph_m * 1.6,
    }
