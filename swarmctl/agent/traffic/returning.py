"""Return queue: a vehicle that returns by a failsafe holds until its path home is clear. Pure.

Vehicles broadcast their returns, and their holds before a return.

| situation | rule |
|---|---|
| one vehicle returns, another waits | the returning vehicle is first |
| two vehicles wait | the lower system id is first |
| two vehicles started at the same time | within 5 s the vehicle with the higher system id holds again |
| another vehicle soon flies through the path home | the vehicle holds, if its hold is in nobody's way |
| urgent return (very low battery) | is first; holds for 10 s at most while others fly on its path |
| a vehicle has waited for 120 s | returns, or lands if only the ground is clear |
| a vehicle has waited for 120 s before a landing | lands, or returns if only the way home is clear |
| several vehicles wait so long | lower system ids start up to 60 s earlier, in 10 s steps |
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from swarmctl.agent.commands import StepResult, command
from swarmctl.agent.failsafes import lost_link
from swarmctl.agent.failsafes.base import DemandKind, is_urgent, urgent_reason
from swarmctl.agent.formation.near_members import with_members_shown
from swarmctl.agent.phases import IN_FLIGHT, Phase
from swarmctl.agent.state import AgentState, Task
from swarmctl.agent.traffic.check import clashes_of_route, waits_within_s
from swarmctl.agent.traffic.known_flights import known_flights
from swarmctl.agent.traffic.own_flight import landing_flight, return_flights
from swarmctl.agent.traffic.prediction import hears_nobody, position_amsl
from swarmctl.agent.traffic.priority import Activity, Standing, activity_of, gives_way, reported_standing
from swarmctl.agent.traffic.return_schedule import may_be_returning, position_from_state, schedule_for
from swarmctl.agent.traffic.route_hold import would_block
from swarmctl.agent.traffic.separation.other_vehicles import NeighbourReport
from swarmctl.agent.traffic.separation.trajectory import Trajectory
from swarmctl.agent.traffic.wait import WAITS_ABOVE_M, Verdict, Wait, WaitFor, begin_wait, verdict
from swarmctl.core import events as ev
from swarmctl.core.geo import LatLon
from swarmctl.core.messages import VehiclePosition
from swarmctl.core.records import replace

STAGGER_S = 10.0
"""Time between starts at the end of the longest wait [s], the lowest system id first."""
MAX_STAGGERED = 6
"""Greatest number of steps of STAGGER_S by which a vehicle starts early."""
CLIMBED_SHARE = 0.9
"""Share of the cruise altitude above which a fixed wing has finished its take-off."""


def return_target(state: AgentState) -> LatLon | None:
    """Return the home of a vehicle that returns or waits to return, also after a release or a lost link.

    The result is None for any other vehicle, and if home is unknown.
    """
    vehicle = state.vehicle
    match state.phase:
        case Phase.LEAVING:
            returns = state.order.given is ev.FlightOrder.RETURN
        case Phase.HOLDING if not state.lost:
            returns = state.is_waiting and not state.waits_for(WaitFor.GROUND)
        case Phase.RELEASED:
            returns = vehicle.armed and vehicle.mode_role == "return"
        case _:
            returns = state.lost and state.phase in IN_FLIGHT and _returns_on_lost_link(state)
    return vehicle.home_lat_lon if returns else None


def _returns_on_lost_link(state: AgentState) -> bool:
    return any(isinstance(r.params, lost_link.Params) and r.params.does == "return" for r in state.task.rules)


def note_returning(state: AgentState, reports: Mapping[int, NeighbourReport]) -> AgentState:
    """Store the last states of vehicles that return or wait to return."""
    now_s = state.vehicle.time_boot_s
    known = {**state.received.returning, **reports}
    kept = {
        uav: report
        for uav, report in known.items()
        if report.state.returns_to is not None and report.at_s <= now_s
    }
    return (
        state
        if kept == state.received.returning
        else replace(state, received=replace(state.received, returning=kept))
    )


def wait_to_return(state: AgentState, **changes: Any) -> StepResult | None:
    """Hold until the return path is clear; `changes` are further changed fields.

    Return None if the path is clear already, or if the vehicle cannot hold.
    """
    if _takes_off(state) or not _is_blocked(state):
        return None
    waiting = begin_wait(WaitFor.RETURN_PATH, state.vehicle.time_boot_s, before=state.wait)
    return hold_and_wait(state, waiting, **changes)


def hold_and_wait(state: AgentState, wait: Wait, *, by_person: bool = False, **changes: Any) -> StepResult:
    """Hold for a wait before a return or landing; `by_person` and `changes` as in `command`."""
    changes |= {"phase": Phase.HOLDING, "wait": wait}
    if holds_by_order(state):
        return replace(state, **changes, sent=state.sent.state_due()), []
    return command(state, ev.FlightOrder.HOLD, by_person=by_person, **changes)


def holds_by_order(state: AgentState) -> bool:
    """Return whether the vehicle holds already, by an order of this agent."""
    return state.phase is Phase.HOLDING and state.order.given is ev.FlightOrder.HOLD


def _is_blocked(state: AgentState) -> bool:
    """Return whether others return first, or fly on the return path although this vehicle may hold."""
    if not _is_its_turn(state):
        return True
    # In silence the others do not expect that a flying vehicle holds, but one in hold waits on.
    is_expected = state.is_waiting or not hears_nobody(with_members_shown(state))
    return is_expected and holds_first(state, ev.FlightOrder.RETURN)


def _is_its_turn(state: AgentState) -> bool:
    """Return whether no other return goes first; an urgent return is first of all."""
    return bool(urgent_reason(state.demands)) or is_return_path_clear(state, state.received.returning)


def may_hold_before_leaving(state: AgentState) -> bool:
    """Return whether a return or landing may hold for others: it is not urgent, and has time left to wait."""
    if state.launch.is_aborted or is_urgent(state.demands):
        return False
    wait = state.wait
    return (
        wait is None
        or wait.purpose is not _purpose(state)
        or (state.vehicle.time_boot_s < wait.deadline_boot_s)
    )


def _purpose(state: AgentState) -> WaitFor:
    return WaitFor.GROUND if state.order.given is ev.FlightOrder.LAND else WaitFor.RETURN_PATH


def hold_before_leaving(state: AgentState, to: frozenset[int]) -> StepResult:
    """Hold until the return path or the ground is clear; all holds of one order have one deadline."""
    now_s, wait, purpose = state.vehicle.time_boot_s, state.wait, _purpose(state)
    if wait is not None and wait.purpose is purpose:
        waiting = replace(wait.again(), since_boot_s=now_s, checked_boot_s=now_s, to=wait.to | to)
    else:
        waiting = begin_wait(purpose, now_s, to=to)
    return hold_and_wait(state, waiting)


def _takes_off(state: AgentState) -> bool:
    """Return whether a fixed wing still climbs after take-off, and would circle too low in hold."""
    wings, up_m = state.task.wings, state.vehicle.alt_rel_m
    if wings is None or up_m is None:
        return False
    return up_m < min(wings.takeoff_height_m, CLIMBED_SHARE * state.task.altitude_m)


def start_return(state: AgentState, *, may_hold_again: bool = False, **changes: Any) -> StepResult:
    """Order the return; `changes` are further changed fields.

    `may_hold_again`: the vehicle gives way again if another one has started at the same time.
    """
    now_s = state.vehicle.time_boot_s
    if may_hold_again:
        changes["wait"] = begin_wait(WaitFor.RETURN_PATH, now_s, before=state.wait).ended(now_s)
    return command(state, ev.FlightOrder.RETURN, phase=Phase.LEAVING, **{"wait": None, **changes})


def update_return(state: AgentState) -> StepResult:
    """Start a waiting return, or interrupt a return that has just started. Called for each position."""
    wait = state.wait
    if wait is None or wait.purpose not in (WaitFor.RETURN_PATH, WaitFor.GROUND, WaitFor.TURN):
        return state, []
    if wait.purpose is WaitFor.GROUND:
        return _land_if_clear(state, wait) if wait.is_on else (state, [])
    return _wait_or_start(state, wait) if wait.is_on else _yield_to_simultaneous_start(state, wait)


def _land_if_clear(state: AgentState, wait: Wait) -> StepResult:
    clear = partial(is_way_clear, state, ev.FlightOrder.LAND)
    ends, wait = verdict(wait, state.vehicle.time_boot_s, clear)
    if ends in (Verdict.WAIT, Verdict.BLOCKED):
        return replace(state, wait=wait), []
    is_blocked = ends is Verdict.OVER and _landing_conflicts(state)
    blocked = "the ground is not clear at the end of the wait" if is_blocked else ""
    if blocked and _may_return_instead(state):
        outcome = _outcome_with(state, blocked)
        state, ordered = start_return(state, may_hold_again=_is_its_turn(state), outcome=outcome)
        return state, [ev.NotifyOperator(f"{blocked}; the vehicle returns [landing-blocked]"), *ordered]
    text = f"{blocked}; the vehicle lands as ordered [lands-anyway]"
    if not blocked:
        text = "the ground is clear; the vehicle lands as ordered [ground-clear]"
    state, ordered = _order_landing(state, wait)
    return state, [ev.NotifyOperator(text), *ordered]


def _outcome_with(state: AgentState, text: str) -> str:
    return f"{state.outcome}; {text}" if state.outcome else text


def _may_return_instead(state: AgentState) -> bool:
    """Return whether the way home is clear, and no rule demands that the vehicle lands.

    It need not be the vehicle's turn: the other choice is a landing with a vehicle below.
    """
    if hears_nobody(state) or any(demand and demand.kind is DemandKind.LAND for demand in state.demands):
        return False
    return bool(flights := return_flights(state)) and not _leaving_conflicts(state, flights)


def _order_landing(state: AgentState, wait: Wait, **changes: Any) -> StepResult:
    ended = wait.ended(state.vehicle.time_boot_s)
    return command(state, ev.FlightOrder.LAND, phase=Phase.LEAVING, wait=ended, **changes)


def _wait_or_start(state: AgentState, wait: Wait) -> StepResult:
    now_s, urgent = state.vehicle.time_boot_s, bool(urgent_reason(state.demands))
    # At the end of the longest wait, vehicles start one after the other.
    n_later = _n_waiting_with_higher_id(state) if wait.purpose is WaitFor.RETURN_PATH else 0
    clear = partial(is_way_clear, state, ev.FlightOrder.RETURN)
    early_s = STAGGER_S * min(n_later, MAX_STAGGERED)
    ends, wait = verdict(wait, now_s, clear, early_s=early_s, urgent=urgent)
    match ends:
        case Verdict.OVER:
            ended = wait.over(now_s) if wait.purpose is WaitFor.RETURN_PATH else None
            if _return_conflicts(state) and not _landing_conflicts(state):
                text = "the return path is not clear at the end of the wait"
                state, ordered = _order_landing(state, wait, outcome=_outcome_with(state, text))
                return state, [
                    ev.NotifyOperator(f"{text}; the vehicle lands where it is [return-blocked]"),
                    *ordered,
                ]
            return start_return(state, wait=ended)
        case Verdict.WAIT | Verdict.BLOCKED:
            return replace(state, wait=wait), []
    state, ordered = start_return(state, may_hold_again=True)
    return state, [
        ev.NotifyOperator("the return path is clear; the vehicle returns [return-clear]"),
        *ordered,
    ]


def is_way_clear(state: AgentState, order: ev.FlightOrder) -> bool:
    """Return whether the vehicle can return, or land here, without a conflict; not if it hears nobody."""
    if hears_nobody(state):
        return False
    if order is ev.FlightOrder.LAND:
        return not _landing_conflicts(state)
    return _is_its_turn(state) and not _return_conflicts(state)


def holds_first(state: AgentState, order: ev.FlightOrder) -> bool:
    """Return whether a return or landing first waits for other vehicles: its way is not clear."""
    # Members of its group expect that the vehicle stops, but not that it flies through the group.
    return may_wait_to_leave(state) and not is_way_clear(with_members_shown(state), order)


def may_wait_to_leave(state: AgentState) -> bool:
    """Return whether the vehicle may hold before an ordered return or landing.

    It has to be high enough, and a new hold must not block a vehicle that cannot give way.
    """
    up_m, here = state.vehicle.alt_rel_m, position_amsl(state)
    if here is None or up_m is None or up_m < WAITS_ABOVE_M or _takes_off(state):
        return False
    return state.is_waiting or not would_block(state)


def _return_conflicts(state: AgentState) -> bool:
    return _leaving_conflicts(state, return_flights(state))


def _landing_conflicts(state: AgentState) -> bool:
    flight = landing_flight(state)
    return flight is not None and _leaving_conflicts(state, [flight])


def _leaving_conflicts(state: AgentState, flights: Sequence[Trajectory]) -> bool:
    """Return whether a return or landing by any of these flights would soon conflict with another flight."""
    now_s, others = state.vehicle.time_boot_s, known_flights(state)
    return any(
        clash.at_s - now_s < waits_within_s(others[clash.other])
        for flight in flights
        for clash in clashes_of_route(state, flight, others)
    )


def _n_waiting_with_higher_id(state: AgentState) -> int:
    now_s = state.vehicle.time_boot_s
    return sum(
        uav > state.task.uav and report.state.phase == Phase.HOLDING and report.is_recent(now_s)
        for uav, report in state.received.returning.items()
    )


def _yield_to_simultaneous_start(state: AgentState, wait: Wait) -> StepResult:
    """Hold again if the path is not clear of a vehicle with priority that started at the same time."""
    now_s = state.vehicle.time_boot_s
    if not wait.may_go_on(now_s) or now_s >= wait.deadline_boot_s:
        return state, []
    mine = Standing(Activity.LANDING, True, state.task.uav)
    first = {
        uav: report
        for uav, report in state.received.returning.items()
        if gives_way(mine, Standing(Activity.LANDING, True, uav))
    }
    if urgent_reason(state.demands) or is_return_path_clear(state, first):
        return state, []
    held = wait_to_return(state)
    if held is None:
        return state, []
    text = "another vehicle started a return at the same time; this vehicle holds until its path is clear"
    return held[0], [ev.NotifyOperator(f"{text} [return-yields]"), *held[1]]


def is_return_path_clear(state: AgentState, reports: Mapping[int, NeighbourReport]) -> bool:
    """Return whether the return path is clear of the vehicles of `reports` that return or have priority.

    The result is True if position or home is unknown, because such a vehicle does not wait.
    """
    own, now_s = position_for_return(state), state.vehicle.time_boot_s
    if own is None:
        return True
    own = replace(own, is_returning=False)
    mine = Standing(Activity.WAITING, True, state.task.uav)
    positions = {}
    for uav, report in reports.items():
        position = position_from_state(report.state, own)
        if position is None:
            continue
        if activity_of(report.state.phase) is Activity.WAITING:
            counts = report.is_recent(now_s) and gives_way(mine, reported_standing(uav, report))
        else:
            counts = may_be_returning(position, now_s - report.at_s)
        if counts:
            positions[uav] = position
    return not positions or schedule_for({**positions, state.task.uav: own}).begins_s[state.task.uav] == 0.0


def position_for_return(state: AgentState) -> VehiclePosition | None:
    """Return position, home and speed for the schedule of returns; None if unknown or not in flight."""
    v = state.vehicle
    if state.phase not in IN_FLIGHT or v.lat_lon is None or v.alt_amsl_m is None:
        return None
    if v.home_lat_lon is None or v.home_alt_amsl_m is None:
        return None
    limits = state.task.separation.limits
    return VehiclePosition(
        *v.lat_lon,
        v.alt_amsl_m,
        *v.home_lat_lon,
        v.home_alt_amsl_m,
        speed_m_s=state.task.speed_m_s,
        # A fixed wing in hold may be anywhere on its circle.
        min_separation_m=(limits.horizontal_m + 2.0 * holding_radius_m(state.task), limits.vertical_m),
        # Also True for an urgent return that a failsafe demands and the vehicle does not follow yet.
        is_returning=follows_order(state, ev.FlightOrder.RETURN)
        or (bool(urgent_reason(state.demands)) and state.order.given is not ev.FlightOrder.LAND),
    )


def holding_radius_m(task: Task) -> float:
    """Return the radius of the vehicle's holding circle [m]; 0 for a copter."""
    return 0.0 if task.wings is None else task.wings.loiter_radius_m


def follows_order(state: AgentState, order: ev.FlightOrder) -> bool:
    """Return whether the vehicle follows this order in flight; a temporary hold does not count."""
    return (
        state.phase in IN_FLIGHT
        and state.order.given is order
        and state.order.is_followed
        and not state.is_waiting  # a hold to wait is temporary
    )
