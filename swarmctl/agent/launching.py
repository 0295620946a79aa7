"""The launch: who would meet somebody in the air on its first route waits for that on the ground. Pure."""

from __future__ import annotations

from dataclasses import replace

from swarmctl.agent.clearing import clashing, known
from swarmctl.agent.flight_path import from_takeoff
from swarmctl.agent.intents import from_now
from swarmctl.agent.orders import Step, command, let_go
from swarmctl.agent.ours import roles_of_ours
from swarmctl.agent.state import AgentState, Phase
from swarmctl.core import events as ev
from swarmctl.separation import to_its_landing
from swarmctl.separation.clash import Clash, in_words

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
    met, waited = _met(state), state.launch_waits_boot_s is not None
    if met:
        return _waits(state, met)
    state, launched = command(state, ev.Order.LAUNCH, phase=Phase.LAUNCHING, launch_waits_boot_s=None)
    if not waited:
        return state, launched
    return replace(state, trouble=""), [ev.Tell("clear of the others: it launches"), *launched]


def not_launched(state: AgentState, why: str) -> Step:
    """Nothing of its launch was sent. Who was ordered by an operator stands by for another order."""
    state = replace(state, launch_ordered=False, launch_waits_boot_s=None, trouble=f"not launched: {why}")
    if not state.launch_is_operators:
        return replace(state, phase=Phase.FAILED, outcome=state.trouble), []
    state = replace(state, phase=Phase.STANDBY)
    return state, [ev.Tell(f"{state.trouble}; it stands by for another order")]


def _met(state: AgentState) -> tuple[Clash, ...]:
    """Whom its first route would meet of those in the air, if it took off now or a little later."""
    start, route = state.vehicle.takeoff_lat_lon, state.route
    if start is None or route is None or not state.intents:
        return ()
    flight = from_now(state, from_takeoff(state.task, route.plan, start))
    if flight is None:
        return ()
    flight, others, limits = to_its_landing(flight), known(state), state.task.separation.limits
    return next((met for s in STARTS_AFTER_S if (met := clashing(flight.later(s), others, limits))), ())


def _waits(state: AgentState, met: tuple[Clash, ...]) -> Step:
    now_s, since_s = state.vehicle.time_boot_s, state.launch_waits_boot_s
    why = f"its first route would meet {in_words(met, now_s)}"
    if since_s is None or now_s < since_s:
        text = f"{why}: it waits on the ground, for {WAITS_FOR_S:.0f} s at most"
        return replace(state, launch_waits_boot_s=now_s, trouble=text), [ev.Tell(text)]
    if now_s - since_s < WAITS_FOR_S:
        return state, []
    return not_launched(state, f"{why}, and has for {WAITS_FOR_S:.0f} s")
