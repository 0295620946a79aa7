"""The hold of a copter that gives way on its route: begin, end, and the heights that it may fly at. Pure.

The hold is a wait (`wait.WaitFor.ROUTE`). It ends when the interrupted route is clear, from the hold on and
also some seconds later. Every 60 s the vehicle tries the route at other heights, too, and at once if it holds
in the way of a vehicle that cannot give way. Then the vehicle needs a new plan from the hold. A member that
has left its group goes on by its stored mission, if that is possible.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from itertools import pairwise

from swarmctl.agent.commands import StepResult, command
from swarmctl.agent.own_modes import own_mode_roles
from swarmctl.agent.phases import EN_ROUTE, Phase
from swarmctl.agent.replan.climb import CLIMB_M_S, DESCENT_M_S
from swarmctl.agent.replan.copter_trajectory import at_height, waypoints_of, with_level_off
from swarmctl.agent.replan.stored_mission import rest_of_stored
from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.check import SEPARATES_WITHIN_S, clashes_of_route, clashes_with
from swarmctl.agent.traffic.known_flights import known_flights
from swarmctl.agent.traffic.own_flight import (
    HOLD_DURATION_S,
    flight_by_plan,
    hold_from,
    planned_flight,
    stop_from,
)
from swarmctl.agent.traffic.prediction import (
    hears_nobody,
    home_amsl_m,
    position_amsl,
    position_of,
)
from swarmctl.agent.traffic.priority import (
    SAME_HEIGHT_M,
    gives_way,
    own_standing,
    reported_standing,
    standing_of,
)
from swarmctl.agent.traffic.separation.other_vehicles import Others
from swarmctl.agent.traffic.separation.trajectory import LocalPoint, Trajectory
from swarmctl.agent.traffic.separation.watch import HEIGHT_MARGIN
from swarmctl.agent.traffic.wait import WAITS_ABOVE_M, Verdict, Wait, WaitFor, begin_wait, verdict
from swarmctl.core import events as ev
from swarmctl.core.mission import FlightPlan
from swarmctl.core.planar import PlanarPoint
from swarmctl.core.planned_mission import PlannedMission
from swarmctl.core.records import replace

RESUME_DELAYS_S, CLIMB_DELAYS_S = (0.0, 3.0, 6.0), (0.0, 3.0)
"""Delays with which a resumed route has to be clear [s]: a vehicle follows a new plan after some seconds."""
WAITS_NEAR = 4.0
"""Distance within which two vehicles wait for each other, in units of the separation."""
CEILING_MARGIN_M = 3.0
"""Distance kept below the fence's ceiling [m]."""
MAX_HEIGHTS = 8
"""Greatest number of heights tried."""


def may_give_way(state: AgentState) -> bool:
    """Return whether the vehicle can give way: it is on its way, and not in its climb after the take-off."""
    vehicle, task = state.vehicle, state.task
    if state.task.separation.action == "none" or state.phase not in EN_ROUTE or state.plans.mission is None:
        return False
    was_in_group = state.phase is Phase.FORMATION or state.membership.left_boot_s > -math.inf
    climbed_m = task.altitude_m - 2.0 * task.separation.limits.vertical_m
    # A group may fly far below its members' own heights.
    least_m = min(WAITS_ABOVE_M, climbed_m) if was_in_group else climbed_m
    return not state.lost and vehicle.alt_rel_m is not None and vehicle.alt_rel_m >= least_m


def follows_own_order(state: AgentState) -> bool:
    """Return whether a copter flies by an order of this agent, is high enough, and does not wait already."""
    vehicle, task = state.vehicle, state.task
    if task.wings is not None or task.separation.action == "none" or state.is_waiting or state.lost:
        return False
    leaves = state.phase is Phase.LEAVING
    follows = leaves or state.order.is_followed or state.order.given in (None, ev.FlightOrder.LAUNCH)
    is_high = vehicle.alt_rel_m is not None and vehicle.alt_rel_m >= WAITS_ABOVE_M
    return follows and is_high and vehicle.armed and vehicle.mode_role in own_mode_roles(state)


