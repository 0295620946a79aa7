"""Somebody else flies the vehicle: a pilot by radio control, another ground station, or its own failsafe.

A heartbeat tells the mode and not who chose it. Any mode that this agent has not chosen is somebody's will,
and is not fought. So is who puts another mission on it.
"""

from __future__ import annotations

from dataclasses import dataclass

from swarmctl.agent.failsafes.base import Demand, DemandKind, FailsafeFacts, has_lasted, holds_since
from swarmctl.core.section import Section
from swarmctl.core.vehicle import STALE_MODE_S

NAME = "taken_over"

BOOTS_S = 10.0
"""A vehicle on the ground that boots shows the mode it boots in before its clock tells of it: not armed it
harms nobody, and where it is to be launched all the same it is let go."""
SAID_BEFORE_S = 1.5
"""What the vehicle has said may be the reason of a mode that its heartbeat shows so much later, or before."""


class Params(Section):
    """There is nothing to choose: who takes over is let."""


@dataclass(frozen=True, slots=True)
class TakenOverMemory:
    foreign_since_s: float | None = None
    orders: int = 0
    said: str = ""
    said_s: float | None = None
    """when it was first heard to say that; None: before this rule listened"""


def evaluate(
    _params: Params, memory: TakenOverMemory | None, facts: FailsafeFacts, now: float
) -> tuple[TakenOverMemory, Demand | None]:
    vehicle, before = facts.vehicle, memory or TakenOverMemory(said=facts.vehicle.status_text)
    # What was foreign before an order may be what that order leads through.
    since_s = before.foreign_since_s if facts.orders == before.orders else None
    ours = vehicle.mode_role in {"", *facts.ours}
    new = vehicle.status_text != before.said
    memory = TakenOverMemory(
        holds_since(since_s, not ours, now), facts.orders, vehicle.status_text, now if new else before.said_s
    )
    if facts.doing == "ground" and vehicle.armed:
        return memory, Demand(DemandKind.LET_GO, f"armed by somebody else, in mode {vehicle.mode}")
    if facts.lost:
        return memory, None
    if vehicle.other_mission and (demand := _other_mission(facts)) is not None:
        return memory, demand
    if ours:
        return memory, None
    # It may be a mode of ours from before: wait for the next.
    if vehicle.mode_role in ("hold", "mission") and not has_lasted(memory.foreign_since_s, STALE_MODE_S, now):
        return memory, None
    if facts.doing == "ground" and not has_lasted(memory.foreign_since_s, BOOTS_S, now):
        return memory, None
    since_s = now if memory.foreign_since_s is None else memory.foreign_since_s
    recent = memory.said_s is not None and memory.said_s >= since_s - SAID_BEFORE_S
    words = f" (it says: {vehicle.status_text})" if recent else ""
    return memory, Demand(DemandKind.LET_GO, f"in mode {vehicle.mode}, which nobody here has ordered{words}")


def _other_mission(facts: FailsafeFacts) -> Demand | None:
    n_items = facts.vehicle.mission_total or 0
    what = f"another mission is on it, of {n_items} items, which nobody here has put there"
    if facts.doing == "ground":
        return Demand(DemandKind.WARN, f"{what}: it is not launched with that")
    flies_it = facts.doing in ("launch", "mission", "goal") or facts.vehicle.mode_role == "mission"
    return Demand(DemandKind.LET_GO, what) if flies_it else None
