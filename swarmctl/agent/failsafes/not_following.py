"""Not following: a vehicle that should fly its route is off the route, or does not move."""

from __future__ import annotations

from typing import Literal

import msgspec
from pydantic import Field

from swarmctl.agent.failsafes.base import Demand, DemandKind, FailsafeFacts, has_lasted, true_since
from swarmctl.core.planar import PlanarPoint, distance_to_track
from swarmctl.core.section import Section

NAME = "not_following"
DESCRIPTION = "Not following: a vehicle in mission mode leaves its route or stops."

MAX_STILL_M_S = 0.5
"""Ground speed below which a vehicle may count as not moving [m/s]."""
MAX_STILL_CLIMB_M_S = 0.2
"""Climb or sink rate below which a vehicle may count as not moving [m/s]."""


class Params(Section):
    """Limits of the rule and its demand."""

    metres: float = Field(60.0, gt=0.0, description="greatest distance of the vehicle from its route [m]")
    seconds: float = Field(
        15.0, gt=0.0, description="time off the route, or without moving, until the reaction [s]"
    )
    action: Literal["warn", "hold", "return", "land"] = Field("return", description="reaction")


class NotFollowingMemory(msgspec.Struct, frozen=True):
    plan_id: int
    track_m: tuple[PlanarPoint, ...]
    """(east, north) [m], from the vehicle's position when the rule first saw this plan"""
    off_since_s: float | None = None
    still_since_s: float | None = None
    demanded: Demand | None = None


def evaluate(
    params: Params, memory: NotFollowingMemory | None, facts: FailsafeFacts, now: float
) -> tuple[NotFollowingMemory | None, Demand | None]:
    here, mission = facts.position_m, facts.mission
    if facts.activity != "mission":
        return None, None
    if mission is None or here is None or facts.lost:
        # If data are missing, all durations restart, and a demand stays.
        kept = None if memory is None else memory.demanded
        return memory and NotFollowingMemory(memory.plan_id, memory.track_m, demanded=kept), kept
    if memory is None or memory.plan_id != mission.plan_id:
        memory = NotFollowingMemory(mission.plan_id, (here, *facts.track_m()))
    away_m = distance_to_track(here, memory.track_m)
    is_still = (
        facts.vehicle.ground_speed_m_s < MAX_STILL_M_S and abs(facts.vehicle.climb_m_s) < MAX_STILL_CLIMB_M_S
    )
    off_since_s = true_since(memory.off_since_s, away_m > params.metres, now)
    still_since_s = true_since(memory.still_since_s, is_still, now)
    demanded = memory.demanded
    if off_since_s is None and still_since_s is None:
        demanded = None
    elif demanded is None and has_lasted(off_since_s, params.seconds, now):
        found = f"the vehicle was more than {params.metres:g} m off its route for {params.seconds:g} s"
        demanded = Demand(DemandKind(params.action), f"{found} ({away_m:.0f} m at the end)")
    elif demanded is None and has_lasted(still_since_s, params.seconds, now):
        mode = facts.vehicle.mode
        demanded = Demand(
            DemandKind(params.action), f"the vehicle has not moved for {params.seconds:g} s in mode {mode}"
        )
    return NotFollowingMemory(mission.plan_id, memory.track_m, off_since_s, still_since_s, demanded), demanded
