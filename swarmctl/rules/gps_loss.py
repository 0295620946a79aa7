"""A vehicle without a GPS fix soon no longer knows where it is.

Its autopilot knows first, and mostly acts by itself; it is then let go (`taken_over`). Until then the
operator is told. Without a position it can neither hold nor fly home: if it does nothing by itself, it lands.
"""

from __future__ import annotations

from dataclasses import dataclass

from pydantic import Field

from swarmctl.config_base import Section
from swarmctl.rules.base import Action, Facts, Kind, held_for, lasts

NAME = "gps_loss"


class Params(Section):
    """By the health of its GPS, as SYS_STATUS tells it once a second."""

    seconds: float = Field(2.0, ge=0.0, description="without a fix until it is said [s]")
    land_s: float = Field(20.0, gt=0.0, description="until it lands, if it does nothing by itself [s]")


@dataclass(frozen=True, slots=True)
class Memory:
    since_s: float | None = None
    landing: bool = False
    """A fix that comes back stops no landing: it may go again."""


def judge(params: Params, memory: Memory | None, facts: Facts, now: float) -> tuple[Memory, Action | None]:
    memory = memory or Memory()
    if facts.lost:
        # What was told before is old: neither count nor take back.
        return Memory(None, memory.landing), None
    missing = facts.in_flight and facts.vehicle.gps_ok is False
    since_s = held_for(memory.since_s, missing, now)
    landing = facts.in_flight and (memory.landing or lasts(since_s, params.land_s, now))
    memory = Memory(since_s, landing)
    if landing:
        return memory, Action(Kind.LAND, f"no GPS fix for {params.land_s:g} s, and it does nothing by itself")
    if lasts(since_s, params.seconds, now):
        return memory, Action(Kind.WARN, "no GPS fix; what it does now is its autopilot's to decide")
    return memory, None
