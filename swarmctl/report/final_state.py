"""Whether a vehicle may still be in the air when its flight is over, and how each was left, in words."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Protocol

from swarmctl.agent.state import AgentState, Phase
from swarmctl.agent.touchdown import is_up
from swarmctl.core.vehicle import Landed, VehicleState

ON_ITS_OWN = "our heartbeats to it end, and its own failsafe may act on that"


class Link(Protocol):
    """What is heard of a vehicle."""

    def state(self) -> VehicleState: ...
    def age_s(self) -> float: ...


class Linked(Protocol):
    @property
    def link(self) -> Link: ...


class Vehicle(Protocol):
    """A vehicle of this process."""

    @property
    def name(self) -> str: ...
    @property
    def state(self) -> AgentState: ...
    @property
    def runner(self) -> Linked: ...
    def silent_for(self, limit_s: float) -> bool: ...


def is_theirs(state: AgentState) -> bool:
    """Its flight is over for us, and it may be in the air: somebody else flies it."""
    return state.ended and is_up(state)


def _is_over(state: AgentState) -> bool:
    """Its flight is, and it is down."""
    return state.ended and not is_up(state)


def is_lost_in_air(state: AgentState) -> bool:
    """Nothing is heard of it any more, and when it was it was up, as far as is known."""
    return state.lost and is_up(state)


def standing(state: AgentState) -> str:
    """Its phase, or that it is lost: what it did when it was heard last it need not do now."""
    return "lost" if is_lost_in_air(state) and not state.ended else str(state.phase)


def ended_how(state: AgentState) -> str:
    """Its outcome; where it was let go with the mode it has shown last, where it is lost with that."""
    said = state.outcome or str(state.phase)
    mode = state.vehicle.mode or "unknown"
    if state.phase is Phase.RELEASED and f"in mode {mode}," not in said:
        said = f"{said}; last in mode {mode}"
    if not state.lost or _is_over(state):
        return said
    return f"lost; {said}" if state.outcome else f"lost in mode {mode}"


def left_how(member: Vehicle) -> str:
    """How a vehicle was left, for whoever has to fetch it."""
    state, vehicle = member.state, member.runner.link.state()
    age_s = member.runner.link.age_s()
    if age_s == math.inf:
        return f"{member.name}: never heard"
    if state.lost and not _is_over(state):
        where = _height(vehicle) if is_up(state) else "on the ground, disarmed"
        text = f"{member.name}: lost, last heard {age_s:.0f} s ago in mode {vehicle.mode or '?'}, {where}"
        return f"{text}: it may still be in the air" if is_up(state) else text
    if state.ended and not vehicle.armed and state.outcome:
        return f"{member.name}: {ended_how(state)}{_down(state)}"
    if not vehicle.armed:
        return f"{member.name}: on the ground, disarmed"
    how = state.outcome or state.trouble or str(state.phase)
    if state.phase in (Phase.HOLDING, Phase.LEAVING) and not state.order_seen:
        how = f"{how}, not seen to follow"
    mode = vehicle.mode or "?"
    if vehicle.landed is Landed.ON_GROUND:
        return f"{member.name}: armed on the ground, mode {mode} ({how})"
    return f"{member.name}: in the air, {_height(vehicle)}, mode {mode} ({how}); {ON_ITS_OWN}"


def _down(state: AgentState) -> str:
    return ", landed and disarmed" if state.phase is Phase.RELEASED and state.armed_seen else ""


def _height(vehicle: VehicleState) -> str:
    return "at unknown height" if vehicle.alt_rel_m is None else f"{vehicle.alt_rel_m:.0f} m above home"


class Seen:
    """Looks at the vehicles of a flight that have launched: says once what keeps it from its end, and of each
    when it is given up."""

    def __init__(self, members: Sequence[Vehicle], lost_timeout_s: float, say: Callable[[str], None]) -> None:
        self._members = members
        self._lost_timeout_s = lost_timeout_s
        self._say = say
        self._given_up: set[str] = set()
        self._stays_for: list[str] = []

    def all_over(self) -> bool:
        """No vehicle is ours to fly any more, and none that somebody else has is in the air, as far as is
        heard: who flies it needs our heartbeat, which its failsafe goes by, and the link."""
        flown: list[str] = []
        theirs: list[str] = []
        for member in self._members:
            if _is_over(member.state):
                continue
            if member.silent_for(self._lost_timeout_s):
                self._give_up(member)
                continue
            self._given_up.discard(member.name)
            (theirs if member.state.ended else flown).append(member.name)
        if not flown and theirs and theirs != self._stays_for:
            self._stays_for = theirs
            self._say(
                f"all else is over; {', '.join(theirs)}: in somebody else's hands and armed, so link, "
                "heartbeats and record go on, without orders, until it has landed and is disarmed (Ctrl-C "
                "ends them)"
            )
        return not flown and not theirs

    def _give_up(self, member: Vehicle) -> None:
        if member.name in self._given_up:
            return
        self._given_up.add(member.name)
        vehicle = member.runner.link.state()
        self._say(
            f"{member.name}: given up, nothing heard of it for {self._lost_timeout_s:g} s "
            f"(flight.lost_timeout_s); last in mode {vehicle.mode or '?'}, {_height(vehicle)}; it may still "
            "be in the air"
        )
