"""The launch: who would meet somebody in the air on its first route waits for that on the ground. Pure.

The way is looked at when the launch is ordered, and again right before it is armed and right before it takes
off, because the checks of what it is and whether it is fit come in between and take their time.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from swarmctl.agent.orders import Step, command, let_go
from swarmctl.agent.own_modes import roles_of_ours
from swarmctl.agent.replan.flight_path import from_takeoff
from swarmctl.agent.state import AgentState, Phase
from swarmctl.agent.traffic.intents import from_now, say
from swarmctl.agent.traffic.route_deconfliction import clashing, known
from swarmctl.agent.traffic.separation.clash import Clash, in_words
from swarmctl.agent.traffic.separation.trajectory import to_its_landing
from swarmctl.agent.traffic.separation.watch import Intended
from swarmctl.core import events as ev

WAITS_FOR_S = 180.0
"""Then it is not launched."""
STARTS_AFTER_S = (-2.0, 0.0, 2.0, 4.0)
"""To arm takes some seconds, and to climb some less or more than reckoned: all that time the way has to be
clear, or it would have to give way as soon as it is up."""


def launch_if_possible(state: AgentState) -> Step:
    """With each order to launch, each plan and, while it waits, each word of the vehicle."""
    if not (state.phase is Phase.STANDBY and state.launch_ordered and state.pending is None):
        return state, []
    if state.vehicle.mode_role not in {"", *roles_of_ours(state)}:
        # Somebody has it, or it boots: neither is launched.
        return let_go(state, f"in mode {state.vehicle.mode}, which nobody here has ordered")
    if met := _met(state, _waited_for(state)):
        return _waits(state, _in_words(state, met))
    told: list[ev.Effect] = []
    if state.launch_waits_boot_s is not None:
        told.append(ev.Tell("clear of the others: it launches"))
    if state.launch_past and (past := _met(state, known(state))):
        told.append(ev.Tell(f"{_in_words(state, past)}: it launches all the same, as ordered"))
    state, launched = command(state, ev.Order.LAUNCH, phase=Phase.LAUNCHING, trouble="")
    return state, [*told, *launched]


def in_the_way(state: AgentState) -> str:
    """Who is, in words, now that it is about to be armed or to take off; empty where nobody is.

    Who is about to take off itself is let be: both were ordered at one moment, and if each waited for the
    other neither would fly.
    """
    others = {uav: told for uav, told in _waited_for(state).items() if not told.on_ground}
    met = _met(state, others)
    return _in_words(state, met) if met else ""


def put_off(state: AgentState, event: ev.LaunchPutOff, _now: float) -> Step:
    """It stands on the ground, not armed, and waits as before. One order arms it once: what was armed is not
    armed again by itself."""
    if state.phase is not Phase.LAUNCHING or state.ordered is not ev.Order.LAUNCH:
        return state, []
    if event.was_armed:
        return not_launched(state, f"{event.reason}; it is disarmed again")
    state, unsaid = _stands_by(state)
    state, waits = _waits(state, event.reason, again=True)
    return state, [*unsaid, *waits]


def launched(state: AgentState) -> AgentState:
    """It is in the air, which the others are to know at once."""
    return replace(
        state,
        phase=Phase.FLYING,
        launch_waits_boot_s=None,
        launch_past=frozenset(),
        intent_said_s=-math.inf,
    )


def not_launched(state: AgentState, why: str) -> Step:
    """It is not armed. Who was ordered by an operator stands by for another order."""
    state, unsaid = _stands_by(state)
    state = replace(state, launch_ordered=False, launch_waits_boot_s=None, trouble=f"not launched: {why}")
    if not state.launch_is_operators:
        return replace(state, phase=Phase.FAILED, outcome=state.trouble), unsaid
    return state, [*unsaid, ev.Tell(f"{state.trouble}; it stands by for another order")]


def _stands_by(state: AgentState) -> Step:
    """The others, if they were told of its flight, hear that there is none."""
    state = replace(state, phase=Phase.STANDBY, armed_seen=False, launched_boot_s=None)
    return (state, []) if state.own_intent is None else say(state, None)


def _waited_for(state: AgentState) -> dict[int, Intended]:
    """What those have told of late of where they will be for whom it would wait."""
    return {uav: told for uav, told in known(state).items() if uav not in state.launch_past}


def _met(state: AgentState, others: Mapping[int, Intended]) -> tuple[Clash, ...]:
    """Whom of them its first route would meet, if it took off now or a little later."""
    start, route = state.vehicle.takeoff_lat_lon, state.route
    if start is None or route is None or not others:
        return ()
    flight = from_now(state, from_takeoff(state.task, route.plan, start))
    if flight is None:
        return ()
    flight, limits = to_its_landing(flight), state.task.separation.limits
    return next((met for s in STARTS_AFTER_S if (met := clashing(flight.later(s), others, limits))), ())


def _in_words(state: AgentState, met: tuple[Clash, ...]) -> str:
    return f"its first route would meet {in_words(met, state.vehicle.time_boot_s)}"


def _waits(state: AgentState, why: str, *, again: bool = False) -> Step:
    """All its waiting for one launch is one time, however often it was about to take off in between."""
    now_s, since_s = state.vehicle.time_boot_s, state.launch_waits_boot_s
    begins = since_s is None or now_s < since_s
    since_s = now_s if since_s is None or begins else since_s
    left_s = WAITS_FOR_S - (now_s - since_s)
    if left_s <= 0.0:
        return not_launched(state, f"{why}, and has for {WAITS_FOR_S:.0f} s{_how_not_to_wait(state)}")
    text = f"{why}: it waits on the ground, for {left_s:.0f} s at most{_how_not_to_wait(state)}"
    state = replace(state, launch_waits_boot_s=since_s, trouble=text)
    return state, [ev.Tell(text)] if begins or again else []


def _how_not_to_wait(state: AgentState) -> str:
    """For the operator who has ordered it."""
    met = _met(state, _waited_for(state)) if state.launch_is_operators else ()
    past = " ".join(f"--past {uav}" for uav in sorted({*state.launch_past, *(clash.other for clash in met)}))
    return f" (`order launch --uav {state.task.uav} {past}` does not wait)" if met else ""
