"""A vehicle that has left its route and is about to leave the fence.

Routes are inside the fence, leg by leg, before they are flown: who is on its route turns or stops in time,
however near the fence is. Who is not holds while it can still stop. Outside it returns. One position may be
wrong: what is done is the weaker of what two in a row demand.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import dist

from pydantic import Field

from swarmctl.agent.failsafes.base import STRENGTH, Demand, DemandKind, FailsafeFacts, Fence
from swarmctl.core.planar import contains, distance_to_track
from swarmctl.core.section import Section

NAME = "fence_ahead"

PlanePoint = tuple[float, float]
BRAKES_M_S2 = 2.5
"""ArduCopter's WPNAV_ACCEL as it comes"""
MOVED_M = 0.5
"""Less tells no direction."""


class Params(Section):
    """When it is too near."""

    off_route_m: float = Field(15.0, gt=0.0, description="nearer to its route it follows that [m]")
    seconds: float = Field(2.0, gt=0.0, description="from the order until it brakes [s]")


@dataclass(frozen=True, slots=True)
class FenceAheadMemory:
    here: PlanePoint
    """where it was when it was last seen to have moved"""
    course: PlanePoint | None = None
    """(east, north) of length 1"""
    judged_s: float | None = None
    """when the position came that was judged last"""
    found: Demand | None = None
    """what that one alone demands"""
    demanded: Demand | None = None


def evaluate(
    params: Params, memory: FenceAheadMemory | None, facts: FailsafeFacts, _now: float
) -> tuple[FenceAheadMemory | None, Demand | None]:
    here, fence = facts.position_m, facts.fence
    if here is None or fence is None or not facts.in_flight or facts.lost:
        return None, None
    told_s = facts.vehicle.position_s
    if memory is not None and memory.judged_s == told_s:
        return memory, memory.demanded
    before, memory = memory, _moved(memory, here)
    found = _found(params, memory, facts, fence, here)
    demand = None if before is None else _weaker(before.found, found)
    return FenceAheadMemory(memory.here, memory.course, told_s, found, demand), demand


def _found(
    params: Params, memory: FenceAheadMemory, facts: FailsafeFacts, fence: Fence, here: PlanePoint
) -> Demand | None:
    """What this position alone demands."""
    if not contains(fence.corners_m, here):
        return Demand(DemandKind.RETURN, "outside the fence")
    if (high_m := facts.vehicle.alt_rel_m or 0.0) > fence.ceiling_m:
        found = f"{high_m:.0f} m above home, expected at most {fence.ceiling_m:.0f} m"
        return Demand(DemandKind.RETURN, f"outside the fence: {found}")
    if facts.doing == "mission" and _leaves(params, memory, facts, fence.corners_m, here):
        # What cannot stop would circle over the fence: it turns for home.
        does = DemandKind.RETURN if facts.turn_radius_m else DemandKind.HOLD
        return Demand(does, "off its route, and about to leave the fence")
    return None


def _weaker(a: Demand | None, b: Demand | None) -> Demand | None:
    if a is None or b is None:
        return None
    return min((b, a), key=lambda action: STRENGTH[action.kind])


def _moved(memory: FenceAheadMemory | None, here: PlanePoint) -> FenceAheadMemory:
    if memory is None:
        return FenceAheadMemory(here)
    metres = dist(memory.here, here)
    if metres < MOVED_M:
        return memory
    course = ((here[0] - memory.here[0]) / metres, (here[1] - memory.here[1]) / metres)
    return FenceAheadMemory(here, course)


def _leaves(
    params: Params,
    memory: FenceAheadMemory,
    facts: FailsafeFacts,
    corners: tuple[PlanePoint, ...],
    here: PlanePoint,
) -> bool:
    """Whether it would be outside before it stood, or had turned, off its route as it is."""
    if memory.course is None or facts.way is None:
        return False
    track = tuple(facts.frame.to_local(*point) for point in facts.way.points)
    if distance_to_track(here, track) <= params.off_route_m:
        return False
    speed = facts.vehicle.ground_speed_m_s
    stops_m = speed * params.seconds + (facts.turn_radius_m or speed * speed / (2.0 * BRAKES_M_S2))
    there = (here[0] + stops_m * memory.course[0], here[1] + stops_m * memory.course[1])
    return not contains(corners, there)
