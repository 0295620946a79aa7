"""Somebody else flies the vehicle: a pilot by radio control, another ground station, or its own failsafe.

A heartbeat tells the mode and not who chose it. Any mode that this agent has not chosen is somebody's will,
and is not fought.
"""

from __future__ import annotations

from dataclasses import dataclass

from swarmctl.config_base import Section
from swarmctl.rules.base import Action, Facts, Kind, held_for, lasts

NAME = "taken_over"

STALE_MODE_S = 2.0
"""a mode of ours that was left may show for so long in a heartbeat that was overtaken"""
RECENT_S = 10.0
"""For so long what the vehicle has said last may be the reason of what it does."""


class Params(Section):
    """There is nothing to choose: who takes over is let."""


@dataclass(frozen=True, slots=True)
class Memory:
    foreign_since_s: float | None = None
    orders: int = 0
    said: str = ""
    said_s: float | None = None
    """when it was first heard to say that; None: before this rule listened"""


def judge(_params: Params, memory: Memory | None, facts: Facts, now: float) -> tuple[Memory, Action | None]:
    vehicle, before = facts.vehicle, memory or Memory(said=facts.vehicle.status_text)
    # What was foreign before an order may be what that order leads through.
    since_s = before.foreign_since_s if facts.orders == before.orders else None
    ours = vehicle.mode_role in {"", *facts.ours}
    new = vehicle.status_text != before.said
    memory = Memory(
        held_for(since_s, not ours, now), facts.orders, vehicle.status_text, now if new else before.said_s
    )
    if facts.doing == "ground" and vehicle.armed:
        return memory, Action(Kind.LET_GO, f"armed by somebody else, in mode {vehicle.mode}")
    if ours or facts.lost:
        return memory, None
    # A heartbeat that was overtaken on its way may show a mode of ours from before: wait for the next.
    if vehicle.mode_role in ("hold", "mission") and not lasts(memory.foreign_since_s, STALE_MODE_S, now):
        return memory, None
    recent = memory.said_s is not None and now - memory.said_s <= RECENT_S
    words = f" (it says: {vehicle.status_text})" if recent else ""
    return memory, Action(Kind.LET_GO, f"in mode {vehicle.mode}, which nobody here has ordered{words}")
