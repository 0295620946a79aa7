"""The plan and its mission changes: when a plan is due, and what follows from each outcome. Pure."""

from __future__ import annotations

from swarmctl.agent.commands import RETRY_AFTER_S, StepResult, command, release_vehicle
from swarmctl.agent.formation.group_plan import plan_in_formation, plan_of_leader
from swarmctl.agent.own_modes import own_mode_roles
from swarmctl.agent.phases import IN_FLIGHT, ON_GROUND, PLANNING, Phase
from swarmctl.agent.replan.decide import believed_exposure, decide
from swarmctl.agent.replan.splice import is_wall_close, may_learn_of_walls
from swarmctl.agent.replan.stopping import stop_end_s
from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.landing_queue import hold_before_landing
from swarmctl.agent.traffic.launching import launch_if_possible
from swarmctl.agent.traffic.prediction import hears_nobody
from swarmctl.agent.traffic.route_deconfliction import deconflict
from swarmctl.agent.traffic.wait import WaitFor
from swarmctl.core import events as ev
from swarmctl.core.records import replace
from swarmctl.planners.base import Unreachable

MAX_FAILED_SWAPS = 3
"""Number of failed mission changes in sequence after which the flight is given up."""


def needs_tick(state: AgentState, now: float) -> bool:
    """Return whether the agent has to decide on a plan now."""
    return (
        state.plans.is_due
        and state.phase in PLANNING
        and state.plans.pending is None
        and not state.waits_for(WaitFor.ROUTE)
        and not state.lost
        and not state.telemetry_is_late
        # The others keep clear of a flight as announced: only own observations change it.
        and (state.phase is not Phase.FLYING or bool(state.plans.because) or not hears_nobody(state))
        and now >= state.plans.retry_at_s
        # The empty role: the vehicle's mode is not known yet.
        and (state.phase is not Phase.FLYING or state.vehicle.mode_role in {"", *own_mode_roles(state)})
        and (not _was_just_swapped(state) or _must_plan_now(state))
    )


def _was_just_swapped(state: AgentState) -> bool:
    """Return whether the time since the last mission change is below the expected time of a mission change.

    The agent does not plan during this time, so that its next plan includes all observations until then.
    """
    if state.phase is not Phase.FLYING:
        return False
    return (
        0.0 <= state.vehicle.time_boot_s - state.plans.swaps.done_boot_s < state.plans.swap_times.expected_s
    )


def _must_plan_now(state: AgentState) -> bool:
    """Return whether planning is urgent: no plan is flown, the plan must change, or a wall is close."""
    if state.plans.must_change or state.plans.mission is None:
        return True
    if not may_learn_of_walls(state):
        return False
    p_s = believed_exposure(state.task, state.belief, state.strength, state.own)
    return is_wall_close(state, p_s)


def plan_if_due(state: AgentState, _event: ev.Tick, now: float) -> StepResult:
    if not needs_tick(state, now):
        return state, []
    if state.phase is Phase.FORMATION:
        return plan_in_formation(state), []
    if (led := plan_of_leader(state)) is not None:
        return led
    try:
        plans, mission = decide(state)
    except Unreachable as error:
        return _handle_unreachable_goal(replace(state, plans=state.plans.unreachable(), trouble=str(error)))
    if mission is None:
        state = replace(state, plans=plans)
        return (state.without_trouble() if state.phase is Phase.FLYING else state), []
    if state.phase is Phase.FLYING:
        return deconflict(state, plans, mission, now)
    return replace(state, plans=plans), [ev.SwapMission(mission)]


def _handle_unreachable_goal(state: AgentState) -> StepResult:
    """Keep the present route, or end the flight, because the agent has found no route to a goal."""
    if state.phase in ON_GROUND:
        return state.enter(Phase.FAILED, outcome=state.trouble), []
    if state.plans.mission is not None:
        return state, []
    return command(state, state.task.fallback, phase=Phase.LEAVING, given_up=True)


def mission_accepted(state: AgentState, event: ev.MissionAccepted, _now: float) -> StepResult:
    mission = state.plans.pending
    if mission is None or mission.plan_id != event.plan_id:
        return state, []
    state = replace(state, plans=state.plans.verified(mission))
    if state.ended:
        return state, []
    # The vehicle has flown on since the decision.
    state = replace(state, plans=state.plans.taken(mission), trouble="").with_progress()
    # A mode change during the swap may have reset the commanded speed.
    state = replace(state, speed=state.speed.unknown())
    if state.phase in IN_FLIGHT:
        now_s, stops_s = state.vehicle.time_boot_s, stop_end_s(state)
        plans = state.plans.changed_in_flight(now_s, stops_s, event.took_s, event.stood_still_s)
        return replace(state, plans=plans), []
    state = replace(state, plans=state.plans.uploaded_on_ground(event.took_s))
    if state.phase is Phase.UPLOADING:
        state = state.enter(Phase.STANDBY)
    return launch_if_possible(state)


def mission_failed(state: AgentState, event: ev.MissionFailed, now: float) -> StepResult:
    mission = state.plans.pending
    if mission is None or mission.plan_id != event.plan_id:
        return state, []
    # A mode change during the swap may have reset the speed.
    speed, plans = state.speed.unknown(), state.plans.failed(event, state.vehicle.time_boot_s)
    state = replace(state, plans=plans, speed=speed, trouble=event.reason)
    if state.phase in ON_GROUND:
        return state.enter(Phase.FAILED, outcome=event.reason), []
    if event.flying == "theirs" and state.phase in IN_FLIGHT:
        return release_vehicle(state, event.reason)
    if state.phase is Phase.LANDING and event.flying == "hold" and state.wait is not None:
        return hold_before_landing(state, state.wait.to)  # others may be below this place
    if state.phase is Phase.LANDING and (event.flying != "old" or mission.plan.from_hold):
        # The vehicle may hold in its goal cell, so it has to land there.
        return command(state, ev.FlightOrder.LAND)
    # Without an announcement others expect the flight by the new plan, for long if the link is lost.
    if state.phase is Phase.LANDING:
        return state.without_trouble().with_new_flight(), []
    if state.phase is not Phase.FLYING:
        return state, []
    if state.plans.swaps.n_failed >= MAX_FAILED_SWAPS:
        return command(state, state.task.fallback, phase=Phase.LEAVING, given_up=True)
    retry_at_s = now if event.is_late else now + RETRY_AFTER_S
    plans = state.plans.again(mission, retry_at_s, flies_old=event.flying == "old")
    return replace(state, plans=plans).with_new_flight(), []
