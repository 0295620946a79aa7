"""The next row of numbers of a vehicle: after telemetry, or after a word of its agent. Pure."""

from __future__ import annotations

import math

from swarmctl.core.frames import StateShared
from swarmctl.core.geo import distance_m
from swarmctl.core.vehicle import VehicleState
from swarmctl.dashboard.facts import Motion
from swarmctl.report.summary import MIN_STEP_M

SLOW_M_S = 0.5
"""speed below which the course over ground has no meaning [m/s]"""


def of_telemetry(before: Motion, state: VehicleState) -> Motion:
    """Return the row after a vehicle's telemetry, as its agent gets it."""
    moved_m = 0.0
    here = before.lat_lon if state.lat_lon is None else state.lat_lon
    if state.armed and before.lat_lon is not None and here is not None and here != before.lat_lon:
        moved_m = distance_m(before.lat_lon, here)
    lat_deg, lon_deg = here or (None, None)
    return Motion(
        lat_deg,
        lon_deg,
        before.height_m if state.alt_rel_m is None else state.alt_rel_m,
        state.ground_speed_m_s,
        _course_deg(state.east_m_s, state.north_m_s, state.heading_deg),
        state.battery_percent,
        state.strikes,
        state.time_boot_s,
        state.delay_s,
        (before.flown_m or 0.0) + moved_m,
        before.to_go_m,
    )


def of_word(before: Motion, state: StateShared) -> Motion:
    """Return the row after the state that a vehicle tells each second, if its telemetry is not known."""
    here = (state.lat_deg, state.lon_deg)
    east_m_s, north_m_s, _ = state.velocity_m_s
    moved_m = 0.0 if before.lat_lon is None else distance_m(before.lat_lon, here)
    return Motion(
        *here,
        state.alt_rel_m,
        math.hypot(east_m_s, north_m_s),
        _course_deg(east_m_s, north_m_s, before.course_deg),
        state.battery_percent,
        state.strikes,
        state.time_s,
        state.age_s,
        (before.flown_m or 0.0) + (moved_m if state.alt_rel_m > MIN_STEP_M else 0.0),
        state.to_go_m,
    )


def _course_deg(east_m_s: float, north_m_s: float, heading_deg: float | None) -> float | None:
    """Return the course over ground; for a slow vehicle its heading."""
    if math.hypot(east_m_s, north_m_s) < SLOW_M_S:
        return heading_deg
    return math.degrees(math.atan2(east_m_s, north_m_s)) % 360.0
