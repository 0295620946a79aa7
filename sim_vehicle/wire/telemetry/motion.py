"""Where a vehicle is and how it moves, as it estimates that itself."""

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.physics.geodesy import Floats
from sim_vehicle.wire.telemetry.view import Columns, View

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
        "time_boot_ms": v.boot_ms(),
        "lat": lat,
        "lon": lon,
        "alt": v.world.estimate_m[v.i, 2] * 1000,
        "relative_alt": v.height_m() * 1000,
        "vx": velocity[:, 1],
        "vy": velocity[:, 0],
        "vz": -velocity[:, 2],
        "hdg": np.rint(v.heading_deg() * 100) % 36_000,
    }


def local_position_ned(v: View) -> Columns:
    """Relative to the origin: where the vehicle stood when it got its first position."""
    offset_m = v.world.estimate_m[v.i] - v.status.origin_m[v.i]
    velocity = v.world.estimate_velocity_m_s[v.i]
    return {
        "time_boot_ms": v.boot_ms(),
        "x": offset_m[:, 1],
        "y": offset_m[:, 0],
        "z": -offset_m[:, 2],
        "vx": velocity[:, 1],
        "vy": velocity[:, 0],
        "vz": -velocity[:, 2],
    }


def attitude(v: View) -> Columns:
    angles, rates = v.world.dynamics.attitude_rad[v.i], v.world.dynamics.rates_rad_s[v.i]
    return {
        "time_boot_ms": v.boot_ms(),
        "roll": angles[:, 0],
        "pitch": angles[:, 1],
        "yaw": angles[:, 2],
        "rollspeed": rates[:, 0],
        "pitchspeed": rates[:, 1],
        "yawspeed": rates[:, 2],
    }


def quaternion(angles_rad: Floats) -> Floats:
    """(n, 3) roll, pitch, yaw [rad] -> (n, 4) w, x, y, z."""
    half = angles_rad / 2
    (cr, cp, cy), (sr, sp, sy) = np.cos(half).T, np.sin(half).T
    return np.column_stack(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ]
    )


def attitude_quaternion(v: View) -> Columns:
    q, rates = quaternion(v.world.dynamics.attitude_rad[v.i]), v.world.dynamics.rates_rad_s[v.i]
    return {
        "time_boot_ms": v.boot_ms(),
        "q1": q[:, 0],
        "q2": q[:, 1],
        "q3": q[:, 2],
        "q4": q[:, 3],
        "rollspeed": rates[:, 0],
        "pitchspeed": rates[:, 1],
        "yawspeed": rates[:, 2],
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


def position_target_global_int(v: View) -> Columns:
    dynamics, i = v.world.dynamics, v.i
    lat_deg, lon_deg = v.world.frame.to_geodetic(dynamics.target_m[i, 0], dynamics.target_m[i, 1])
    return {
        "time_boot_ms": v.boot_ms(),
        "coordinate_frame": mavlink.MAV_FRAME_GLOBAL_INT,
        "type_mask": 0x0FF8,  # the position counts, nothing else
        "lat_int": lat_deg * 1e7,
        "lon_int": lon_deg * 1e7,
        "alt": dynamics.target_m[i, 2],
    }


def position_target_local_ned(v: View) -> Columns:
    offset_m = v.world.dynamics.target_m[v.i] - v.status.origin_m[v.i]
    return {
        "time_boot_ms": v.boot_ms(),
        "coordinate_frame": mavlink.MAV_FRAME_LOCAL_NED,
        "type_mask": 0x0FF8,
        "x": offset_m[:, 1],
        "y": offset_m[:, 0],
        "z": -offset_m[:, 2],
    }


def altitude(v: View) -> Columns:
    up_m, height_m = v.world.estimate_m[v.i, 2], v.height_m()
    return {
        "time_usec": v.boot_us(),
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
    eph_m = np.where(known, v.world.gps.eph_m[v.i], np.nan)
    # Up to PRED_POS_HORIZ_ABS the flags of both messages are the same bits.
    return {
        "time_usec": v.boot_us(),
        "flags": np.where(known, EKF_POSITION, EKF_NO_POSITION),
        "vel_ratio": 0.1,
        "pos_horiz_ratio": 0.1,
        "pos_vert_ratio": 0.1,
        "mag_ratio": 0.1,
        "pos_horiz_accuracy": eph_m,
        "pos_vert_accuracy": eph_m * 1.6,
    }