def climbs_to_give_way(state: AgentState) -> bool:
    """Return whether the vehicle gives way with a climb: a fixed wing, or a copter with `action: climb`."""
    action = state.task.separation.action
    return action == "climb" or (action == "hold" and state.task.wings is not None)


def may_hold(state: AgentState) -> bool:
    """Return whether the vehicle can hold without a conflict."""
    here = position_amsl(state)
    if here is None or state.task.wings is not None:
        return False
    flight = hold_from(state, here, state.vehicle.time_boot_s)
    if hears_nobody(state):
        return False  # the others keep clear of its flight as announced
    return may_give_way(state) and not clashes_of_route(state, flight, known_flights(state))


def would_block(state: AgentState) -> bool:
    """Return whether a hold that begins now would block another vehicle, as in `hold_would_block`."""
    here = position_amsl(state)
    if here is None:
        return False
    stop = stop_from(state, here, state.vehicle.time_boot_s).points[-1]
    return hold_would_block(state, stop, known_flights(state))


def hold_would_block(state: AgentState, stop: LocalPoint, others: Others) -> bool:
    """Return whether a hold at `stop` would block a vehicle that cannot give way, or cannot do so in time.

    An uncertain flight counts without its uncertainty: a hold in a wide area is better than a flight across.
    """
    limits, now_s = state.task.separation.limits, state.vehicle.time_boot_s
    hold = Trajectory((now_s, now_s + HOLD_DURATION_S), (stop, stop))
    # Vehicles well above wait for this vehicle, or give way.
    near = {
        uav: replace(known, uncertainty_m=(0.0, 0.0))
        for uav, known in others.items()
        if standing_of(state, uav, known).up_m - stop[2] < limits.vertical_m + SAME_HEIGHT_M
    }
    clashes = clashes_with(state, hold, near)
    until_s = now_s + SEPARATES_WITHIN_S
    return any(not near[clash.other].may_change or clash.at_s < until_s for clash in clashes)


def goes_second(state: AgentState) -> bool:
    """Return whether another vehicle waits near this waiting vehicle, and goes first by the rule of priority.

    Two vehicles that wait for each other would otherwise go on at the same moment, and stop again.
    """
    here = position_amsl(state)
    if here is None:
        return False
    mine = own_standing(state, here[2])
    near_m = WAITS_NEAR * state.task.separation.limits.horizontal_m
    return any(
        bool(report.state.waits)
        and math.dist(here[:2], report.position_m[:2]) <= near_m
        and gives_way(mine, reported_standing(uav, report))
        for uav, report in state.neighbours.items()
    )


def hold(state: AgentState, mission: PlannedMission | None, to: frozenset[int]) -> StepResult:
    """Order a hold to give way to the vehicles `to`.

    A second hold on the way to one clear route keeps the first deadline. The vehicle has no route while it
    holds. A member of a group leaves its place, and may go on by its stored mission. At the end of the
    group's route it plans anew, because that mission leads elsewhere.
    """
    in_group, now_s = state.phase is Phase.FORMATION, state.vehicle.time_boot_s
    by_stored = in_group and not state.membership.is_over
    wait = begin_wait(WaitFor.ROUTE, now_s, mission=mission, to=to, by_stored=by_stored, before=state.wait)
    is_new = bool(to) and state.order.given is not ev.FlightOrder.HOLD
    return command(
        state,
        ev.FlightOrder.HOLD,
        phase=Phase.FLYING,
        wait=wait,
        plans=state.plans.interrupted(),
        conflicts=state.conflicts.counted(holds=is_new),
    )


