"""Route deconfliction: new plans avoid the known flights of other vehicles. Pure.

A new plan of a flying vehicle is compared with the known flights of other vehicles before the upload.

| the new plan | action |
|---|---|
| changes the height in an alarm, and the vehicle gives way by climbing | is uploaded without a comparison |
| has no conflict | is uploaded |
| conflicts, but another height is clear | is uploaded with the lowest clear height |
| conflicts at each height tried | is deferred: the vehicle keeps its plan, or holds if that conflicts soon |

Two plans can still conflict if both were uploaded at the same time, or if times have shifted. Both vehicles
compare the same two intents by the same rule, without a further message. A vehicle that cannot change its
plan has priority, otherwise the lower system id (`priority`). The other vehicle plans again.
"""

from __future__ import annotations

from swarmctl.agent.commands import StepResult
from swarmctl.agent.phases import Phase
from swarmctl.agent.replan.copter_trajectory import at_height, with_level_off
from swarmctl.agent.replan.plans import Plans
from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.check import SEPARATES_WITHIN_S, clashes_of_route, describe_clashes
from swarmctl.agent.traffic.intents import may_change
from swarmctl.agent.traffic.known_flights import known_flights, known_intents
from swarmctl.agent.traffic.own_flight import flight_by_plan, planned_flight
from swarmctl.agent.traffic.plan_conflicts import FlightComparison
from swarmctl.agent.traffic.prediction import AIRBORNE_M, hears_nobody, position_of
from swarmctl.agent.traffic.priority import gives_way, own_standing, standing_of
from swarmctl.agent.traffic.route_hold import climbs_to_give_way, heights_to_try, hold, may_hold
from swarmctl.agent.traffic.separation.clash import Clash
from swarmctl.agent.traffic.separation.other_vehicles import Others
from swarmctl.agent.traffic.separation.trajectory import Trajectory
from swarmctl.core import events as ev
from swarmctl.core.mission import FlightPlan
from swarmctl.core.planned_mission import PlannedMission
from swarmctl.core.records import replace

RETRY_S = 5.0
"""Time until a deferred plan is tried again [s]."""
RETRY_SOON_S = 1.0
"""Time until a deferred plan is tried again [s], if the present plan has a conflict soon."""
HOLDS_WITHIN_S = 20.0
"""Time to a conflict of the present plan below which the vehicle holds, if no new plan is clear [s]."""


# --- conflicts of the plan being flown


def check_own_route(state: AgentState) -> StepResult:
    """Compare the own intent with all others; plan again if this vehicle has to give way."""
    before = state.conflicts
    if not _may_change_route(state):
        if before.predicted:
            state = replace(state, conflicts=replace(before, predicted=frozenset(), compared={}))
        return state, []
    assert state.sent.intent is not None
    state, clashes = _update_comparisons(state, state.sent.intent)
    flights = known_flights(state) if clashes else {}
    found = [clash for clash in clashes if _gives_way(state, clash.other, flights)]
    if not found and not before.predicted:
        return state, []
    others, new = frozenset(clash.other for clash in found), before.new_of(found)
    n_ceased = len(before.predicted - others - before.deferred_for)
    conflicts = replace(state.conflicts, predicted=others).counted(predicted=len(new), ceased=n_ceased)
    state = replace(state, conflicts=conflicts)
    if not others:
        return state, []
    state = replace(state, plans=state.plans.due(must_change=True))
    text = f"the route conflicts with {describe_clashes(state, new)}"
    text += "; this vehicle gives way with a new plan [route-conflict]"
    return state, [ev.NotifyOperator(text)] if new else []


def _may_change_route(state: AgentState) -> bool:
    flies = state.phase is Phase.FLYING and not state.is_waiting
    return flies and state.sent.intent is not None and not hears_nobody(state)


def _update_comparisons(state: AgentState, own: Trajectory) -> tuple[AgentState, tuple[Clash, ...]]:
    """Compare the own flight with changed intents; return its clashes with all intents."""
    before, intents = state.conflicts.compared, known_intents(state)
    known = {
        uav: before[uav]
        for uav, intent in intents.items()
        if uav in before and before[uav].is_of(own, intent)
    }
    new = {uav: intent for uav, intent in intents.items() if uav not in known}
    clashes = {clash.other: clash for clash in clashes_of_route(state, own, new)} if new else {}
    after = known | {uav: FlightComparison(own, intent, clashes.get(uav)) for uav, intent in new.items()}
    found = sorted(
        (compared.clash for compared in after.values() if compared.clash is not None),
        key=lambda clash: (clash.at_s, clash.other),
    )
    return replace(state, conflicts=replace(state.conflicts, compared=after)), tuple(found)


def _gives_way(state: AgentState, other: int, flights: Others) -> bool:
    """Return whether this vehicle gives way to another with a known flight, by the rule of priority."""
    mine = own_standing(state, can_yield=may_change(state))
    return gives_way(mine, standing_of(state, other, flights[other]))


# --- conflicts of a new plan


