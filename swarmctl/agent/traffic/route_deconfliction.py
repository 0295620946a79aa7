"""No two plans that meet: a new one is compared with what the others have told before it goes out.

Who takes up a new plan gives way to all whose flights it knows: it flies it at another height, or keeps the
plan it has, or holds. So two plans meet only where both were taken up before either was heard of (or times
have shifted). Both then know the same two flights, and of any two exactly one gives way, without a word:
who cannot change its plan has the way, else who has the lower system id (`swarmctl.agent.traffic.separation.watch`). It
plans anew, and what it finds it compares with all again. Nothing is proposed, so there is nothing to accept.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import msgspec

from swarmctl.agent.orders import StepResult, command
from swarmctl.agent.replan.copter_trajectory import at_height, height_of, with_level_off
from swarmctl.agent.state import AgentState, FlightComparison, Phase
from swarmctl.agent.traffic.collision_avoidance import (
    AIRBORNE_M,
    ceiling_m,
    least_share,
    may_give_way,
    position_of,
    stopping_point,
)
from swarmctl.agent.traffic.intents import (
    MAX_AGE_S,
    STANDS_S,
    flight_by_plan,
    may_change,
    planned_flight,
    position_amsl,
    publish_intent,
)
from swarmctl.agent.traffic.separation.approach import Limits
from swarmctl.agent.traffic.separation.clash import SLACK_S, Clash, describe_clashes, find_clashes
from swarmctl.agent.traffic.separation.trajectory import Bounds, Trajectory, until_landing
from swarmctl.agent.traffic.separation.watch import HEIGHT_MARGIN, NeighbourIntent, gives_way_to
from swarmctl.core import events as ev
from swarmctl.core.mission import FlightPlan

AGAIN_S, AGAIN_SOON_S = 5.0, 1.0
"""After this a plan that was put off is looked at again; and where the one before meets somebody soon."""
HOLDS_WITHIN_S = 20.0
"""Who finds no way to give way flies on until it would meet the other within this, and holds then."""
PARTS_WITHIN_S = 6.0
"""So soon two that are near each other are apart: to climb, or to turn, takes so long."""
BETTER_BY = 0.3
"""of the limits: by so much a plan that comes too near has to be better than the one before"""
MOST_HEIGHTS = 8


def clashes_of(
    state: AgentState, flight: Trajectory | None, instead_of: Trajectory | None = None
) -> tuple[Clash, ...]:
    """Whom a flight would meet, of those whose intents are known, the soonest first; `instead_of` that which
    the vehicle is on."""
    return () if flight is None else _met_of(state, flight, known_intents(state), instead_of)


def known_intents(state: AgentState) -> dict[int, NeighbourIntent]:
    """What others have told of late of where they will be."""
    now_s = state.vehicle.time_boot_s
    return {uav: told for uav, told in state.intents.items() if 0.0 <= now_s - told.said_s <= MAX_AGE_S}


def _met_of(
    state: AgentState,
    flight: Trajectory,
    others: Mapping[int, NeighbourIntent],
    instead_of: Trajectory | None,
) -> tuple[Clash, ...]:
    limits, flight = state.task.separation.limits, until_landing(flight)
    near_s = flight.times_s[0] + (SLACK_S if instead_of is None else PARTS_WITHIN_S)

    def parts(told: NeighbourIntent) -> bool:
        return _parts(flight, instead_of, told.flight, told.limits(limits))

    found = clashes_with(flight, others, limits)
    return tuple(clash for clash in found if clash.at_s > near_s or not parts(others[clash.other]))


def clashes_with(
    flight: Trajectory, others: Mapping[int, NeighbourIntent], limits: Limits
) -> tuple[Clash, ...]:
    """Whom a flight may meet, the soonest first."""
    mine = Bounds.of(flight)
    near = {uav: told for uav, told in others.items() if mine.is_within(told.bounds, _reach(told, limits))}
    wider = {uav: told.limits(limits) for uav, told in near.items() if any(told.around_m)}
    return find_clashes(flight, {uav: told.flight for uav, told in near.items()}, limits, wider=wider)


def _reach(told: NeighbourIntent, limits: Limits) -> tuple[float, float, float, float]:
    kept = told.limits(limits) if any(told.around_m) else limits
    return SLACK_S, kept.horizontal_m, kept.horizontal_m, kept.vertical_m


def _parts(flight: Trajectory, instead_of: Trajectory | None, other: Trajectory, limits: Limits) -> bool:
    """Whether two that are near each other as it is part soon, and come no nearer than that, or than the
    limits, or at least not as near as they would else: no plan could do better."""
    begin_s = flight.times_s[0]
    after = flight.since(begin_s + PARTS_WITHIN_S)
    if after is not None and find_clashes(after, {0: other}, limits):
        return False
    here, there = flight.at(begin_s), other.at(begin_s)
    least = least_share(flight, other, limits)
    if least is None or here is None or there is None:
        return True
    now = limits.share(math.dist(here[:2], there[:2]), abs(here[2] - there[2]))
    if least >= min(now, 1.0) - 1e-6:
        return True
    else_least = None if instead_of is None else least_share(instead_of, other, limits)
    return else_least is not None and least >= else_least + BETTER_BY


# --- the plan being flown


def check_own_route(state: AgentState) -> StepResult:
    """Whom the flight that it has told meets; where it is to give way, it plans anew."""
    if state.phase is not Phase.FLYING or state.own_intent is None or state.interrupted_plan is not None:
        return (
            replace(state, predicted_conflicts=frozenset(), comparisons={})
            if state.predicted_conflicts
            else state
        ), []
    state, met = _looked_at(state, state.own_intent)
    found = [clash for clash in met if _gives_way(state, clash.other)]
    if not found and not state.predicted_conflicts:
        return state, []
    others = frozenset(clash.other for clash in found)
    new = [clash for clash in found if clash.other not in state.predicted_conflicts | state.deferred_for]
    tally = state.deconfliction
    tally = replace(
        tally,
        predicted=tally.predicted + len(new),
        ceased=tally.ceased + len(state.predicted_conflicts - others - state.deferred_for),
    )
    state = replace(state, predicted_conflicts=others, deconfliction=tally)
    if not others:
        return state, []
    state = replace(state, dirty=True, must_change=True)
    text = f"its route meets {describe_clashes(new, state.vehicle.time_boot_s)}; it gives way"
    return state, [ev.NotifyOperator(text)] if new else []


def _looked_at(state: AgentState, own: Trajectory) -> tuple[AgentState, tuple[Clash, ...]]:
    """Whom its flight meets. Of a hundred a few have told something new: the others need not be compared
    again."""
    before = {uav: at for uav, at in state.comparisons.items() if at.own is own}
    told = known_intents(state)
    new = {uav: it for uav, it in told.items() if uav not in before or before[uav].other is not it}
    met = {clash.other: clash for clash in _met_of(state, own, new, None)} if new else {}
    after = {
        uav: FlightComparison(own, it, met.get(uav)) if uav in new else before[uav]
        for uav, it in told.items()
    }
    found = sorted((at.met for at in after.values() if at.met is not None), key=lambda c: (c.at_s, c.other))
    return replace(state, comparisons=after), tuple(found)


def _gives_way(state: AgentState, other: int) -> bool:
    told = state.intents[other]
    return gives_way_to((may_change(state), state.task.uav), (told.may_change, other))


# --- a new plan


def deconflict(before: AgentState, decided: StepResult, now: float) -> StepResult:
    """What becomes of a decision: a new plan is told to the others and goes out if it meets nobody."""
    state, effects = decided
    swap = next((effect for effect in effects if isinstance(effect, ev.SwapMission)), None)
    if swap is None or state.phase is not Phase.FLYING:
        return decided
    swap = msgspec.structs.replace(swap, plan=_levelled(before, swap.plan))
    flight = flight_by_plan(before, swap.plan)
    if before.alarms and _leaves_its_height(before, swap.plan):
        return _taken(state, swap, flight)  # to climb was decided for what is near, which comes first
    old = None if before.route is None else planned_flight(before)
    met = clashes_of(state, flight, old)
    new = [clash for clash in met if clash.other not in before.predicted_conflicts | before.deferred_for]
    tally = replace(before.deconfliction, predicted=before.deconfliction.predicted + len(new))
    state = replace(state, deconfliction=tally)
    mended = before.predicted_conflicts - before.deferred_for
    if not met:
        state = replace(state, deconfliction=replace(tally, by_route=tally.by_route + len(mended)))
        state, taken = _taken(state, swap, flight)
        waited = before.route is None and before.deferred_for
        return state, [ev.NotifyOperator("clear of the others: it flies on"), *taken] if waited else taken
    for height_m in _heights_m(state, swap.plan):
        plan = _levelled(before, at_height(swap.plan, height_m))
        flight = flight_by_plan(before, plan)
        if clashes_of(state, flight, old):
            continue
        mended |= {clash.other for clash in met} - before.deferred_for
        state = replace(state, deconfliction=replace(tally, by_height=tally.by_height + len(mended)))
        state = replace(state, height_offset_m=height_m - state.task.altitude_m)
        whose = describe_clashes(met, state.vehicle.time_boot_s)
        text = f"its new route would meet {whose}: it flies at {height_m:.0f} m"
        state, told = _taken(state, msgspec.structs.replace(swap, plan=plan), flight)
        return state, [ev.NotifyOperator(text), *told]
    return _put_off(before, state, swap, met, now)


def _leaves_its_height(before: AgentState, plan: FlightPlan) -> bool:
    route = before.route
    return route is not None and abs(height_of(plan) - height_of(route.plan)) >= AIRBORNE_M


def _levelled(before: AgentState, plan: FlightPlan) -> FlightPlan:
    """A plan at another height than the one before comes to it soon."""
    here, route = position_of(before), before.route
    if here is None or before.task.wings is not None:
        return plan
    if route is None:
        return with_level_off(before.task, plan, here, 0.0)  # it stands where it is until it flies it
    if not _leaves_its_height(before, plan):
        return plan
    return with_level_off(before.task, plan, here, before.swap_times.expected_s)


def _taken(state: AgentState, swap: ev.SwapMission, flight: Trajectory | None) -> StepResult:
    state = replace(
        state,
        pending=swap,
        predicted_conflicts=frozenset(),
        deferred_for=frozenset(),
        holding_since_boot_s=math.inf,
    )
    state, told = publish_intent(state, flight)
    return state, [swap, *told]


def _put_off(
    before: AgentState, state: AgentState, swap: ev.SwapMission, met: tuple[Clash, ...], now: float
) -> StepResult:
    """The plan is not taken up now: the vehicle flies on by the old one, or holds."""
    others = frozenset(clash.other for clash in met)
    new = [clash for clash in met if clash.other not in before.deferred_for]
    state = replace(
        state,
        pending=None,
        because=swap.because,
        dirty=True,
        must_change=before.must_change,
        late_s=before.late_s,
        deferred_for=before.deferred_for | others,
    )
    old = [clash for clash in clashes_of(state, planned_flight(before)) if _gives_way(before, clash.other)]
    near_s = old[0].at_s - state.vehicle.time_boot_s if old else HOLDS_WITHIN_S
    again_s = AGAIN_SOON_S if near_s < 2.0 * PARTS_WITHIN_S else AGAIN_S
    state = replace(state, retry_at_s=now + again_s)
    holds = before.route is None or (near_s < HOLDS_WITHIN_S and _may_hold(before))
    does = "it holds" if holds else "it flies on by the old one"
    waits = others | (before.predicted_conflicts if holds else frozenset())
    if holds or not old:
        by_waiting = state.deconfliction.by_waiting + len(waits - before.deferred_for)
        state = replace(state, deconfliction=replace(state.deconfliction, by_waiting=by_waiting))
    told: list[ev.Effect] = []
    if new:
        whose = describe_clashes(new, state.vehicle.time_boot_s)
        told.append(ev.NotifyOperator(f"its new route would meet {whose} at any height: {does}"))
    if not holds:
        return state, told
    state, ordered = _hold(state, before.route or swap)
    return state, [*told, *ordered]


def _may_hold(state: AgentState) -> bool:
    """And stands in nobody's way there."""
    task, here, now_s = state.task, position_amsl(state), state.vehicle.time_boot_s
    if here is None or task.separation.action != "hold" or task.wings is not None or not may_give_way(state):
        return False
    stop = stopping_point(state, here)
    return not clashes_of(state, Trajectory((now_s, now_s + STANDS_S), (stop, stop)))


