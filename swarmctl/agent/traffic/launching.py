"""The launch: who would meet somebody in the air on its first route waits for that on the ground. Pure.

The way is looked at when the launch is ordered, and again right before it is armed and right before it takes
off, because the checks of what it is and whether it is fit come in between and take their time.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from swarmctl.agent.orders import StepResult, command, release_vehicle
from swarmctl.agent.own_modes import own_mode_roles
from swarmctl.agent.replan.copter_trajectory import from_takeoff
from swarmctl.agent.state import AgentState, Phase
from swarmctl.agent.traffic.intents import publish_intent, to_shared_frame
from swarmctl.agent.traffic.route_deconfliction import clashes_with, known_intents
from swarmctl.agent.traffic.separation.clash import Clash, describe_clashes
from swarmctl.agent.traffic.separation.trajectory import until_landing
from swarmctl.agent.traffic.separation.watch import NeighbourIntent
from swarmctl.core import events as ev

MAX_LAUNCH_WAIT_S = 180.0
"""Then it is not launched."""
STARTS_AFTER_S = (-2.0, 0.0, 2.0, 4.0)
"""To arm takes some seconds, and to climb some less or more than reckoned: all that time the way has to be
clear, or it would have to give way as soon as it is up."""


def launch_if_possible(state: AgentState) -> StepResult:
    """With each order to launch, each plan and, while it waits, each word of the vehicle."""
    if not (state.phase is Phase.STANDBY and state.launch_ordered and state.pending is None):
        return state, []
    if state.vehicle.mode_role not in {"", *own_mode_roles(state)}:
        # Somebody has it, or it boots: neither is launched.
        return release_vehicle(state, f"in mode {state.vehicle.mode}, which nobody here has ordered")
    if met := _met(state, _waited_for(state)):
        return _waits(state, _in_words(state, met))
    told: list[ev.Effect] = []
    if state.launch_wait_since_boot_s is not None:
        told.append(ev.NotifyOperator("clear of the others: it launches"))
    if state.launch_ignored and (past := _met(state, known_intents(state))):
        told.append(ev.NotifyOperator(f"{_in_words(state, past)}: it launches all the same, as ordered"))
    state, ordered = command(state, ev.FlightOrder.LAUNCH, phase=Phase.LAUNCHING, trouble="")
    return state, [*told, *ordered]


def launch_conflict(state: AgentState) -> str:
    """Who is, in words, now that it is about to be armed or to take off; empty where nobody is.

    Who is about to take off itself is let be: both were ordered at one moment, and if each waited for the
    other neither would fly.
    """
    others = {uav: told for uav, told in _waited_for(state).items() if not told.on_ground}
    met = _met(state, others)
    return _in_words(state, met) if met else ""


def launch_put_off(state: AgentState, event: ev.LaunchPostponed, _now: float) -> StepResult:
    """It stands on the ground, not armed, and waits as before. One order arms it once: what was armed is not
    armed again by itself."""
    if state.phase is not Phase.LAUNCHING or state.ordered is not ev.FlightOrder.LAUNCH:
        return state, []
    if event.was_armed:
        return cancel_launch(state, f"{event.reason}; it is disarmed again")
    state, unsaid = _stands_by(state)
    state, waits = _waits(state, event.reason, again=True)
    return state, [*unsaid, *waits]


def note_takeoff(state: AgentState) -> AgentState:
    """It is in the air, which the others are to know at once."""
    return replace(
        state,
        phase=Phase.FLYING,
        launch_wait_since_boot_s=None,
        launch_ignored=frozenset(),
        intent_sent_boot_s=-math.inf,
    )


def cancel_launch(state: AgentState, why: str) -> StepResult:
    """It is not armed. Who was ordered by an operator stands by for another order."""
    state, unsaid = _stands_by(state)
    state = replace(
        state, launch_ordered=False, launch_wait_since_boot_s=None, trouble=f"not launched: {why}"
    )
    if not state.launch_is_operators:
        return replace(state, phase=Phase.FAILED, outcome=state.trouble), unsaid
    return state, [*unsaid, ev.NotifyOperator(f"{state.trouble}; it stands by for another order")]


def _stands_by(state: AgentState) -> StepResult:
    """The others, if they were told of its flight, hear that there is none."""
    state = replace(state, phase=Phase.STANDBY, armed_seen=False, launched_boot_s=None)
    return (state, []) if state.own_intent is None else publish_intent(state, None)


def _waited_for(state: AgentState) -> dict[int, NeighbourIntent]:
    """What those have told of late of where they will be for whom it would wait."""
    return {uav: told for uav, told in known_intents(state).items() if uav not in state.launch_ignored}


def _met(state: AgentState, others: Mapping[int, NeighbourIntent]) -> tuple[Clash, ...]:
    """Whom of them its first route would meet, if it took off now or a little later."""
    start, route = state.vehicle.takeoff_lat_lon, state.route
    if start is None or route is None or not others:
        return ()
    flight = to_shared_frame(state, from_takeoff(state.task, route.plan, start))
    if flight is None:
        return ()
    flight, limits = until_landing(flight), state.task.separation.limits
    return next((met for s in STARTS_AFTER_S if (met := clashes_with(flight.later(s), others, limits))), ())


def _in_words(state: AgentState, met: tuple[Clash, ...]) -> str:
    return f"its first route would meet {describe_clashes(met, state.vehicle.time_boot_s)}"


def _waits(state: AgentState, why: str, *, again: bool = False) -> StepResult:
    """All its waiting for one launch is one time, however often it was about to take off in between."""
    now_s, since_s = state.vehicle.time_boot_s, state.launch_wait_since_boot_s
    begins = since_s is None or now_s < since_s
    since_s = now_s if since_s is None or begins else since_s
    left_s = MAX_LAUNCH_WAIT_S - (now_s - since_s)
    if left_s <= 0.0:
        return cancel_launch(state, f"{why}, and has for {MAX_LAUNCH_WAIT_S:.0f} s{_how_not_to_wait(state)}")
    text = f"{why}: it waits on the ground, for {left_s:.0f} s at most{_how_not_to_wait(state)}"
    state = replace(state, launch_wait_since_boot_s=since_s, trouble=text)
    return state, [ev.NotifyOperator(text)] if begins or again else []


def _how_not_to_wait(state: AgentState) -> str:
    """For the operator who has ordered it."""
    met = _met(state, _waited_for(state)) if state.launch_is_operators else ()
    past = " ".join(
        f"--past {uav}" for uav in sorted({*state.launch_ignored, *(clash.other for clash in met)})
    )
    return f" (`order launch --uav {state.task.uav} {past}` does not wait)" if met else ""
