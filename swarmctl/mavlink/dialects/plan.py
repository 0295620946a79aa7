"""Steps from a plan to a mission, common to the dialects."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.mission import Approach, FlightPlan, MissionItem, Waypoint
from swarmctl.core.records import replace

TAKEOFF, WAYPOINT, LAND = (
    int(mavlink.MAV_CMD_NAV_TAKEOFF),
    int(mavlink.MAV_CMD_NAV_WAYPOINT),
    int(mavlink.MAV_CMD_NAV_LAND),
)
LAND_START = int(mavlink.MAV_CMD_DO_LAND_START)
LOITER_TO_ALT = int(mavlink.MAV_CMD_NAV_LOITER_TO_ALT)
JUMP = int(mavlink.MAV_CMD_DO_JUMP)


def copter_track(plan: FlightPlan) -> tuple[Waypoint, ...]:
    """Return the waypoints of a copter's plan; the last has the altitude at which the descent begins.

    NAV_LAND flies to its position at the vehicle's current altitude. If the track ends at another altitude,
    a waypoint above the landing is added. Raises ValueError for a plan that cannot be flown.
    """
    if plan.approach is not None:
        raise ValueError("the plan is for a fixed wing, but the vehicle hovers: set `airframe: copter`")
    track = plan.track
    if not track or track[-1].alt_rel_m != plan.landing.alt_rel_m:
        track = (*track, plan.landing)
    check_points(track, plan)
    return track


def plane_approaches(plan: FlightPlan) -> tuple[Approach, Approach]:
    """Return a fixed wing's approaches to its goal and to its take-off position.

    Raises ValueError for a plan that cannot be flown.
    """
    if plan.approach is None or plan.home_approach is None:
        raise ValueError("the plan is for a copter, but the vehicle is a fixed wing: set `airframe: plane`")
    check_points(plan.track, plan)
    return plan.approach, plan.home_approach


def check_points(track: Sequence[Waypoint], plan: FlightPlan) -> None:
    """Raise ValueError if a point or the take-off altitude of a plan is invalid."""
    for label, point in (*((f"waypoint {i}", p) for i, p in enumerate(track)), ("landing", plan.landing)):
        if not (-90 <= point.lat_deg <= 90 and -180 <= point.lon_deg <= 180 and isfinite(point.alt_rel_m)):
            raise ValueError(f"{label}: expected a valid latitude, longitude and altitude, found {point}")
    if not (isfinite(plan.takeoff_alt_m) and plan.takeoff_alt_m > 0):
        raise ValueError(f"take-off altitude: expected metres above 0, found {plan.takeoff_alt_m}")


def item_at(command: int, frame: int, point: Waypoint, alt_m: float) -> MissionItem:
    """Return a mission item at a point."""
    return MissionItem(command, frame, round(point.lat_deg * 1e7), round(point.lon_deg * 1e7), alt_m)


def append_items(
    flown: Sequence[MissionItem], items: Sequence[MissionItem], first: int
) -> tuple[MissionItem, ...]:
    """Return `flown` followed by `items` from `first` on, with the jumps of `items` renumbered."""
    shift = len(flown) - first
    moved = (
        replace(item, param1=item.param1 + shift) if item.command == JUMP else item for item in items[first:]
    )
    return (*flown, *moved)
