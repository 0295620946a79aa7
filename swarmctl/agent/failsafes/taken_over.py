"""Taken over: a pilot, another ground station or the vehicle's own failsafe controls the vehicle.

A heartbeat reports the mode, but not the cause of a mode change. The agent releases a vehicle in a mode that
the agent did not select, and a vehicle that flies another station's mission.
"""

from __future__ import annotations

import msgspec

from swarmctl.agent.failsafes.base import Demand, DemandKind, FailsafeFacts, has_lasted, true_since
from swarmctl.core.section import Section
from swarmctl.core.vehicle import STALE_MODE_S

NAME = "taken_over"

FOREIGN_ON_GROUND_S = 10.0
"""Longest time on the ground in a foreign mode without a release [s]. A rebooting vehicle reports its boot
mode before its clock shows the reboot. A launch order in a foreign mode releases the vehicle at once."""
TEXT_BEFORE_S = 1.5
"""Greatest time from a status text to the mode that the text explains [s]."""


class Params(Section):
    """No parameters."""


class TakenOverMemory(msgspec.Struct, frozen=True):
    foreign_since_s: float | None = None
    orders_given: int = 0
    text: str = ""
    """last status text of the vehicle"""
    text_s: float | None = None
    """time of receipt of `text`; None: received before the first evaluation"""


def evaluate(
    _params: Params, memory: TakenOverMemory | None, facts: FailsafeFacts, now: float
) -> tuple[TakenOverMemory, Demand | None]:
    vehicle, before = facts.vehicle, memory or TakenOverMemory(text=facts.vehicle.status_text)
    if facts.telemetry_is_late:
        return before, None  # the mode may be from before this agent's last order
    # After an order, a foreign mode may be an intermediate mode of that order.
    since_s = before.foreign_since_s if facts.orders_given == before.orders_given else None
    is_own = vehicle.mode_role in {"", *facts.own_roles}
    is_new_text = vehicle.status_text != before.text
    memory = TakenOverMemory(
        true_since(since_s, not is_own, now),
        facts.orders_given,
        vehicle.status_text,
        now if is_new_text else before.text_s,
    )
    if facts.activity == "ground" and vehicle.armed:
        return memory, Demand(
            DemandKind.RELEASE, f"another operator has armed the vehicle, in mode {vehicle.mode}"
        )
    if facts.lost:
        return memory, None
    if vehicle.other_mission and (demand := _other_mission(facts)) is not None:
        return memory, demand
    # A disarmed vehicle has ended its flight, or rebooted; no operator has chosen its boot mode.
    if is_own or not (vehicle.armed or facts.activity in ("ground", "launch")):
        return memory, None
    # The mode may be an outdated report of a mode that this agent set: wait for the next heartbeat.
    may_be_old = vehicle.mode_role in ("hold", "mission", "setpoints")
    if may_be_old and not has_lasted(memory.foreign_since_s, STALE_MODE_S, now):
        return memory, None
    if facts.activity == "ground" and not has_lasted(memory.foreign_since_s, FOREIGN_ON_GROUND_S, now):
        return memory, None
    since_s = now if memory.foreign_since_s is None else memory.foreign_since_s
    is_recent = memory.text_s is not None and memory.text_s >= since_s - TEXT_BEFORE_S
    text = f" (vehicle reports: {vehicle.status_text})" if is_recent else ""
    return memory, Demand(
        DemandKind.RELEASE, f"the vehicle is in mode {vehicle.mode}, which this program has not ordered{text}"
    )


def _other_mission(facts: FailsafeFacts) -> Demand | None:
    n_items = facts.vehicle.mission_total or 0
    text = f"the vehicle has a mission of {n_items} items that this program has not uploaded"
    if facts.activity == "ground":
        return Demand(DemandKind.WARN, f"{text}; this program does not launch the vehicle with that mission")
    flies_it = facts.activity in ("launch", "mission", "goal") or facts.vehicle.mode_role == "mission"
    return Demand(DemandKind.RELEASE, text) if flies_it else None
