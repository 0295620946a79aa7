"""Messages that only PX4 streams."""

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.physics.attitude import quaternions
from sim_vehicle.physics.geodesy import Floats
from sim_vehicle.physics.gps import EPH_M
from sim_vehicle.physics.motion import GRAVITY_M_S2
from sim_vehicle.wire.telemetry.motion import body_rates, place_and_velocity
from sim_vehicle.wire.telemetry.sensors import output_us
from sim_vehicle.wire.telemetry.view import Columns, View, north_east_down

UNKNOWN_TIME_S = -1
OUTPUTS = 4  # motors or servos
DIAGONAL = (0, 6, 11, 15, 18, 20)  # diagonal of a symmetric 6 x 6 matrix, upper triangle by rows
ANGLE_VARIANCE_RAD2, VELOCITY_VARIANCE_M2_S2 = 1e-4, 1e-2


def time_estimate_to_target(v: View) -> Columns:
    """Return the time to the origin [s] at the present speed, at least 5 m/s; unknown times are -1."""
    status, dynamics = v.status, v.world.dynamics
    distance_m = np.hypot(*(v.world.estimate_m[v.i, :2] - status.origin_m[v.i, :2]).T)
    speed_m_s = np.maximum(np.hypot(dynamics.velocity_m_s[v.i, 0], dynamics.velocity_m_s[v.i, 1]), 5.0)
    others = ("land", "mission_next_item", "mission_end", "commanded_action")
    return_s = np.where(dynamics.airborne[v.i], distance_m / speed_m_s, UNKNOWN_TIME_S)
    return {"safe_return": return_s, **dict.fromkeys(others, UNKNOWN_TIME_S)}


def current_event_sequence(_v: View) -> Columns:
    """Return sequence 0: no events are sent."""
    return {"sequence": 0}


def current_mode(v: View) -> Columns:
    mode = v.status.custom_mode[v.i]
    return {"custom_mode": mode, "intended_custom_mode": mode, "standard_mode": v.status.standard_mode[v.i]}


def _since_boot_us(v: View, at_s: Floats) -> Floats:
    """Convert times of the simulation [s] to times since the boot [us]; NaN becomes 0."""
    return np.asarray(np.nan_to_num((at_s - v.status.boot_s[v.i]) * 1e6))


def flight_information(v: View) -> Columns:
    """Return FLIGHT_INFORMATION; as in PX4, the `_utc` fields hold times since the boot [us]."""
    return {
        "time_boot_ms": v.since_boot_ms(),
        "arming_time_utc": _since_boot_us(v, v.status.armed_since_s[v.i]),
        "takeoff_time_utc": _since_boot_us(v, v.status.flying_since_s[v.i]),
        "flight_uuid": v.status.flights[v.i],
    }


def hil_state_quaternion(v: View) -> Columns:
    """Return the true state, as PX4's simulators do; the time stays 0 as in PX4."""
    dynamics, i = v.world.dynamics, v.i
    lat_deg, lon_deg = v.world.frame.to_geodetic(dynamics.position_m[i, 0], dynamics.position_m[i, 1])
    return {
        "attitude_quaternion": quaternions(dynamics.attitude_rad[i]),
        **body_rates(v),
        "lat": lat_deg * 1e7,
        "lon": lon_deg * 1e7,
        "alt": dynamics.position_m[i, 2] * 1000,
        **north_east_down("vx", "vy", "vz", dynamics.velocity_m_s[i] * 100),
        **north_east_down("xacc", "yacc", "zacc", dynamics.acceleration_m_s2[i] * (1000 / GRAVITY_M_S2)),
    }


def odometry(v: View) -> Columns:
    """Return position and velocity (north, east, down), attitude and body rates."""
    pose, velocity = (np.full((len(v.i), 21), np.nan) for _ in range(2))
    pose[:, DIAGONAL[:2]] = EPH_M**2
    pose[:, DIAGONAL[2]] = EPH_M**2 * 1.6**2
    pose[:, DIAGONAL[3:]] = ANGLE_VARIANCE_RAD2
    velocity[:, DIAGONAL[:3]] = VELOCITY_VARIANCE_M2_S2
    return {
        **place_and_velocity(v),
        "time_usec": v.since_boot_us(),
        "frame_id": mavlink.MAV_FRAME_LOCAL_NED,
        "child_frame_id": mavlink.MAV_FRAME_LOCAL_NED,
        "q": quaternions(v.world.dynamics.attitude_rad[v.i]),
        **body_rates(v),
        "pose_covariance": pose,
        "velocity_covariance": velocity,
        "estimator_type": mavlink.MAV_ESTIMATOR_TYPE_AUTOPILOT,
    }


def actuator_output_status(v: View) -> Columns:
    outputs = np.zeros((len(v.i), 32))
    outputs[:, :OUTPUTS] = output_us(v)[:, None]
    return {"time_usec": v.since_boot_us(), "active": OUTPUTS, "actuator": outputs}
