"""Over its goal: who would come down on somebody that cannot give way any more waits above. Pure.

Those that fly to one goal come over one cell at heights of their own, but a landing leads down through the
heights of all below. Who is still on its way there gives way to it (`swarmctl.agent.traffic.route_deconfliction`); who is over
the goal as well gives way to nobody. Of two such the higher one waits, over its own landing place, until its
way down is clear. Nobody waits for one that is above it, so no two wait for each other.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import msgspec

from swarmctl.agent.failsafes.base import STRENGTH, DemandKind
from swarmctl.agent.orders import StepResult, command
from swarmctl.agent.own_modes import own_mode_roles
from swarmctl.agent.replan.copter_trajectory import fly_along, land_from, waypoints_of
from swarmctl.agent.state import AgentState, Phase
from swarmctl.agent.traffic.collision_avoidance import (
    end_give_way,
    position_of,
    predict,
    silent_neighbours,
    stopping_point,
)
from swarmctl.agent.traffic.intents import (
    STANDS_S,
    planned_flight,
    position_amsl,
    publish_intent,
    to_shared_frame,
)
from swarmctl.agent.traffic.route_deconfliction import PARTS_WITHIN_S, clashes_with, known_intents
from swarmctl.agent.traffic.separation.clash import Clash, describe_clashes
from swarmctl.agent.traffic.separation.trajectory import Bounds, LocalPoint, Trajectory, landing_start_s
from swarmctl.agent.traffic.separation.watch import NeighbourIntent
from swarmctl.core import events as ev
from swarmctl.core.mission import Waypoint
from swarmctl.core.planar import PlanarPoint
from swarmctl.core.vehicle import Landed

LOOKS_EVERY_S = 0.2
WAITS_WITHIN_S = 15.0
"""For what would meet it later it does not wait yet: that may still change."""
LEAST_WAIT_S = 3.0
"""Until then it stands, and what it has told is heard."""
CLEAR_FOR_S = 20.0
"""So long its way down has to be clear before it comes down again …"""
STARTS_AFTER_S = (0.0, 2.0, 4.0)
"""… also where the order takes some seconds."""
AT_PLACE_M = 1.0
"""so near over ground to its landing place it may come down where it is"""
LEAST_M = 5.0
"""above home: who is lower comes down"""
STOPS_BEFORE_S = 3.0
"""So long before it begins to come down it is told to stop: near its landing place, and not lower yet."""
SAME_HEIGHT_M = 1.0
"""Of two that are no farther apart than this in height neither is the higher one for both."""
SAYS_AGAIN_S = 60.0


def queue_for_landing(state: AgentState) -> StepResult:
    """With each position of what lands at its goal: it stops for who is below, or comes down again."""
    if state.phase is not Phase.LANDING or state.task.wings is not None or state.lost:
        return state, []
    if state.interrupted_plan is not None and _is_pressed(state):
        return _lands_here(state, "it waits above no longer, and lands where it is")
    now_s, here = state.vehicle.time_boot_s, position_amsl(state)
    if here is None or 0.0 <= now_s - state.descent_checked_boot_s < LOOKS_EVERY_S:
        return state, []
    state = replace(state, descent_checked_boot_s=now_s)
    if state.interrupted_plan is not None:
        return _goes_down_if_clear(state, here)
    return _waits_if_met(state, here) if _may_wait(state) else (state, [])


def land_unconfirmed(state: AgentState) -> StepResult:
    """Who was told to wait and has not been seen to do so is not told again where that is of no use any more:
    it is low by now, or its way down is clear."""
    if (
        state.phase is not Phase.LANDING
        or state.interrupted_plan is None
        or state.order_followed
        or state.lost
    ):
        return state, []
    here, up_m = position_amsl(state), state.vehicle.alt_rel_m
    if here is None or up_m is None:
        return state, []
    is_low = up_m < LEAST_M
    waits = state.vehicle.time_boot_s < state.resume_earliest_boot_s or bool(
        _met_below(state, _below(state, here))
    )
    if waits and not is_low:
        return state, []
    return _lands_here(state, "it has not been heard to wait above, and need not any more: it comes down")


def _lands_here(state: AgentState, text: str) -> StepResult:
    state, ordered = command(replace(end_give_way(state), route=state.interrupted_plan), ev.FlightOrder.LAND)
    state, told = publish_intent(state, planned_flight(state))
    return state, [ev.NotifyOperator(text), *ordered, *told]


def _is_pressed(state: AgentState) -> bool:
    """Whether a rule wants it down, or home, without waiting."""
    demands = (demand for demand in state.demands if demand is not None and demand.urgent)
    return any(STRENGTH[demand.kind] >= STRENGTH[DemandKind.RETURN] for demand in demands)


def _may_wait(state: AgentState) -> bool:
    vehicle, action = state.vehicle, state.task.separation.action
    if action == "none" or state.route is None or state.pending is not None or _is_pressed(state):
        return False
    follows = state.order_followed or state.ordered in (None, ev.FlightOrder.LAUNCH)
    is_ours = follows and vehicle.mode_role in own_mode_roles(state)
    return is_ours and vehicle.armed and vehicle.alt_rel_m is not None and vehicle.alt_rel_m >= LEAST_M


def _waits_if_met(state: AgentState, here: LocalPoint) -> StepResult:
    assert state.route is not None
    flight, now_s = planned_flight(state), state.vehicle.time_boot_s
    if flight is None:
        return state, []
    others = _others(state)
    below = {uav: told for uav, told in others.items() if _waits_for(state, here, uav, told)}
    lands_s = landing_start_s(flight)
    # Where it is level yet is its own: for what meets it on its way down it stops there.
    until_s = lands_s if lands_s > now_s + STOPS_BEFORE_S else math.inf
    met = [
        clash
        for clash in clashes_with(flight, below, state.task.separation.limits)
        if clash.at_s < min(until_s, now_s + _waits_within_s(below[clash.other]))
    ]
    if not met or _is_in_the_way(state, here, others):
        return state, []
    tally, n = state.deconfliction, len(met)
    tally = replace(tally, predicted=tally.predicted + n, by_waiting=tally.by_waiting + n)
    state, ordered = command(
        replace(state, n_holds=state.n_holds + 1, deconfliction=tally),
        ev.FlightOrder.HOLD,
        interrupted_plan=state.route,
        gave_way_to={at.other: heard for at in met if (heard := state.neighbours.get(at.other)) is not None},
        holding_since_boot_s=now_s,
        resume_earliest_boot_s=now_s + LEAST_WAIT_S,
    )
    state, told = publish_intent(state, planned_flight(state))
    text = f"over its goal its way down meets {describe_clashes(met, now_s)}: it waits above"
    return state, [ev.NotifyOperator(text), *ordered, *told]


def _waits_within_s(told: NeighbourIntent) -> float:
    """Who may still give way has the time to."""
    return PARTS_WITHIN_S if told.may_change else WAITS_WITHIN_S


def _others(state: AgentState) -> dict[int, NeighbourIntent]:
    """All that it hears of: by their plans, else as they fly now; and who may stand where it fell silent."""
    told, vehicle = known_intents(state), state.vehicle
    home_m = (vehicle.alt_amsl_m or 0.0) - (vehicle.alt_rel_m or 0.0)
    paths = silent_neighbours(state)
    paths |= {uav: path for uav, heard in state.neighbours.items() if (path := predict(state, heard))}
    for uav, path in paths.items():
        if uav in told:
            continue
        points = tuple((east_m, north_m, up_m + home_m) for east_m, north_m, up_m in path.points)
        flight = Trajectory(path.times_s, points)
        told[uav] = NeighbourIntent(flight, Bounds.of(flight), may_change=False, said_s=path.times_s[0])
    return told


def _below(state: AgentState, here: LocalPoint) -> dict[int, NeighbourIntent]:
    return {uav: told for uav, told in _others(state).items() if _waits_for(state, here, uav, told)}


def _height_now_m(state: AgentState, told: NeighbourIntent) -> float:
    now_s, flight = state.vehicle.time_boot_s, told.flight
    at = flight.at(min(max(now_s, flight.times_s[0]), flight.times_s[-1]))
    return flight.points[-1][2] if at is None else at[2]


def _waits_for(state: AgentState, here: LocalPoint, uav: int, told: NeighbourIntent) -> bool:
    """The higher one for the lower; at one height the one with the higher system id."""
    above_m = here[2] - _height_now_m(state, told)
    return above_m > SAME_HEIGHT_M or (above_m >= -SAME_HEIGHT_M and state.task.uav > uav)


def _is_in_the_way(state: AgentState, here: LocalPoint, others: Mapping[int, NeighbourIntent]) -> bool:
    """Of somebody who could not give way, where it would stop."""
    limits, now_s = state.task.separation.limits, state.vehicle.time_boot_s
    east_m, north_m, up_m = stopping_point(state, here)
    stop = (east_m, north_m, up_m + min(state.vehicle.climb_m_s, 0.0))
    stands = Trajectory((now_s, now_s + STANDS_S), (stop, stop))
    # Who is above waits for it.
    near = {
        uav: told
        for uav, told in others.items()
        if _height_now_m(state, told) - stop[2] < limits.vertical_m + SAME_HEIGHT_M
    }
    met = clashes_with(stands, near, limits)
    return any(not near[at.other].may_change or at.at_s < now_s + PARTS_WITHIN_S for at in met)


# --- down again


def _goes_down_if_clear(state: AgentState, here: LocalPoint) -> StepResult:
    now_s = state.vehicle.time_boot_s
    # Its mission is not changed while it says that it lands, as it may for a while after it has stopped.
    stands = state.order_followed and state.vehicle.landed is not Landed.LANDING
    if not stands or state.interrupted_plan is None or now_s < state.resume_earliest_boot_s:
        return state, []
    to = {uav: state.neighbours.get(uav, heard) for uav, heard in state.gave_way_to.items()}
    # Who comes down itself, and falls silent, is down.
    to = {uav: heard for uav, heard in to.items() if heard.state.phase != Phase.LANDING}
    state = replace(state, gave_way_to=to)
    met = _met_below(state, _below(state, here))
    if not met:
        state, ordered = _goes_down(state)
        state, told = publish_intent(state, planned_flight(state))
        return state, [ev.NotifyOperator("clear below: it comes down"), *ordered, *told]
    if now_s - state.holding_since_boot_s < SAYS_AGAIN_S:
        return state, []
    text = f"it has waited over its goal for {SAYS_AGAIN_S:.0f} s, and its way down meets "
    return replace(state, holding_since_boot_s=now_s), [
        ev.NotifyOperator(f"{text}{describe_clashes(met, now_s)}: it waits on")
    ]


def _met_below(state: AgentState, below: Mapping[int, NeighbourIntent]) -> tuple[Clash, ...]:
    """Whom it would meet if it came down now, or a little later."""
    place_here, flight = position_of(state), None
    if place_here is not None:
        place, up_m = _landing_place(state), place_here[2]
        at_place = math.dist(place_here[:2], place) <= AT_PLACE_M
        way = (
            land_from([place_here], [0.0])
            if at_place
            else fly_along(place_here, up_m, [place], state.task.arrival.speed_m_s)
        )
        flight = to_shared_frame(state, way)
    if flight is None:
        return ()
    limits, until_s = state.task.separation.limits, state.vehicle.time_boot_s + CLEAR_FOR_S
    for starts_s in STARTS_AFTER_S:
        met = clashes_with(flight.later(starts_s), below, limits)
        if soon := tuple(clash for clash in met if clash.at_s < until_s):
            return soon
    return ()


def _landing_place(state: AgentState) -> PlanarPoint:
    assert state.interrupted_plan is not None
    return waypoints_of(state.task, state.interrupted_plan.plan)[-1]


def _goes_down(state: AgentState) -> StepResult:
    """Over its landing place on the spot; from elsewhere over the goal by a mission that leads there."""
    swap, here, place = state.interrupted_plan, position_of(state), _landing_place(state)
    assert swap is not None
    assert here is not None
    if math.dist(here[:2], place) <= AT_PLACE_M:
        return command(replace(end_give_way(state), route=swap), ev.FlightOrder.LAND)
    begins = Waypoint(*state.task.grid.frame.to_geodetic(*here[:2]), here[2])
    landing = replace(swap.plan.landing, alt_rel_m=here[2])
    plan = replace(swap.plan, track=(), landing=landing, begins=begins, leaves_ahead=False, from_hold=True)
    new = msgspec.structs.replace(swap, plan_id=state.next_plan_id, plan=plan, because=(), track=None)
    state = replace(
        end_give_way(state),
        pending=new,
        next_plan_id=state.next_plan_id + 1,
        ordered=ev.FlightOrder.LAUNCH,
        order_followed=True,
        repeat_order_at_s=math.inf,
        hold_is_own=True,
    )
    return state, [new]
