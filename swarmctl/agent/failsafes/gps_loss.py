"""A vehicle without a GPS fix soon no longer knows where it is.

Its autopilot knows first, and mostly acts by itself; it is then let go (`taken_over`). Until then the
operator is told. Without a position it can neither hold nor fly home: if it does nothing by itself, it lands.

One that tells no position any more may know it all the same, as long as its receiver has a fix: nobody here
sees where it flies, so it returns, and lands where it does not follow that.
"""

from __future__ import annotations

from dataclasses import dataclass

from pydantic import Field

from swarmctl.agent.failsafes.base import Demand, DemandKind, FailsafeFacts, holds_since
from swarmctl.core.section import Section

NAME = "gps_loss"


class Params(Section):
    """By the health of its GPS, as SYS_STATUS tells it once a second, and the age of its position."""

    seconds: float = Field(2.0, ge=0.0, description="without a fix or a position until it is said [s]")
    land_s: float = Field(20.0, gt=0.0, description="until it lands, if it does nothing by itself [s]")


@dataclass(frozen=True, slots=True)
class GpsLossMemory:
    since_s: float | None = None
    """the first SYS_STATUS of those that tell of no fix"""
    blind_since_s: float | None = None
    """it has been heard since without a position"""
    landing: Demand | None = None
    """A fix that comes back stops no landing: it may go again."""


def evaluate(
    params: Params, memory: GpsLossMemory | None, facts: FailsafeFacts, now: float
) -> tuple[GpsLossMemory, Demand | None]:
    memory, vehicle = memory or GpsLossMemory(), facts.vehicle
    if not facts.in_flight:
        return GpsLossMemory(), None
    if facts.lost:
        # What was told before is old: neither count nor take back.
        return GpsLossMemory(landing=memory.landing), None
    told_s = vehicle.status_s
    since_s = None if told_s is None else holds_since(memory.since_s, vehicle.gps_ok is False, told_s)
    # What lasts, lasts from one SYS_STATUS to a later one: an old one tells nothing new.
    no_fix_s = None if since_s is None or told_s is None else told_s - since_s
    blind_since_s = holds_since(memory.blind_since_s, not vehicle.has_position, now)
    blind_s = None if blind_since_s is None else now - blind_since_s
    demand = memory.landing or _demand(params, facts, no_fix_s, blind_s)
    landing = demand if demand is not None and demand.kind is DemandKind.LAND else None
    return GpsLossMemory(since_s, blind_since_s, landing), demand


def _demand(
    params: Params, facts: FailsafeFacts, no_fix_s: float | None, blind_s: float | None
) -> Demand | None:
    """For how long it has told of no fix, and of no position; None where it has not."""
    if no_fix_s is not None and no_fix_s >= params.land_s:
        return Demand(DemandKind.LAND, f"no GPS fix for {params.land_s:g} s, and it does nothing by itself")
    if blind_s is not None and blind_s >= params.land_s:
        return _down_or_home(params, facts, blind_s)
    if no_fix_s is not None and no_fix_s >= params.seconds:
        return Demand(DemandKind.WARN, "no GPS fix; what it does now is its autopilot's to decide")
    if blind_s is not None and blind_s >= params.seconds:
        return Demand(DemandKind.WARN, "it tells no position any more")
    return None


def _down_or_home(params: Params, facts: FailsafeFacts, blind_s: float) -> Demand:
    text = f"no position for {params.land_s:g} s"
    if facts.vehicle.gps_ok is not True:
        return Demand(DemandKind.LAND, f"{text}, and it does nothing by itself")
    if blind_s >= 2.0 * params.land_s and facts.vehicle.mode_role != "return":
        return Demand(DemandKind.LAND, f"{text} and more, and it does not return")
    return Demand(DemandKind.RETURN, f"{text}, though its GPS has a fix: where it flies is not known here")
