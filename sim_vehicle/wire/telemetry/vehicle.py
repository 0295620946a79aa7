"""State messages: heartbeat, health, landed state, mission, home, fence."""

import numpy as np

from sim_vehicle.wire.telemetry.view import Columns, View, north_east_down

LOAD_PER_MILLE = 100  # of the main loop


def heartbeat(v: View) -> Columns:
    s, i = v.status, v.i
    return {
        "type": s.vehicle_type[i],
        "autopilot": s.autopilot[i],
        "base_mode": s.base_mode[i],
        "custom_mode": s.custom_mode[i],
        "system_status": s.system_status[i],
        "mavlink_version": 3,
    }


def sys_status(v: View) -> Columns:
    s, i, batteries = v.status, v.i, v.world.batteries
    return {
        "onboard_control_sensors_present": s.sensors[i],
        "onboard_control_sensors_enabled": s.sensors_enabled[i],
        "onboard_control_sensors_health": s.health[i],
        "load": LOAD_PER_MILLE,
        "voltage_battery": batteries.voltage_v[i] * 1000,
        "current_battery": batteries.current_a[i] * 100,
        "battery_remaining": batteries.remaining[i] * 100,
    }


def extended_sys_state(v: View) -> Columns:
    return {"landed_state": v.status.landed_state[v.i]}


def mission_current(v: View) -> Columns:
    s, i = v.status, v.i
    return {
        "seq": s.mission_seq[i],
        "total": s.mission_total[i],
        "mission_state": s.mission_state[i],
        "mission_mode": s.mission_mode[i],
        "mission_id": s.mission_ids[i, 0],
        "fence_id": s.mission_ids[i, 1],
        "rally_points_id": s.mission_ids[i, 2],
    }


def home_position(v: View) -> Columns:
    """Return home; local coordinates are 0 unless `home_is_local`."""
    s, i = v.status, v.i
    east_m, north_m = v.world.frame.to_local(s.home_e7[i, 0] * 1e-7, s.home_e7[i, 1] * 1e-7)
    local_m = np.column_stack([east_m, north_m, s.home_amsl_m[i]]) - s.origin_m[i]
    local_m *= s.home_is_local[i, None]
    return {
        **north_east_down("x", "y", "z", local_m),
        "latitude": s.home_e7[i, 0],
        "longitude": s.home_e7[i, 1],
        "altitude": s.home_amsl_m[i] * 1000,
        "q": np.array([1.0, 0.0, 0.0, 0.0]),
        "time_usec": v.since_boot_us(),
    }


def gps_global_origin(v: View) -> Columns:
    s, i = v.status, v.i
    return {
        "latitude": s.origin_e7[i, 0],
        "longitude": s.origin_e7[i, 1],
        "altitude": s.origin_m[i, 2] * 1000,
        "time_usec": v.since_boot_us(),
    }


def fence_status(v: View) -> Columns:
    s, i = v.status, v.i
    return {
        "breach_status": s.fence_status[i],
        "breach_count": s.fence_breaches[i],
        "breach_type": s.fence_type[i],
        "breach_time": s.fence_time_ms[i],
    }


def strikes(v: View) -> Columns:
    return {"time_boot_ms": v.since_boot_ms(), "name": b"strikes", "value": v.status.strikes[v.i]}
