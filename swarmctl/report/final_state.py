"""The final state of each vehicle in words, and the end of a flight."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Protocol

from swarmctl.agent.own_modes import ROLE_OF_ORDER
from swarmctl.agent.phases import Phase
from swarmctl.agent.state import ARRIVED, AgentState
from swarmctl.agent.touchdown import may_be_armed
from swarmctl.core.vehicle import Landed, VehicleState

HEARTBEATS_END = "heartbeats end now, which may trigger the GCS failsafe"


class Link(Protocol):
    """The received state of a vehicle and its age."""

    def state(self) -> VehicleState: ...
    def age_s(self) -> float: ...


class Linked(Protocol):
    @property
    def link(self) -> Link: ...


class Vehicle(Protocol):
    @property
    def name(self) -> str: ...
    @property
    def state(self) -> AgentState: ...
    @property
    def runner(self) -> Linked: ...
    def silent_for(self, limit_s: float) -> bool: ...


def is_released_in_air(state: AgentState) -> bool:
    """Return whether the agent gives no more orders to a vehicle that may be armed."""
    return state.ended and may_be_armed(state)


def _has_ended_disarmed(state: AgentState) -> bool:
    return state.ended and not may_be_armed(state)


def is_lost_in_air(state: AgentState) -> bool:
    """Return whether the link is lost and the vehicle may have been armed at its last telemetry."""
    return state.lost and may_be_armed(state)


def final_phase(state: AgentState) -> str:
    """Return the vehicle's phase, or "lost" for a vehicle that is lost in flight."""
    return "lost" if is_lost_in_air(state) and not state.ended else str(state.phase)


def describe_outcome(state: AgentState) -> str:
    """Return the outcome as text, with the last mode of a released vehicle, and "lost" for a lost vehicle.

    The text names an order that the vehicle has never acknowledged or followed.
    """
    outcome = state.outcome or str(state.phase)
    if is_unacknowledged(state):
        outcome = (
            f"{outcome}; the vehicle never acknowledged the order ({state.order.given}) [not-acknowledged]"
        )
    mode = state.vehicle.mode or "unknown"
    if state.phase is Phase.RELEASED and f"in mode {mode}," not in outcome:
        outcome = f"{outcome}; last in mode {mode}"
    if not state.lost or _has_ended_disarmed(state):
        return outcome
    return f"lost; {outcome}" if state.outcome else f"lost; last in mode {mode}"


def is_unacknowledged(state: AgentState) -> bool:
    """Return whether the last order to hold, return or land had no acknowledgement and no effect."""
    is_ordered = state.order.given in ROLE_OF_ORDER and not state.order.is_followed
    return is_ordered and state.phase is not Phase.RELEASED and state.outcome != ARRIVED


def describe_final_state(member: Vehicle) -> str:
    """Return a line with the final state of a vehicle, so that an operator can recover the vehicle."""
    state, vehicle = member.state, member.runner.link.state()
    age_s = member.runner.link.age_s()
    if age_s == math.inf:
        return f"{member.name}: no telemetry received"
    if state.lost and not _has_ended_disarmed(state):
        where = _height(vehicle) if may_be_armed(state) else "on the ground, disarmed"
        text = f"{member.name}: lost, last telemetry {age_s:.0f} s ago in mode {vehicle.mode or '?'}, {where}"
        return f"{text}; the vehicle may still be in the air [lost-in-air]" if may_be_armed(state) else text
    if state.ended and not vehicle.armed and state.outcome:
        return f"{member.name}: {describe_outcome(state)}{_landed_note(state)}"
    if not vehicle.armed:
        return f"{member.name}: on the ground, disarmed"
    how = state.outcome or state.trouble or str(state.phase)
    if is_unacknowledged(state):
        how = f"{how}, not confirmed by telemetry"
    mode = vehicle.mode or "?"
    if vehicle.landed is Landed.ON_GROUND:
        return f"{member.name}: armed on the ground, mode {mode} ({how})"
    return f"{member.name}: in the air, {_height(vehicle)}, mode {mode} ({how}); {HEARTBEATS_END} [in-air]"


def _landed_note(state: AgentState) -> str:
    return "; on the ground, disarmed" if state.phase is Phase.RELEASED and state.launch.armed_seen else ""


def _height(vehicle: VehicleState) -> str:
    return "at unknown height" if vehicle.alt_rel_m is None else f"{vehicle.alt_rel_m:.0f} m above home"


class FlightEnd:
    """The condition for the end of a flight, with messages about lost and released vehicles."""

    def __init__(self, members: Sequence[Vehicle], lost_timeout_s: float, say: Callable[[str], None]) -> None:
        self._members = members
        self._lost_timeout_s = lost_timeout_s
        self._say = say
        self._given_up: set[str] = set()
        self._waits_for: list[str] = []

    def reached(self) -> bool:
        """Return whether every vehicle has ended its flight and is disarmed, or is given up.

        A released vehicle in the air delays the end: its failsafe needs the heartbeats of this station, and
        its pilot may use the forwarded link.
        """
        unfinished: list[str] = []
        released: list[str] = []
        for member in self._members:
            if _has_ended_disarmed(member.state):
                continue
            if member.silent_for(self._lost_timeout_s):
                self._give_up(member)
                continue
            self._given_up.discard(member.name)
            (released if member.state.ended else unfinished).append(member.name)
        if not unfinished and released and released != self._waits_for:
            self._waits_for = released
            self._say(
                f"{', '.join(released)}: flown by a pilot or another station; the program sends heartbeats "
                "and records, but gives no orders, until the landing and disarming; Ctrl-C ends the wait "
                "[waiting-for-released]"
            )
        return not unfinished and not released

    def _give_up(self, member: Vehicle) -> None:
        if member.name in self._given_up:
            return
        self._given_up.add(member.name)
        vehicle = member.runner.link.state()
        self._say(
            f"{member.name}: no telemetry for {self._lost_timeout_s:g} s (flight.lost_timeout_s); last in "
            f"mode {vehicle.mode or '?'}, {_height(vehicle)}; the program no longer waits for the vehicle, "
            "which may still be in the air; look for the vehicle with another ground station [given-up]"
        )
