"""Fence ahead: a vehicle off its route is about to leave the fence, or has left it.

Routes are inside the fence, leg by leg, so a vehicle on its route turns or stops in time.

| position | demand |
|---|---|
| on its route | none |
| off its route, would cross the fence while stopping | hold; a fixed wing returns, as it cannot stop |
| outside the fence or above its ceiling | return |

A single position may be wrong, so the rule takes the weaker demand of the last two positions.
"""

from __future__ import annotations

from math import dist

import msgspec
from pydantic import Field

from swarmctl.agent.failsafes.base import STRENGTH, Demand, DemandKind, FailsafeFacts, Fence
from swarmctl.core.planar import PlanarPoint, contains, distance_to_track
from swarmctl.core.section import Section

NAME = "fence_ahead"
DESCRIPTION = (
    "Fence ahead: a copter off its route holds before the fence, a fixed wing returns. "
    "Outside the fence every vehicle returns."
)

DECELERATION_M_S2 = 2.5
"""Deceleration [m/s²]: the default of ArduCopter's WPNAV_ACCEL."""
MIN_MOVEMENT_M = 0.5
"""Least movement that gives a course [m]."""


class Params(Section):
    """Limits of the rule."""

    off_route_m: float = Field(
        15.0, gt=0.0, description="distance from the route above which the vehicle is off its route [m]"
    )
    seconds: float = Field(2.0, gt=0.0, description="time from the order until the vehicle brakes [s]")


class FenceAheadMemory(msgspec.Struct, frozen=True):
    here: PlanarPoint
    """position after the last movement of at least MIN_MOVEMENT_M"""
    course: PlanarPoint | None = None
    """(east, north), unit vector"""
    evaluated_s: float | None = None
    """time of the last evaluated position"""
    found: Demand | None = None
    """demand of the last evaluated position alone"""
    demanded: Demand | None = None
    """demand of the rule: the weaker demand of the last two positions"""


def evaluate(
    params: Params, memory: FenceAheadMemory | None, facts: FailsafeFacts, _now: float
) -> tuple[FenceAheadMemory | None, Demand | None]:
    here, fence = facts.position_m, facts.fence
    if here is None or fence is None or not facts.in_flight or facts.lost:
        return None, None
    position_s = facts.vehicle.position_s
    if memory is not None and memory.evaluated_s == position_s:
        return memory, memory.demanded
    before, memory = memory, _update_course(memory, here)
    found = _position_demand(params, memory, facts, fence, here)
    demand = None if before is None else _weaker(before.found, found)
    return FenceAheadMemory(memory.here, memory.course, position_s, found, demand), demand


def _position_demand(
    params: Params, memory: FenceAheadMemory, facts: FailsafeFacts, fence: Fence, here: PlanarPoint
) -> Demand | None:
    if not contains(fence.corners_m, here):
        return Demand(DemandKind.RETURN, "the vehicle is outside the fence")
    if (high_m := facts.vehicle.alt_rel_m or 0.0) > fence.ceiling_m:
        found = f"{high_m:.0f} m above home (limit {fence.ceiling_m:.0f} m)"
        return Demand(DemandKind.RETURN, f"the vehicle is outside the fence: {found}")
    if facts.activity == "mission" and _leaves_fence(params, memory, facts, fence.corners_m, here):
        # A fixed wing in hold would circle across the fence, so it returns.
        kind = DemandKind.RETURN if facts.turn_radius_m else DemandKind.HOLD
        return Demand(kind, "the vehicle is off its route and about to leave the fence")
    return None


def _weaker(a: Demand | None, b: Demand | None) -> Demand | None:
    if a is None or b is None:
        return None
    return min((b, a), key=lambda demand: STRENGTH[demand.kind])


def _update_course(memory: FenceAheadMemory | None, here: PlanarPoint) -> FenceAheadMemory:
    if memory is None:
        return FenceAheadMemory(here)
    moved_m = dist(memory.here, here)
    if moved_m < MIN_MOVEMENT_M:
        return memory
    course = ((here[0] - memory.here[0]) / moved_m, (here[1] - memory.here[1]) / moved_m)
    return FenceAheadMemory(here, course)


def _leaves_fence(
    params: Params,
    memory: FenceAheadMemory,
    facts: FailsafeFacts,
    corners_m: tuple[PlanarPoint, ...],
    here: PlanarPoint,
) -> bool:
    """Return whether a vehicle off its route would leave the fence before it can stop or turn."""
    if memory.course is None or facts.mission is None:
        return False
    speed_m_s = facts.vehicle.ground_speed_m_s
    braking_m = facts.turn_radius_m or speed_m_s * speed_m_s / (2.0 * DECELERATION_M_S2)
    stops_m = speed_m_s * params.seconds + braking_m
    there = (here[0] + stops_m * memory.course[0], here[1] + stops_m * memory.course[1])
    if contains(corners_m, there):
        return False
    return distance_to_track(here, facts.track_m()) > params.off_route_m
