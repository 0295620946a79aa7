"""Launch: a vehicle waits on the ground while its first route conflicts with another vehicle's flight. Pure.

The first route is checked three times, because mode changes and arming take some seconds.

| check | reaction to a conflict |
|---|---|
| when the launch is ordered | waits up to 180 s, then the launch is cancelled |
| before arming | continues to wait, within the same 180 s |
| before take-off | disarms, and the launch is cancelled |
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from swarmctl.agent.commands import StepResult, command, release_vehicle
from swarmctl.agent.own_modes import own_mode_roles
from swarmctl.agent.phases import Phase
from swarmctl.agent.replan.copter_trajectory import from_takeoff
from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.check import clashes_with, describe_clashes
from swarmctl.agent.traffic.intents import publish_intent
from swarmctl.agent.traffic.known_flights import known_flights
from swarmctl.agent.traffic.own_flight import to_shared_frame
from swarmctl.agent.traffic.prediction import hears_nobody
from swarmctl.agent.traffic.priority import gives_way, own_standing, standing_of
from swarmctl.agent.traffic.separation.clash import Clash
from swarmctl.agent.traffic.separation.other_vehicles import KnownFlight
from swarmctl.agent.traffic.separation.trajectory import until_landing
from swarmctl.agent.traffic.wait import Verdict, WaitFor, begin_wait, verdict
from swarmctl.core import events as ev
from swarmctl.core.records import replace

TAKEOFF_DELAYS_S = (-2.0, 0.0, 2.0, 4.0)
"""Start times checked, from now [s]: arming takes some seconds, and the climb may be faster or slower."""


def launch_if_possible(state: AgentState) -> StepResult:
    """Launch, or wait for a clear route. Called for each operator's order, plan and telemetry message."""
    if not (state.phase is Phase.STANDBY and state.launch.is_ordered and state.plans.pending is None):
        return state, []
    if state.telemetry_is_late:
        return state, []
    if state.vehicle.mode_role not in {"", *own_mode_roles(state)}:
        # Another operator controls the vehicle, or the vehicle is booting.
        return release_vehicle(
            state, f"the vehicle is in mode {state.vehicle.mode}, which this program has not ordered"
        )
    clashes = _route_clashes(state, _flights_waited_for(state))
    if hears_nobody(state):
        return _wait(state, "no other vehicle is heard any more", clashes)
    if clashes:
        return _wait(state, _conflict_text(state, clashes), clashes)
    messages: list[ev.Effect] = []
    if state.wait is not None:
        messages.append(ev.NotifyOperator("the wait is over; the vehicle launches [launch-clear]"))
    if state.launch.ignored and (ignored := _route_clashes(state, known_flights(state))):
        messages.append(
            ev.NotifyOperator(
                f"{_conflict_text(state, ignored)}; the vehicle launches anyway, as ordered [launch-ignores]"
            )
        )
    if state.launch.conflict:  # of an earlier launch
        messages.append(ev.LaunchConflict(""))
    launch = replace(state.launch, conflict="")
    wait = state.wait and state.wait.ended(state.vehicle.time_boot_s)
    changes: dict[str, Any] = {"launch": launch, "trouble": "", "wait": wait}
    # Vehicles with the same order learn of this flight before they arm.
    state, ordered = command(state, ev.FlightOrder.LAUNCH, phase=Phase.LAUNCHING, **changes)
    return state, [*messages, *ordered]


def watch_first_route(state: AgentState) -> StepResult:
    """Report a new conflict of the first route, or its end, while the vehicle launches."""
    if state.phase is not Phase.LAUNCHING or (text := _launch_conflict(state)) == state.launch.conflict:
        return state, []
    return replace(state, launch=replace(state.launch, conflict=text)), [ev.LaunchConflict(text)]


def _launch_conflict(state: AgentState) -> str:
    """Return the conflicts of the first route as text, for the checks before arming and take-off; "" if none.

    Once armed, the vehicle goes before others that are about to take off.
    """
    armed = state.launch.armed_seen
    others = {
        uav: known for uav, known in _flights_waited_for(state).items() if not (known.on_ground and armed)
    }
    clashes = _route_clashes(state, others)
    return _conflict_text(state, clashes) if clashes else ""