def resume_if_clear(state: AgentState) -> StepResult:
    """End the hold if the route is clear, or at its deadline. Called for each telemetry message."""
    before, now_s = state.wait, state.vehicle.time_boot_s
    if state.phase is not Phase.FLYING or before is None or before.mission is None or not before.is_on:
        return state, []

    def is_clear() -> bool:
        return state.order.is_followed and not hears_nobody(state) and _is_way_clear(state, before)

    ends, wait = verdict(before, now_s, is_clear, goes_second=partial(goes_second, state))
    match ends:
        case Verdict.OVER:
            return give_up(state)
        case Verdict.CLEAR if (stored := _stored(state, wait)) is not None:
            return _fly_stored(state, stored)
        case Verdict.CLEAR:
            text = "the interrupted route is clear of other vehicles; the vehicle goes on with a new plan"
            return _resume(state, f"{text} [resumes]")
    is_report_due = wait.is_report_due(now_s)
    if ends is Verdict.WAIT or not (is_report_due or would_block(state)):
        return replace(state, wait=wait), []
    plan = _rest_of(state, before.mission.plan)
    text = (
        f"the vehicle has held for at least {wait.rule.report_every_s:.0f} s"
        if is_report_due
        else "the vehicle holds in the way of another vehicle, which cannot give way in time"
    )
    delays_s = RESUME_DELAYS_S if is_report_due else CLIMB_DELAYS_S
    for height_m in () if hears_nobody(state) else heights_to_try(state, plan):
        if _is_clear(state, _levelled(state, at_height(plan, height_m)), delays_s):
            plans = state.plans.due(must_change=True)
            state = replace(state, height_offset_m=height_m - state.task.altitude_m, plans=plans)
            state = replace(state, conflicts=replace(state.conflicts, deferred_for=frozenset()))
            return _resume(state, f"{text}; it resumes its route at {height_m:.0f} m [resumes-higher]")
    if not is_report_due:
        return replace(state, wait=wait), []
    return replace(state, wait=wait.reported(now_s)), [
        ev.NotifyOperator(f"{text}; no height found is clear, so it continues to hold [keeps-holding]")
    ]


def give_up(state: AgentState) -> StepResult:
    """End a flight whose hold has reached its deadline: the vehicle returns, or lands."""
    assert state.wait is not None
    longest_s, fallback = state.wait.rule.longest_s, state.task.fallback
    reason = f"the vehicle has held for {longest_s:.0f} s, and the way is still not clear"
    state, ordered = command(
        state,
        fallback,
        phase=Phase.LEAVING,
        given_up=True,
        outcome=reason,
        plans=state.plans.without_mission(),
    )
    does = "returns" if fallback is ev.FlightOrder.RETURN else "lands where it is"
    return state, [ev.NotifyOperator(f"{reason}; the vehicle {does} [held-too-long]"), *ordered]


def _resume(state: AgentState, text: str) -> StepResult:
    assert state.wait is not None
    # After a deferred plan, `route_deconfliction` reports when the new plan is clear.
    messages: list[ev.Effect] = [] if state.conflicts.deferred_for else [ev.NotifyOperator(text)]
    state = replace(
        state,
        wait=state.wait.ended(state.vehicle.time_boot_s),
        order=state.order.noted(ev.FlightOrder.LAUNCH),
        plans=state.plans.resumed(),
    )
    return state, messages


def _stored(state: AgentState, wait: Wait) -> PlannedMission | None:
    """Return the rest of the stored mission, if the vehicle may go on by it."""
    return rest_of_stored(state, wait.mission) if wait.by_stored and wait.mission is not None else None


def _fly_stored(state: AgentState, stored: PlannedMission) -> StepResult:
    """Fly the stored mission; a new plan is decided when the vehicle flies it."""
    assert state.wait is not None
    now_s = state.vehicle.time_boot_s
    state = replace(
        state,
        wait=state.wait.ended(now_s),
        order=state.order.noted(ev.FlightOrder.LAUNCH),
        plans=state.plans.from_own_hold().changing_to(stored, now_s).due(),
    )
    text = "the way to the vehicle's stored mission is clear of other vehicles; the vehicle flies it"
    return state.with_new_flight(), [ev.NotifyOperator(f"{text} [resumes-stored]"), ev.SwapMission(stored)]


