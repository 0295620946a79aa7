"""Samples for flight logs, read from the fleet's arrays for all due vehicles together."""

import numpy as np

from sim_vehicle.files.logs.record import Sample
from sim_vehicle.physics.gps import EPH_M, SATELLITES
from sim_vehicle.wire.telemetry.view import View

WH_PER_J = 1.0 / 3600.0
FLOAT32_MAX = float(np.finfo(np.float32).max)


def samples(v: View) -> list[Sample]:
    """Return one sample for each vehicle of the view, in order; values are clipped to the float32 range."""
    world, status, i = v.world, v.status, v.i
    gps, batteries, dynamics = world.gps, world.batteries, world.dynamics
    lat_deg, lon_deg = world.estimated_geodetic()
    gps_lat_deg, gps_lon_deg = gps.geodetic()
    offset_m = world.estimate_m[i] - status.origin_m[i]
    velocity_m_s = world.estimate_velocity_m_s[i]
    attitude_rad = dynamics.attitude_rad[i]
    fix_type = np.where(status.gps_seen[i], gps.fix_type[i], 1)
    satellites = np.where(fix_type >= 2, SATELLITES, 0)
    floats = (
        lat_deg[i],
        lon_deg[i],
        world.estimate_m[i, 2],
        v.height_m(),
        offset_m[:, 1],
        offset_m[:, 0],
        offset_m[:, 2],
        velocity_m_s[:, 1],
        velocity_m_s[:, 0],
        -velocity_m_s[:, 2],
        attitude_rad[:, 0],
        attitude_rad[:, 1],
        attitude_rad[:, 2],
        batteries.voltage_v[i],
        batteries.current_a[i],
        batteries.used_mah[i],
        batteries.used_j[i] * WH_PER_J,
        batteries.remaining[i],
        np.full(len(i), EPH_M),
        gps_lat_deg[i],
        gps_lon_deg[i],
        gps.position_m[i, 2],
    )
    rows = np.clip(np.column_stack(floats), -FLOAT32_MAX, FLOAT32_MAX).tolist()
    integers = np.column_stack((fix_type, satellites)).tolist()
    return [Sample(*row, *pair) for row, pair in zip(rows, integers, strict=True)]