def postpone_launch(state: AgentState, event: ev.LaunchPostponed, _now: float) -> StepResult:
    """Wait on the ground again. After arming, cancel the launch: one order arms the vehicle only once."""
    if state.phase is not Phase.LAUNCHING or state.order.given is not ev.FlightOrder.LAUNCH:
        return state, []
    if event.was_armed:
        return cancel_launch(state, f"{event.reason}; the vehicle was disarmed again")
    state, withdrawn = _stand_by(state)
    clashes = _route_clashes(state, _flights_waited_for(state))
    state, messages = _wait(state, event.reason, clashes, again=True)
    return state, [*withdrawn, *messages]


def note_takeoff(state: AgentState) -> AgentState:
    return state.enter(Phase.FLYING, launch=state.launch.ended()).with_new_flight()


def cancel_launch(state: AgentState, why: str) -> StepResult:
    """Cancel the launch. After an operator's order the vehicle stands by, otherwise its flight has failed."""
    state, withdrawn = _stand_by(state)
    state = replace(state, launch=state.launch.withdrawn(), wait=None, trouble=f"not launched: {why}")
    if not state.launch.is_operators:
        return state.enter(Phase.FAILED, outcome=state.trouble), withdrawn
    text = f"{state.trouble}; the vehicle stands by for another order [not-launched]"
    return state, [*withdrawn, ev.NotifyOperator(text)]


def _stand_by(state: AgentState) -> StepResult:
    """Put the vehicle on standby, and withdraw its intent."""
    state = state.enter(Phase.STANDBY, launch=state.launch.not_begun())
    return (state, []) if state.sent.intent is None else publish_intent(state, None)


def _flights_waited_for(state: AgentState) -> dict[int, KnownFlight]:
    """Return the flights to which the launch gives way, by the rule of priority."""
    mine = own_standing(state)
    return {
        uav: known
        for uav, known in known_flights(state).items()
        if uav not in state.launch.ignored and gives_way(mine, standing_of(state, uav, known))
    }


def _route_clashes(state: AgentState, others: Mapping[int, KnownFlight]) -> tuple[Clash, ...]:
    """Return the conflicts of the first route with `others`, for a take-off now or a little later."""
    start, mission = state.vehicle.takeoff_lat_lon, state.plans.mission
    if start is None or mission is None or not others:
        return ()
    delay_s = state.vehicle.start_delay_s
    flight = to_shared_frame(state, from_takeoff(state.task, mission.plan, start, delay_s))
    if flight is None:
        return ()
    first = until_landing(flight)
    found = (clashes_with(state, first.later(s), others) for s in TAKEOFF_DELAYS_S)
    return next((clashes for clashes in found if clashes), ())


def _conflict_text(state: AgentState, clashes: tuple[Clash, ...]) -> str:
    return f"the first route would conflict with {describe_clashes(state, clashes)}"


def _wait(state: AgentState, why: str, clashes: Sequence[Clash], *, again: bool = False) -> StepResult:
    """Wait on the ground, or cancel the launch. Further attempts do not restart the waiting time."""
    now_s = state.vehicle.time_boot_s
    wait = state.wait or begin_wait(WaitFor.FIRST_ROUTE, now_s)
    ends, wait = verdict(wait, now_s, lambda: False)
    if ends is Verdict.OVER:
        why += f", even after a wait of {wait.rule.longest_s:.0f} s on the ground"
        return cancel_launch(state, f"{why}{_ignore_hint(state, clashes)}")
    text = f"{why}; the vehicle waits on the ground for at most {wait.deadline_boot_s - now_s:.0f} s"
    text += f"{_ignore_hint(state, clashes)} [launch-waits]"
    is_new = state.wait is None or again
    state = replace(state, wait=wait.again(), trouble=text)
    return state, [ev.NotifyOperator(text)] if is_new else []


def _ignore_hint(state: AgentState, clashes: Sequence[Clash]) -> str:
    """Return the command to launch despite conflicts; "" if there are none, or no operator gave the order."""
    if not clashes or not state.launch.is_operators:
        return ""
    others = sorted({*state.launch.ignored, *(clash.other for clash in clashes)})
    options = " ".join(f"--ignore {uav}" for uav in others)
    return f" (launch without waiting: `order launch --uav {state.task.uav} {options}`)"
