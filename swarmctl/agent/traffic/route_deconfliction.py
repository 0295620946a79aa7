"""Route deconfliction: new plans avoid the known intents of other vehicles. Pure.

A new plan of a flying vehicle is compared with the recent intents of other vehicles before the upload.

| the new plan | action |
|---|---|
| changes the height during a proximity alarm | is uploaded without a comparison |
| has no conflict | is uploaded |
| conflicts, but another height is clear | is uploaded with the lowest clear height |
| conflicts at each height tried | is deferred: the vehicle keeps its plan, or holds if that conflicts soon |

Two plans can still conflict if both were uploaded at the same time, or if times have shifted. Both vehicles
compare the same two intents by the same rule, without a further message. A vehicle that cannot change its
plan has priority, otherwise the lower system id (`watch.gives_way_to`). The other vehicle plans again.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import msgspec

from swarmctl.agent.orders import StepResult, command
from swarmctl.agent.phases import Phase
from swarmctl.agent.replan.copter_trajectory import at_height, with_level_off
from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.collision_avoidance import ceiling_m, least_share, may_give_way
from swarmctl.agent.traffic.conflicts import DeconflictionCounts, FlightComparison
from swarmctl.agent.traffic.intents import (
    HOLD_DURATION_S,
    MAX_AGE_S,
    flight_by_plan,
    may_change,
    planned_flight,
    position_amsl,
    publish_intent,
)
from swarmctl.agent.traffic.prediction import AIRBORNE_M, position_of, stopping_point
from swarmctl.agent.traffic.separation.approach import Limits
from swarmctl.agent.traffic.separation.clash import TIME_TOLERANCE_S, Clash, describe_clashes, find_clashes
from swarmctl.agent.traffic.separation.trajectory import Bounds, Trajectory, until_landing
from swarmctl.agent.traffic.separation.watch import HEIGHT_MARGIN, NeighbourIntent, gives_way_to
from swarmctl.core import events as ev
from swarmctl.core.mission import FlightPlan
from swarmctl.core.records import replace

RETRY_S = 5.0
"""Time until a deferred plan is tried again [s]."""
RETRY_SOON_S = 1.0
"""Time until a deferred plan is tried again [s], if the present plan has a conflict soon."""
HOLDS_WITHIN_S = 20.0
"""Time to a conflict of the present plan below which the vehicle holds, if no new plan is clear [s]."""
SEPARATES_WITHIN_S = 6.0
"""Time within which two close vehicles have to separate [s]; a climb or a turn takes this long."""
BETTER_BY = 0.3
"""Least improvement, as a share of the limits, of a plan that is still too close to another vehicle."""
MAX_HEIGHTS = 8
"""Greatest number of heights tried."""


def clashes_with_known_intents(
    state: AgentState, flight: Trajectory | None, present_flight: Trajectory | None = None
) -> tuple[Clash, ...]:
    """Return the clashes of a flight, up to its landing, with the recent intents, soonest first.

    A flight that separates two close vehicles does not clash. `present_flight`: flight of the present plan.
    """
    return () if flight is None else _unresolved_clashes(state, flight, known_intents(state), present_flight)


def known_intents(state: AgentState) -> dict[int, NeighbourIntent]:
    """Return the recent intents of other vehicles by system id."""
    now_s = state.vehicle.time_boot_s
    return {uav: intent for uav, intent in state.intents.items() if 0.0 <= now_s - intent.sent_s <= MAX_AGE_S}


def _unresolved_clashes(
    state: AgentState,
    flight: Trajectory,
    others: Mapping[int, NeighbourIntent],
    present_flight: Trajectory | None,
) -> tuple[Clash, ...]:
    limits, flight = state.task.separation.limits, until_landing(flight)
    near_s = flight.times_s[0] + (TIME_TOLERANCE_S if present_flight is None else SEPARATES_WITHIN_S)

    def separates(intent: NeighbourIntent) -> bool:
        return _separates(flight, present_flight, intent.flight, intent.limits(limits))

    found = clashes_with(flight, others, limits)
    return tuple(clash for clash in found if clash.at_s > near_s or not separates(others[clash.other]))


def clashes_with(
    flight: Trajectory, others: Mapping[int, NeighbourIntent], limits: Limits
) -> tuple[Clash, ...]:
    """Return the clashes of a flight with the intents of `others`, soonest first."""
    near = near_flights(flight, others, limits)
    wider = {uav: intent.limits(limits) for uav, intent in near.items() if any(intent.uncertainty_m)}
    return find_clashes(flight, {uav: intent.flight for uav, intent in near.items()}, limits, wider=wider)


def near_flights(
    flight: Trajectory, others: Mapping[int, NeighbourIntent], limits: Limits
) -> dict[int, NeighbourIntent]:
    """Return those of `others` that may clash with a flight, by bounding boxes."""
    mine = Bounds.of(flight)
    return {
        uav: intent
        for uav, intent in others.items()
        if mine.is_within(intent.bounds, _margins(intent, limits))
    }


def _margins(intent: NeighbourIntent, limits: Limits) -> tuple[float, float, float, float]:
    """Return the margins in time, east, north and up [s, m]."""
    pair_limits = intent.limits(limits) if any(intent.uncertainty_m) else limits
    return TIME_TOLERANCE_S, pair_limits.horizontal_m, pair_limits.horizontal_m, pair_limits.vertical_m


def _separates(flight: Trajectory, present: Trajectory | None, other: Trajectory, limits: Limits) -> bool:
    """Return whether a flight separates two vehicles that are close now.

    From SEPARATES_WITHIN_S on, the flight has to keep the limits. Until then the vehicles may be closer than
    the limits if they come no closer than now, or if the present flight comes closer by BETTER_BY.
    """
    begin_s = flight.times_s[0]
    after = flight.since(begin_s + SEPARATES_WITHIN_S)
    if after is not None and find_clashes(after, {0: other}, limits):
        return False
    here, there = flight.at(begin_s), other.at(begin_s)
    least = least_share(flight, other, limits)
    if least is None or here is None or there is None:
        return True
    now = limits.share(math.dist(here[:2], there[:2]), abs(here[2] - there[2]))
    if least >= min(now, 1.0) - 1e-6:
        return True
    present_least = None if present is None else least_share(present, other, limits)
    return present_least is not None and least >= present_least + BETTER_BY


# --- conflicts of the plan being flown


def check_own_route(state: AgentState) -> StepResult:
    """Compare the own intent with all others; plan again if this vehicle has to give way."""
    if state.phase is not Phase.FLYING or state.own_intent is None or state.give_way.plan is not None:
        return (
            replace(state, conflicts=replace(state.conflicts, predicted=frozenset(), compared={}))
            if state.conflicts.predicted
            else state
        ), []
    state, clashes = _update_comparisons(state, state.own_intent)
    found = [clash for clash in clashes if _gives_way(state, clash.other)]
    if not found and not state.conflicts.predicted:
        return state, []
    others = frozenset(clash.other for clash in found)
    new = [
        clash
        for clash in found
        if clash.other not in state.conflicts.predicted | state.conflicts.deferred_for
    ]
    counts = state.conflicts.counts
    counts = replace(
        counts,
        predicted=counts.predicted + len(new),
        ceased=counts.ceased + len(state.conflicts.predicted - others - state.conflicts.deferred_for),
    )
    state = replace(state, conflicts=replace(state.conflicts, predicted=others, counts=counts))
    if not others:
        return state, []
    state = replace(state, dirty=True, must_change=True)
    text = f"the route conflicts with {describe_clashes(new, state.vehicle.time_boot_s)}"
    text += "; this vehicle gives way with a new plan [route-conflict]"
    return state, [ev.NotifyOperator(text)] if new else []


def _counted(state: AgentState, counts: DeconflictionCounts) -> AgentState:
    return replace(state, conflicts=replace(state.conflicts, counts=counts))


def _update_comparisons(state: AgentState, own: Trajectory) -> tuple[AgentState, tuple[Clash, ...]]:
    """Compare the own flight with changed intents; return its clashes with all intents."""
    before = {uav: compared for uav, compared in state.conflicts.compared.items() if compared.own is own}
    intents = known_intents(state)
    new = {
        uav: intent for uav, intent in intents.items() if uav not in before or before[uav].other is not intent
    }
    clashes = {clash.other: clash for clash in _unresolved_clashes(state, own, new, None)} if new else {}
    after = {
        uav: FlightComparison(own, intent, clashes.get(uav)) if uav in new else before[uav]
        for uav, intent in intents.items()
    }
    found = sorted(
        (compared.clash for compared in after.values() if compared.clash is not None),
        key=lambda clash: (clash.at_s, clash.other),
    )
    return replace(state, conflicts=replace(state.conflicts, compared=after)), tuple(found)


def _gives_way(state: AgentState, other: int) -> bool:
    intent = state.intents[other]
    return gives_way_to((may_change(state), state.task.uav), (intent.may_change, other))


# --- conflicts of a new plan


def deconflict(before: AgentState, decided: StepResult, now: float) -> StepResult:
    """Upload, change or defer the new plan of a decision in flight, by the table of the module."""
    state, effects = decided
    swap = next((effect for effect in effects if isinstance(effect, ev.SwapMission)), None)
    if swap is None or state.phase is not Phase.FLYING:
        return decided
    swap = msgspec.structs.replace(swap, plan=_with_level_off_if_needed(before, swap.plan))
    flight = flight_by_plan(before, swap.plan)
    if before.alarms and _changes_height(before, swap.plan):
        return _upload(state, swap, flight)  # an evasive climb comes first
    present_flight = None if before.route is None else planned_flight(before)
    clashes = clashes_with_known_intents(state, flight, present_flight)
    new = [
        clash
        for clash in clashes
        if clash.other not in before.conflicts.predicted | before.conflicts.deferred_for
    ]
    counts = before.conflicts.counts
    counts = replace(counts, predicted=counts.predicted + len(new))
    state = _counted(state, counts)
    resolved = before.conflicts.predicted - before.conflicts.deferred_for
    if not clashes:
        state = _counted(state, replace(counts, by_route=counts.by_route + len(resolved)))
        state, taken = _upload(state, swap, flight)
        waited = before.route is None and before.conflicts.deferred_for
        return state, [
            ev.NotifyOperator("the route is clear of other vehicles; the vehicle resumes it [resumes]"),
            *taken,
        ] if waited else taken
    for height_m in _heights_m(state, swap.plan):
        plan = _with_level_off_if_needed(before, at_height(swap.plan, height_m))
        flight = flight_by_plan(before, plan)
        if clashes_with_known_intents(state, flight, present_flight):
            continue
        resolved |= {clash.other for clash in clashes} - before.conflicts.deferred_for
        state = _counted(state, replace(counts, by_height=counts.by_height + len(resolved)))
        state = replace(state, height_offset_m=height_m - state.task.altitude_m)
        others_text = describe_clashes(clashes, state.vehicle.time_boot_s)
        text = f"at {swap.plan.height_m:.0f} m the new route would conflict with {others_text}; the vehicle "
        text += f"flies the route at {height_m:.0f} m above home"
        state, published = _upload(state, msgspec.structs.replace(swap, plan=plan), flight)
        return state, [ev.NotifyOperator(f"{text} [height-change]"), *published]
    return _defer(before, state, swap, clashes, now)


def _changes_height(before: AgentState, plan: FlightPlan) -> bool:
    route = before.route
    return route is not None and abs(plan.height_m - route.plan.height_m) >= AIRBORNE_M


def _with_level_off_if_needed(before: AgentState, plan: FlightPlan) -> FlightPlan:
    """Return the plan, with a level-off waypoint if the plan changes the height."""
    here, route = position_of(before), before.route
    if here is None or before.task.wings is not None:
        return plan
    if route is None:
        return with_level_off(before.task, plan, here, 0.0)  # the vehicle stands still during the upload
    if not _changes_height(before, plan):
        return plan
    return with_level_off(before.task, plan, here, before.swap_times.expected_s)


def _upload(state: AgentState, swap: ev.SwapMission, flight: Trajectory | None) -> StepResult:
    state = replace(
        state,
        pending=swap,
        conflicts=replace(state.conflicts, predicted=frozenset(), deferred_for=frozenset()),
        give_way=replace(state.give_way, since_boot_s=math.inf),
    )
    state, published = publish_intent(state, flight)
    return state, [swap, *published]


def _defer(
    before: AgentState, state: AgentState, swap: ev.SwapMission, clashes: tuple[Clash, ...], now: float
) -> StepResult:
    """Defer a plan: the vehicle keeps its present route, or holds; the plan is tried again soon."""
    others = frozenset(clash.other for clash in clashes)
    new = [clash for clash in clashes if clash.other not in before.conflicts.deferred_for]
    state = replace(
        state,
        pending=None,
        because=swap.because,
        dirty=True,
        must_change=before.must_change,
        late_s=before.late_s,
        conflicts=replace(state.conflicts, deferred_for=before.conflicts.deferred_for | others),
    )
    present_clashes = clashes_with_known_intents(state, planned_flight(before))
    yielding = [clash for clash in present_clashes if _gives_way(before, clash.other)]
    near_s = yielding[0].at_s - state.vehicle.time_boot_s if yielding else HOLDS_WITHIN_S
    again_s = RETRY_SOON_S if near_s < 2.0 * SEPARATES_WITHIN_S else RETRY_S
    state = replace(state, retry_at_s=now + again_s)
    holds = before.route is None or (near_s < HOLDS_WITHIN_S and _may_hold(before))
    reaction = "continues to hold" if before.route is None else "holds"
    reaction = f"{reaction} [plan-deferred-hold]" if holds else "keeps its present route [plan-deferred]"
    waits = others | (before.conflicts.predicted if holds else frozenset())
    if holds or not yielding:
        counts = state.conflicts.counts
        n_waiting = counts.by_waiting + len(waits - before.conflicts.deferred_for)
        state = _counted(state, replace(counts, by_waiting=n_waiting))
    messages: list[ev.Effect] = []
    if new:
        others_text = describe_clashes(new, state.vehicle.time_boot_s)
        text = f"no height is clear for the new route (conflict with {others_text}); the vehicle {reaction}"
        messages.append(ev.NotifyOperator(text))
    if not holds:
        return state, messages
    state, ordered = _hold(state, before.route or swap)
    return state, [*messages, *ordered]


def _may_hold(state: AgentState) -> bool:
    """Return whether the vehicle can hold without a conflict."""
    task, here, now_s = state.task, position_amsl(state), state.vehicle.time_boot_s
    if here is None or task.separation.action != "hold" or task.wings is not None or not may_give_way(state):
        return False
    stop = stopping_point(state, here)
    hold = Trajectory((now_s, now_s + HOLD_DURATION_S), (stop, stop))
    return not clashes_with_known_intents(state, hold)


def _hold(state: AgentState, swap: ev.SwapMission) -> StepResult:
    """Order a hold for at least RETRY_S; collision avoidance ends the hold."""
    now_s = state.vehicle.time_boot_s
    state, ordered = command(
        state,
        ev.FlightOrder.HOLD,
        give_way=replace(
            state.give_way,
            plan=swap,
            earliest_end_boot_s=now_s + RETRY_S,
            since_boot_s=min(state.give_way.since_boot_s, now_s),
        ),
        route=None,
        dirty=False,
        retry_at_s=0.0,
        n_holds=state.n_holds + (state.order.given is not ev.FlightOrder.HOLD),
        conflicts=replace(state.conflicts, predicted=frozenset()),
    )
    state, published = publish_intent(state, planned_flight(state))
    return state, [*ordered, *published]


# --- other heights


def _heights_m(state: AgentState, plan: FlightPlan) -> list[float]:
    """Return the heights above home to try [m], lowest first; none if the vehicle's height is unknown.

    The heights are the task's altitude, and heights just above the new plan and each other vehicle's flight.
    """
    task, vehicle = state.task, state.vehicle
    planned_m = plan.height_m
    if vehicle.alt_amsl_m is None or vehicle.alt_rel_m is None:
        return []
    home_m = vehicle.alt_amsl_m - vehicle.alt_rel_m
    margin_m = HEIGHT_MARGIN * task.separation.limits.vertical_m
    tops_m = {
        max(point[2] for point in intent.flight.points) + intent.uncertainty_m[1] - home_m
        for intent in state.intents.values()
    }
    candidates = {task.altitude_m, planned_m + margin_m, *(top_m + margin_m for top_m in tops_m)}
    most_m = ceiling_m(state)
    allowed = sorted(h for h in candidates if task.altitude_m <= h <= most_m and abs(h - planned_m) > 0.1)
    return allowed[:MAX_HEIGHTS]