def _is_way_clear(state: AgentState, wait: Wait) -> bool:
    """Return whether the way by the stored mission is clear, or by the rest of the interrupted one."""
    assert wait.mission is not None
    if (stored := _stored(state, wait)) is not None:
        return _is_clear(state, stored.plan)
    return _is_clear(state, _levelled(state, _rest_of(state, wait.mission.plan)))


def _levelled(state: AgentState, plan: FlightPlan) -> FlightPlan:
    """Return a plan that is uploaded from the hold, with its level-off waypoint."""
    here = position_of(state)
    return plan if here is None else with_level_off(state.task, plan, here)


def _is_clear(state: AgentState, plan: FlightPlan, delays_s: Sequence[float] = RESUME_DELAYS_S) -> bool:
    """Return whether a plan is clear for a start now or a few seconds later."""
    flight = flight_by_plan(state, plan)
    if flight is None:
        return False
    others, present = known_flights(state), planned_flight(state)
    return not any(clashes_of_route(state, flight.later(seconds), others, present) for seconds in delays_s)


def _rest_of(state: AgentState, plan: FlightPlan) -> FlightPlan:
    """Return the part of the interrupted plan that is still ahead."""
    n_passed = 0 if state.progress is None else state.progress.waypoint
    return replace(plan, track=plan.track[n_passed:])


# --- heights


def ceiling_m(state: AgentState) -> float:
    """Return the greatest height above home for an evasive climb [m]."""
    fence = state.task.fence
    return math.inf if fence is None else fence.ceiling_m - CEILING_MARGIN_M


def reachable_heights_m(
    state: AgentState, here: LocalPoint, path: Sequence[PlanarPoint]
) -> tuple[float, float]:
    """Return the lowest and the highest height [m] that a new plan along `path` reaches half-way to its end.

    A later climb would end over the goal, where other vehicles come down.
    """
    legs_m = sum(math.dist(a, b) for a, b in pairwise([here[:2], *path]))
    remaining_s = max(0.5 * legs_m / state.task.speed_m_s - state.plans.swap_times.expected_s, 0.0)
    return here[2] - DESCENT_M_S * remaining_s, here[2] + CLIMB_M_S * remaining_s


def heights_to_try(state: AgentState, plan: FlightPlan) -> Sequence[float]:
    """Return the heights above home to try [m], lowest first; none if the vehicle's height is unknown.

    The heights are the task's altitude, and heights just above the plan and each other vehicle's flight. A
    height that the vehicle would reach only over its goal is no way out: others come down there. From a hold
    the vehicle climbs on the spot, and this limit does not apply.
    """
    task, planned_m, here = state.task, plan.height_m, position_of(state)
    if here is None:
        return []
    least_m, reachable_m = -math.inf, math.inf
    if state.plans.mission is not None:
        least_m, reachable_m = reachable_heights_m(state, here, waypoints_of(task, plan))
    home_m = home_amsl_m(state)
    margin_m = HEIGHT_MARGIN * task.separation.limits.vertical_m
    tops_m = {
        max(point[2] for point in known.flight.points) + known.uncertainty_m[1] - home_m
        for known in known_flights(state).values()
    }
    candidates = {task.altitude_m, planned_m + margin_m, *(top_m + margin_m for top_m in tops_m)}
    low_m, most_m = max(task.altitude_m, least_m), min(ceiling_m(state), reachable_m)
    allowed = sorted(h for h in candidates if low_m <= h <= most_m and abs(h - planned_m) > 0.1)
    return allowed[:MAX_HEIGHTS]