def deconflict(before: AgentState, plans: Plans, mission: PlannedMission, now: float) -> StepResult:
    """Upload, change or defer the new mission of a decision in flight, by the table of the module.

    `plans` are those after the decision.
    """
    state = replace(before, plans=plans)
    mission = replace(mission, plan=_with_level_off_if_needed(before, mission.plan))
    flight = flight_by_plan(before, mission.plan)
    if before.alarms and climbs_to_give_way(before) and _changes_height(before, mission.plan):
        return _upload(state, mission)  # an evasive climb comes first
    present_flight = None if before.plans.mission is None else planned_flight(before)
    others = known_flights(state)
    clashes = _clashes(state, flight, others, present_flight)
    state = _counted(state, predicted=len(before.conflicts.new_of(clashes)))
    resolved = before.conflicts.predicted - before.conflicts.deferred_for
    if not clashes:
        state = _counted(state, by_route=len(resolved))
        state, taken = _upload(state, mission)
        waited = before.plans.mission is None and before.conflicts.deferred_for
        return state, [
            ev.NotifyOperator("the route is clear of other vehicles; the vehicle resumes it [resumes]"),
            *taken,
        ] if waited else taken
    for height_m in heights_to_try(state, mission.plan):
        plan = _with_level_off_if_needed(before, at_height(mission.plan, height_m))
        flight = flight_by_plan(before, plan)
        if _clashes(state, flight, others, present_flight):
            continue
        resolved |= {clash.other for clash in clashes} - before.conflicts.deferred_for
        state = _counted(state, by_height=len(resolved))
        state = replace(state, height_offset_m=height_m - state.task.altitude_m)
        others_text = describe_clashes(state, clashes)
        text = (
            f"at {mission.plan.height_m:.0f} m the new route would conflict with {others_text}; the vehicle "
        )
        text += f"flies the route at {height_m:.0f} m above home"
        state, taken = _upload(state, replace(mission, plan=plan))
        return state, [ev.NotifyOperator(f"{text} [height-change]"), *taken]
    return _defer(before, state, mission, clashes, others, now)


def _clashes(
    state: AgentState, flight: Trajectory | None, others: Others, present_flight: Trajectory | None = None
) -> tuple[Clash, ...]:
    return () if flight is None else clashes_of_route(state, flight, others, present_flight)


def _counted(state: AgentState, **more: int) -> AgentState:
    return replace(state, conflicts=state.conflicts.counted(**more))


def _changes_height(before: AgentState, plan: FlightPlan) -> bool:
    mission = before.plans.mission
    return mission is not None and abs(plan.height_m - mission.plan.height_m) >= AIRBORNE_M


def _with_level_off_if_needed(before: AgentState, plan: FlightPlan) -> FlightPlan:
    """Return the plan, with a level-off waypoint if the plan changes the height."""
    here, mission = position_of(before), before.plans.mission
    if here is None or before.task.wings is not None:
        return plan
    if mission is None:
        return with_level_off(before.task, plan, here)  # the vehicle stands still during the upload
    if not _changes_height(before, plan):
        return plan
    return with_level_off(before.task, plan, here, before.plans.swap_times.expected_s)


def _upload(state: AgentState, mission: PlannedMission) -> StepResult:
    state = replace(
        state,
        plans=state.plans.uploading(mission),
        conflicts=replace(state.conflicts, predicted=frozenset(), deferred_for=frozenset()),
    )
    return state.with_new_flight(), [ev.SwapMission(mission)]


def _defer(
    before: AgentState,
    state: AgentState,
    mission: PlannedMission,
    clashes: tuple[Clash, ...],
    flights: Others,
    now: float,
) -> StepResult:
    """Defer a plan: the vehicle keeps its present route, or holds; the plan is tried again soon."""
    others = frozenset(clash.other for clash in clashes)
    new = [clash for clash in clashes if clash.other not in before.conflicts.deferred_for]
    state = replace(
        state,
        plans=state.plans.deferred(before.plans, mission.because),
        conflicts=replace(state.conflicts, deferred_for=before.conflicts.deferred_for | others),
    )
    present_clashes = _clashes(state, planned_flight(before), flights)
    yielding = [clash for clash in present_clashes if _gives_way(before, clash.other, flights)]
    near_s = yielding[0].at_s - state.vehicle.time_boot_s if yielding else HOLDS_WITHIN_S
    again_s = RETRY_SOON_S if near_s < 2.0 * SEPARATES_WITHIN_S else RETRY_S
    state = replace(state, plans=state.plans.not_before(now + again_s))
    holds = before.plans.mission is None or (near_s < HOLDS_WITHIN_S and may_hold(before))
    reaction = "continues to hold" if before.plans.mission is None else "holds"
    reaction = f"{reaction} [plan-deferred-hold]" if holds else "keeps its present route [plan-deferred]"
    waits = others | (before.conflicts.predicted if holds else frozenset())
    if holds or not yielding:
        state = _counted(state, by_waiting=len(waits - before.conflicts.deferred_for))
    messages: list[ev.Effect] = []
    if new:
        others_text = describe_clashes(state, new)
        text = f"no height is clear for the new route (conflict with {others_text}); the vehicle {reaction}"
        messages.append(ev.NotifyOperator(text))
    if not holds:
        return state, messages
    state = replace(state, conflicts=replace(state.conflicts, predicted=frozenset()))
    state, ordered = hold(state, before.plans.mission or mission, others)
    return state, [*messages, *ordered]
