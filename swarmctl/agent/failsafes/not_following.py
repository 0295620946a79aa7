"""A vehicle that says it flies its mission, and does not: blown away, broken, or stuck."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from pydantic import Field

from swarmctl.agent.failsafes.base import Demand, DemandKind, FailsafeFacts, has_lasted, holds_since
from swarmctl.core.planar import distance_to_track
from swarmctl.core.section import Section

NAME = "not_following"

PlanePoint = tuple[float, float]
STANDS_M_S = 0.5
STANDS_CLIMB_M_S = 0.2


class Params(Section):
    """When it has left its route, and what becomes of it."""

    metres: float = Field(60.0, gt=0.0, description="so far off its route [m]")
    seconds: float = Field(15.0, gt=0.0, description="for so long; or so long without moving [s]")
    action: Literal["warn", "hold", "return", "land"] = Field("return", description="what becomes of it")


@dataclass(frozen=True, slots=True)
class NotFollowingMemory:
    plan_id: int
    track_m: tuple[PlanePoint, ...]
    """from where it was when this plan became its own (east, north) [m]"""
    off_since_s: float | None = None
    still_since_s: float | None = None
    demanded: Demand | None = None


def evaluate(
    params: Params, memory: NotFollowingMemory | None, facts: FailsafeFacts, now: float
) -> tuple[NotFollowingMemory | None, Demand | None]:
    here, way = facts.position_m, facts.way
    if facts.doing != "mission":
        return None, None
    if way is None or here is None or facts.lost:
        # Until all is known again nothing is counted, and nothing taken back.
        kept = None if memory is None else memory.demanded
        return memory and NotFollowingMemory(memory.plan_id, memory.track_m, demanded=kept), kept
    if memory is None or memory.plan_id != way.plan_id:
        track = (here, *(facts.frame.to_local(*point) for point in way.points))
        memory = NotFollowingMemory(way.plan_id, track)
    away_m = distance_to_track(here, memory.track_m)
    still = facts.vehicle.ground_speed_m_s < STANDS_M_S and abs(facts.vehicle.climb_m_s) < STANDS_CLIMB_M_S
    off_since_s = holds_since(memory.off_since_s, away_m > params.metres, now)
    still_since_s = holds_since(memory.still_since_s, still, now)
    demanded = memory.demanded
    if off_since_s is None and still_since_s is None:
        demanded = None
    elif demanded is None and has_lasted(off_since_s, params.seconds, now):
        found = f"{away_m:.0f} m off its route, expected at most {params.metres:g} m"
        demanded = Demand(DemandKind(params.action), f"{found}, for {params.seconds:g} s")
    elif demanded is None and has_lasted(still_since_s, params.seconds, now):
        mode = facts.vehicle.mode
        demanded = Demand(
            DemandKind(params.action), f"in mode {mode}, and has not moved for {params.seconds:g} s"
        )
    return NotFollowingMemory(way.plan_id, memory.track_m, off_since_s, still_since_s, demanded), demanded
