"""Landing queue: a copter whose descent would meet another vehicle hovers above its landing spot until the
way down is clear. Pure.

Vehicles with the same goal arrive at different heights, and a landing descends through all heights below.

| the other vehicle | this vehicle |
|---|---|
| higher | lands |
| lower, cannot change its plan (lands or holds) | waits if the conflict is less than 15 s ahead |
| lower, can change its plan (en route) | waits if the conflict is less than 6 s ahead |
| at the same height within 1 m | lands if its system id is lower; otherwise as for a lower vehicle |

The other vehicle, if en route, avoids conflicts further ahead (`route_deconfliction`). Below 5 m no wait
begins. An urgent failsafe prevents a wait, and ends one that has lasted for 10 s. While the link is lost, the
queue does nothing. A fixed wing does not wait, because it cannot hover.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any

from swarmctl.agent.commands import StepResult, command
from swarmctl.agent.failsafes.base import is_urgent
from swarmctl.agent.phases import Phase
from swarmctl.agent.replan.copter_trajectory import fly_along, land_from, waypoints_of
from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.check import (
    WAIT_WITHIN_S,
    clashes_if_changed,
    clashes_with,
    come_within,
    describe_clashes,
    near_flights,
    waits_within_s,
)
from swarmctl.agent.traffic.known_flights import known_flights
from swarmctl.agent.traffic.own_flight import planned_flight, to_shared_frame
from swarmctl.agent.traffic.prediction import hears_nobody, position_amsl, position_of
from swarmctl.agent.traffic.priority import Activity, gives_way, own_standing, standing_of
from swarmctl.agent.traffic.route_hold import (
    follows_own_order,
    give_up,
    goes_second,
    hold_would_block,
    would_block,
)
from swarmctl.agent.traffic.separation.clash import Clash
from swarmctl.agent.traffic.separation.other_vehicles import KnownFlight, Others
from swarmctl.agent.traffic.separation.trajectory import LocalPoint, Trajectory, landing_start_s
from swarmctl.agent.traffic.wait import WAITS_ABOVE_M, Verdict, Wait, WaitFor, begin_wait, verdict
from swarmctl.core import events as ev
from swarmctl.core.mission import Waypoint
from swarmctl.core.planar import PlanarPoint
from swarmctl.core.records import replace
from swarmctl.core.vehicle import Landed

CLEAR_AHEAD_S = 20.0
"""Time ahead for which the landing has to be predicted clear [s]."""
DESCENT_DELAYS_S = (0.0, 2.0, 4.0)
"""Delays of the descent that are checked [s]: a vehicle takes some seconds to follow the order."""
AT_SPOT_M = 1.0
"""Horizontal distance from the landing spot within which the vehicle lands where it is [m]."""
HOLD_BEFORE_DESCENT_S = 3.0
"""Longest time before the descent at which a conflict of the descent causes a hold [s]."""


def arrive(state: AgentState) -> AgentState:
    """Return the state of a vehicle that enters its goal cell: its landing has priority, and is announced."""
    now_s, wait = state.vehicle.time_boot_s, state.wait
    changes: dict[str, Any] = {
        "plans": state.plans.not_due(),
        "arrived_boot_s": now_s,
    }
    if wait is not None and state.waits_for(WaitFor.ROUTE):  # it stops in its goal cell
        until_s, mission = wait.deadline_boot_s, wait.mission
        changes["wait"] = begin_wait(
            WaitFor.DESCENT, wait.since_boot_s, until_s=until_s, mission=mission, to=wait.to
        )
    return state.enter(Phase.LANDING, **changes).with_new_flight()


def queue_for_landing(state: AgentState) -> StepResult:
    """Hold for another vehicle, or land when the descent is clear. Called for each telemetry message."""
    if state.phase is not Phase.LANDING or state.task.wings is not None or state.lost:
        return state, []
    here, wait = position_amsl(state), state.wait if state.is_waiting else None
    if here is None:
        return state, []
    if wait is not None:
        return _land_if_clear(state, wait, here)
    return _wait_if_conflicting(state, here) if _may_wait(state) else (state, [])


def _land_where_it_is(state: AgentState, text: str) -> StepResult:
    plans = state.plans.with_mission(state.interrupted)
    state, ordered = command(state, ev.FlightOrder.LAND, plans=plans, wait=None)
    return state, [ev.NotifyOperator(text), *ordered]


def _may_wait(state: AgentState) -> bool:
    flies_plan = state.plans.mission is not None and state.plans.pending is None
    return flies_plan and not is_urgent(state.demands) and follows_own_order(state)


def _wait_if_conflicting(state: AgentState, here: LocalPoint) -> StepResult:
    assert state.plans.mission is not None
    flight, now_s = planned_flight(state), state.vehicle.time_boot_s
    if flight is None:
        return state, []
    others, limits = known_flights(state), state.task.separation.limits
    near = near_flights(flight, others, limits)
    waited_for = _go_first(state, here, near)
    if not waited_for:
        return state, []
    descends_s = landing_start_s(flight)
    # Until shortly before the descent, only conflicts of the level flight count. For a conflict of the
    # descent, the vehicle stops later, near its landing spot, unless it would stand in the way there.
    spot = (*waypoints_of(state.task, state.plans.mission.plan)[-1], here[2])
    stops_later = descends_s > now_s + HOLD_BEFORE_DESCENT_S and not hold_would_block(state, spot, near)
    until_s = descends_s if stops_later else math.inf
    clashes = [
        clash
        for clash in clashes_with(state, flight, waited_for)
        if clash.at_s < min(until_s, now_s + waits_within_s(waited_for[clash.other]))
    ]
    if not clashes or would_block(state):
        return state, []
    n = len(clashes)
    state = replace(state, conflicts=state.conflicts.counted(predicted=n, by_waiting=n))
    state, effects = hold_before_landing(state, frozenset(clash.other for clash in clashes))
    text = f"the landing would conflict with {describe_clashes(state, clashes)}"
    text += "; the vehicle holds until its descent is clear [landing-queue]"
    return state, [ev.NotifyOperator(text), *effects]


def hold_before_landing(state: AgentState, to: frozenset[int]) -> StepResult:
    """Order a hold until the descent is clear; a second hold on the way to one landing keeps the deadline."""
    mission, now_s = state.plans.mission or state.interrupted, state.vehicle.time_boot_s
    wait = begin_wait(WaitFor.DESCENT, now_s, mission=mission, to=to, before=state.wait)
    conflicts = state.conflicts.counted(holds=1)
    return command(state, ev.FlightOrder.HOLD, wait=wait, conflicts=conflicts)


def _go_first(state: AgentState, here: LocalPoint, others: Others) -> dict[int, KnownFlight]:
    """Return the flights of the vehicles that go first: those below, by the rule of priority."""
    mine = own_standing(state, here[2])
    found = {}
    for uav, known in others.items():
        # Over the landing place only heights and system ids count: the lower vehicle is in the way.
        # A silent vehicle may be anywhere on its way down.
        can_yield = not known.may_be_late
        theirs = replace(standing_of(state, uav, known), activity=Activity.LANDING, can_yield=can_yield)
        if gives_way(mine, theirs):
            found[uav] = known
    return found


# --- end of the wait


def _land_if_clear(state: AgentState, wait: Wait, here: LocalPoint) -> StepResult:
    now_s, confirmed = state.vehicle.time_boot_s, state.order.is_followed
    if not confirmed and (state.vehicle.alt_rel_m or 0.0) < WAITS_ABOVE_M:
        return _land_unconfirmed(state, "it is too low to wait")
    # A stopped vehicle may still report LANDING for some seconds, and an unconfirmed one may still move.
    arrived_s = -math.inf if state.arrived_boot_s is None else state.arrived_boot_s
    may_move = state.vehicle.landed is Landed.LANDING if confirmed else now_s - arrived_s < wait.rule.least_s

    def is_clear() -> bool:
        return not (may_move or hears_nobody(state) or _descent_conflicts(state, here))

    urgent, second = is_urgent(state.demands), partial(goes_second, state)
    ends, wait = verdict(wait, now_s, is_clear, goes_second=second, urgent=urgent)
    match ends:
        case Verdict.OVER if urgent:
            text = "an urgent failsafe ends the wait; the vehicle lands where it is [landing-urgent]"
            return _land_where_it_is(state, text)
        case Verdict.OVER:
            return give_up(state)
        case Verdict.CLEAR if not confirmed:
            return _land_unconfirmed(state, "its descent is clear")
        case Verdict.CLEAR:
            state, ordered = _land(state)
            text = "the descent is clear; the vehicle lands [descent-clear]"
            return state, [ev.NotifyOperator(text), *ordered]
    if ends is Verdict.WAIT or not wait.is_report_due(now_s):
        return replace(state, wait=wait), []
    text = (
        f"the vehicle has held before its landing for at least {wait.rule.report_every_s:.0f} s; the landing "
    )
    text += f"would still conflict with {describe_clashes(state, _descent_conflicts(state, here))}"
    text += "; the vehicle continues to hold [landing-queue-long]"
    return replace(state, wait=wait.reported(now_s)), [ev.NotifyOperator(text)]


def _land_unconfirmed(state: AgentState, why: str) -> StepResult:
    text = f"the vehicle did not confirm the hold before its landing, and {why}"
    return _land_where_it_is(state, f"{text}; the vehicle lands where it is [landing-unconfirmed]")


def _descent_conflicts(state: AgentState, here_amsl: LocalPoint) -> tuple[Clash, ...]:
    """Return the conflicts within CLEAR_AHEAD_S of a landing that starts now or a little later."""
    here, flight = position_of(state), None
    if here is not None:
        spot, up_m = _landing_spot(state), here[2]
        is_at_spot = math.dist(here[:2], spot) <= AT_SPOT_M
        landing = (
            land_from([here], [0.0])
            if is_at_spot
            else fly_along(
                here,
                up_m,
                [spot],
                state.task.speed_m_s,
                start_delay_s=state.vehicle.start_delay_s,
            )
        )
        flight = to_shared_frame(state, landing)
    if flight is None:
        return ()
    until_s = state.vehicle.time_boot_s + CLEAR_AHEAD_S
    waited_for = _go_first(state, here_amsl, known_flights(state))
    for delay_s in DESCENT_DELAYS_S:
        clashes = clashes_with(state, flight.later(delay_s), waited_for)
        if soon := tuple(clash for clash in clashes if clash.at_s < until_s):
            return () if _leaves_the_way(state, flight, waited_for) else soon
    return ()


def _leaves_the_way(state: AgentState, landing: Trajectory, others: Others) -> bool:
    """Return whether a landing takes the vehicle out of the way of one that soon flies through its hold."""
    hold, limits = planned_flight(state), state.task.separation.limits
    if hold is None:
        return False
    until_s = state.vehicle.time_boot_s + WAIT_WITHIN_S
    is_in_the_way = come_within(
        [hold.lasting(until_s)],
        [
            i.flight.lasting(until_s)
            for i in others.values()
            if not i.may_change and not i.flight.ends_in_hold
        ],
        limits,
        1.0,
    )
    return is_in_the_way and not clashes_if_changed(state, landing, others, hold)


def _landing_spot(state: AgentState) -> PlanarPoint:
    assert state.interrupted is not None
    return waypoints_of(state.task, state.interrupted.plan)[-1]


def _land(state: AgentState) -> StepResult:
    """Order the landing if the vehicle is at its landing spot; otherwise upload a mission to the spot."""
    present, here, spot = state.interrupted, position_of(state), _landing_spot(state)
    assert present is not None
    assert here is not None
    if math.dist(here[:2], spot) <= AT_SPOT_M:
        return command(
            state, ev.FlightOrder.LAND, plans=state.plans.with_mission(present), wait=_ended(state)
        )
    begins = Waypoint(*state.task.grid.frame.to_geodetic(*here[:2]), here[2])
    landing = replace(present.plan.landing, alt_rel_m=here[2])
    plan = replace(present.plan, track=(), landing=landing, begins=begins, leaves_ahead=False, from_hold=True)
    new = replace(present, plan_id=state.plans.next_plan_id, plan=plan, because=(), track=None)
    state = replace(
        state,
        wait=_ended(state),
        plans=state.plans.uploading(new).from_own_hold(),
        order=state.order.noted(ev.FlightOrder.LAUNCH),
    )
    return state.with_new_flight(), [ev.SwapMission(new)]


def _ended(state: AgentState) -> Wait | None:
    return state.wait and state.wait.ended(state.vehicle.time_boot_s)