def _hold(state: AgentState, swap: ev.SwapMission) -> StepResult:
    """As who gives way to what is near; it looks again after a while."""
    now_s = state.vehicle.time_boot_s
    state, ordered = command(
        state,
        ev.FlightOrder.HOLD,
        interrupted_plan=swap,
        route=None,
        dirty=False,
        retry_at_s=0.0,
        n_holds=state.n_holds + (state.ordered is not ev.FlightOrder.HOLD),
        resume_earliest_boot_s=now_s + AGAIN_S,
        holding_since_boot_s=min(state.holding_since_boot_s, now_s),
        predicted_conflicts=frozenset(),
    )
    state, told = publish_intent(state, planned_flight(state))
    return state, [*ordered, *told]


# --- heights


def _heights_m(state: AgentState, plan: FlightPlan) -> list[float]:
    """Other heights above home to try, the lowest first: its own, and just above the others'."""
    task, vehicle = state.task, state.vehicle
    flown_m = height_of(plan)
    if vehicle.alt_amsl_m is None or vehicle.alt_rel_m is None:
        return []
    home_m = vehicle.alt_amsl_m - vehicle.alt_rel_m
    keeps_m = HEIGHT_MARGIN * task.separation.limits.vertical_m
    tops_m = {
        max(point[2] for point in told.flight.points) + told.around_m[1] - home_m
        for told in state.intents.values()
    }
    wanted = {task.altitude_m, flown_m + keeps_m, *(top_m + keeps_m for top_m in tops_m)}
    most_m = ceiling_m(state)
    allowed = sorted(h for h in wanted if task.altitude_m <= h <= most_m and abs(h - flown_m) > 0.1)
    return allowed[:MOST_HEIGHTS]
