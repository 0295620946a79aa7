"""Compute the trajectory of the own vehicle in its present phase, and of orders that it may get. Pure.

Times are those of the vehicle's clock, positions of the area's local frame [m]. Heights are above the sea,
except where a docstring says above home.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from swarmctl.agent.formation.trajectory import flight_in_group
from swarmctl.agent.phases import EN_ROUTE, Phase
from swarmctl.agent.replan import wing_trajectory
from swarmctl.agent.replan.climb import DESCENT_M_S
from swarmctl.agent.replan.copter_trajectory import (
    FlightPart,
    climb_then_fly,
    fly_along,
    fly_through_change,
    land_from,
    waypoints_of,
)
from swarmctl.agent.replan.stopping import (
    STANDING_M_S,
    MissionChange,
    change_ahead,
    change_for_new_plan,
    swap_due_s,
)
from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.prediction import AIRBORNE_M, home_amsl_m, position_amsl, position_of
from swarmctl.agent.traffic.separation.trajectory import (
    Bounds,
    LocalPoint,
    Trajectory,
    brake,
    extrapolate,
    until_landing,
)
from swarmctl.core import events as ev
from swarmctl.core.mission import FlightPlan
from swarmctl.core.planar import PlanarPoint
from swarmctl.core.planned_mission import PlannedMission

HOLD_DURATION_S = 30.0
"""Duration of a hold in an intent [s]."""
LAST_POSITION_S = 180.0
"""Time for which a vehicle without a position announces its last position [s]."""
VERTICAL_WITHIN_M = 5.0
"""Horizontal distance within which a climb at home, or a descent that has begun, counts as vertical [m]."""
REACH_FACTOR, REACH_UP_M = 1.2, 0.1
"""Enlargement of a quick test's box beyond the own flight: over ground as a factor, in height [m]."""
TOWARD_HOME = 0.7
"""Least share of its speed with which a vehicle on its return flies toward its home."""
DESCENT_BEGINS_WITHIN_M = 2.0
"""Horizontal distance from the landing spot within which a vehicle begins its vertical descent [m]."""


def planned_flight(state: AgentState, for_s: float = math.inf) -> Trajectory | None:
    """Return the own trajectory from now on, at least for `for_s` [s]; None if unknown."""
    here = position_of(state)
    return (
        _hold_at_last_position(state)
        if here is None
        else to_shared_frame(state, _phase_trajectory(state, here, for_s))
    )


def return_flights(state: AgentState) -> list[Trajectory]:
    """Return the own trajectories of a return that begins now, one for each height that it may have.

    A return climbs to a height that a parameter of the firmware sets: the cruise height or less. The list has
    heights that are at most the vertical limit apart, and is empty if position or home is unknown.
    """
    here, cruise_m = position_of(state), state.task.altitude_m
    if here is None:
        return []
    climb_m = max(cruise_m - here[2], 0.0)
    n = math.ceil(climb_m / state.task.separation.limits.vertical_m)
    heights_m = [cruise_m - climb_m * k / max(n, 1) for k in range(n + 1)]
    flights = (to_shared_frame(state, _return_trajectory(state, here, height_m)) for height_m in heights_m)
    return [flight for flight in flights if flight is not None]


def landing_flight(state: AgentState) -> Trajectory | None:
    """Return the own trajectory of a landing here that begins now; None if the position is unknown."""
    here = position_of(state)
    return None if here is None else to_shared_frame(state, _landing_here(state, here))


def own_trajectory(state: AgentState) -> Trajectory | None:
    """Return the own trajectory for the look-ahead time; None: the position is unknown.

    A vehicle on its route flies its plan until its landing. In other phases, in hold, and during a mission
    change, it flies straight on.
    """
    here, vehicle, for_s = position_amsl(state), state.vehicle, state.task.separation.look_ahead_s
    if here is None:
        return None
    now_s = vehicle.time_boot_s
    if state.phase in EN_ROUTE and state.plans.mission is not None and state.plans.pending is None:
        flight = planned_flight(state, for_s)
        if flight is not None:
            return until_landing(flight).lasting(now_s + for_s)
    return extrapolate(here, (vehicle.east_m_s, vehicle.north_m_s, vehicle.climb_m_s), now_s, for_s)


def reach(state: AgentState, for_s: float, straight_on_s: float) -> Bounds | None:
    """Return a box around the own flight of a copter for `for_s` from now; None: the position is unknown.

    The box is larger than the flight: a quick test before a flight is computed. It also holds the flight
    straight on for `straight_on_s`.
    """
    here, vehicle, task = position_amsl(state), state.vehicle, state.task
    if here is None:
        return None
    (east_m, north_m, up_m), home_m = here, home_amsl_m(state)
    heights_m = [up_m, up_m + straight_on_s * vehicle.climb_m_s]
    swaps = (state.plans.pending, state.plans.mission)
    heights_m += [home_m + swap.plan.height_m for swap in swaps if swap is not None]
    if state.phase is Phase.LEAVING:
        heights_m.append(home_m + task.altitude_m)
    fastest_m_s = max(vehicle.ground_speed_m_s, task.speed_m_s, state.speed.m_s or 0.0)
    away_m = REACH_FACTOR * (for_s * fastest_m_s + VERTICAL_WITHIN_M)
    if not _lands_beyond(state, away_m):
        heights_m.append(up_m - for_s * DESCENT_M_S)
    low_m, high_m, now_s = min(heights_m), max(heights_m), vehicle.time_boot_s
    return Bounds(
        (now_s, east_m - away_m, north_m - away_m, low_m - REACH_UP_M),
        (now_s + for_s, east_m + away_m, north_m + away_m, high_m + REACH_UP_M),
    )


def _lands_beyond(state: AgentState, distance_m: float) -> bool:
    """Return whether the vehicle flies its route, and its landing is farther ahead than a distance."""
    progress, mission = state.progress, state.plans.mission
    if state.phase is not Phase.FLYING or state.plans.pending is not None or state.is_waiting:
        return False
    if progress is None or mission is None or progress.flight.mission is not mission:
        return False
    return progress.to_landing_m - progress.at.cross_track_m > REACH_FACTOR * distance_m


def hold_from(state: AgentState, here: LocalPoint, begin_s: float) -> Trajectory:
    """Return the flight of a vehicle that brakes from its present velocity, and holds."""
    return stop_from(state, here, begin_s).holding(HOLD_DURATION_S)


def stop_from(state: AgentState, here: LocalPoint, begin_s: float) -> Trajectory:
    """Return the flight of a vehicle that brakes from its present velocity, up to its stop."""
    vehicle = state.vehicle
    return brake(here, (vehicle.east_m_s, vehicle.north_m_s, vehicle.climb_m_s), begin_s)


def _hold_at_last_position(state: AgentState) -> Trajectory | None:
    """Return a hold at the last position, at half the last height because the vehicle may be landing."""
    last, now_s = state.last_position, state.vehicle.time_boot_s
    if last.lat_lon is None or last.alt_amsl_m is None or last.alt_rel_m is None:
        return None
    if not 0.0 <= now_s - last.time_boot_s <= LAST_POSITION_S:
        return None
    place = state.task.grid.frame.to_local(*last.lat_lon)
    up_m = last.alt_amsl_m - 0.5 * max(last.alt_rel_m, 0.0)
    return Trajectory((now_s, now_s + HOLD_DURATION_S), ((*place, up_m), (*place, up_m)))


def flight_by_plan(state: AgentState, plan: FlightPlan) -> Trajectory | None:
    """Return the trajectory of a flying vehicle that begins `plan` now; None if its position is unknown."""
    here = position_of(state)
    if here is None:
        return None
    task, path, speed_m_s = state.task, waypoints_of(state.task, plan), state.task.speed_m_s
    if task.wings is not None:
        flight = wing_trajectory.in_flight(task, plan, here, path[:-1], speed_m_s)
    else:
        change, begins_s = change_for_new_plan(state), state.plans.swap_times.likely_s
        flight = _fly_plan(state, here, plan, path, change, begins_s, speed_m_s)
    return to_shared_frame(state, flight)


def _fly_plan(
    state: AgentState,
    here: LocalPoint,
    plan: FlightPlan,
    ahead: Sequence[PlanarPoint],
    change: MissionChange | None,
    begins_s: float,
    speed_m_s: float,
) -> Trajectory:
    """Return the trajectory of a copter by `plan`, whose points `ahead` are left; heights above home.

    change: the change from the present plan; None: the vehicle flies `plan` already, or it holds
    begins_s: time until a vehicle that holds begins `plan` [s]
    """
    task, vehicle, mission = state.task, state.vehicle, state.plans.mission
    delay_s = vehicle.start_delay_s
    if _climbs_vertically(state, here, plan):
        path = waypoints_of(task, plan)
        return climb_then_fly(here, plan.height_m, path, speed_m_s, start_delay_s=delay_s)
    if mission is None:
        path, speed_m_s = waypoints_of(task, plan), task.speed_m_s
        flight = fly_along(here, plan.height_m, path, speed_m_s, start_delay_s=delay_s)
        return flight.after(here, begins_s) if begins_s > 0.0 else flight
    if change is None:
        flown_m_s = vehicle.ground_speed_m_s
        return fly_along(here, plan.height_m, ahead, speed_m_s, flown_m_s, start_delay_s=delay_s)
    return fly_through_change(
        here,
        (vehicle.east_m_s, vehicle.north_m_s),
        FlightPart(mission.plan.height_m, _points_ahead(state, here, mission)),
        change,
        FlightPart(plan.height_m, ahead),
        speed_m_s,
        start_delay_s=delay_s,
        leaves_ahead=plan.leaves_ahead,
    )


def to_shared_frame(state: AgentState, flight: Trajectory | None) -> Trajectory | None:
    """Return a flight by the vehicle's clock, with heights above the sea.

    The given flight begins at 0 s and has heights above home. The result is None if the heights are unknown.
    """
    vehicle = state.vehicle
    if flight is None or not vehicle.has_position:
        return None
    return flight.later(vehicle.time_boot_s).higher(home_amsl_m(state))


def _phase_trajectory(state: AgentState, here: LocalPoint, for_s: float) -> Trajectory | None:
    """Return the trajectory of the present phase from 0 s on, heights above home; None if unknown.

    It lasts `for_s` at least, or until its end [s].
    """
    task, swap = state.task, state.plans.pending or state.plans.mission
    speed_m_s, delay_s = state.speed.m_s or task.speed_m_s, state.vehicle.start_delay_s
    if task.wings is not None:
        return _fixed_wing_trajectory(state, here, speed_m_s)
    match state.phase:
        case Phase.FORMATION if not state.membership.stands_still:
            return flight_in_group(state, here, for_s)
        case Phase.LAUNCHING if swap is not None:
            lift_s = state.launch.lifts_off_in_s(state.vehicle.time_boot_s) if here[2] < AIRBORNE_M else 0.0
            path = waypoints_of(task, swap.plan)
            return climb_then_fly(here, swap.plan.height_m, path, speed_m_s, lift_s, start_delay_s=delay_s)
        case Phase.FLYING | Phase.LANDING if swap is not None and not state.is_waiting:
            plan = swap.plan
            if state.phase is Phase.LANDING and state.order.given is ev.FlightOrder.LAND:
                return _landing_here(state, here)
            remaining = _points_ahead(state, here, swap)
            if state.phase is Phase.LANDING and _descends_vertically(here, remaining, plan.height_m):
                return land_from([(*remaining[-1], here[2])], [0.0])
            change, begins_s = change_ahead(state), swap_due_s(state)
            return _fly_plan(state, here, plan, remaining, change, begins_s, speed_m_s)
        case Phase.FLYING | Phase.FORMATION | Phase.LANDING | Phase.HOLDING:
            return hold_from(state, here, 0.0)
        case Phase.LEAVING if state.order.given is ev.FlightOrder.LAND:
            return _landing_here(state, here)
        case Phase.LEAVING if state.order.given is ev.FlightOrder.RETURN:
            return _return_trajectory(state, here, task.altitude_m)
    return None


def _return_trajectory(state: AgentState, here: LocalPoint, height_m: float) -> Trajectory | None:
    """Return the trajectory of a return at a height, heights above home; None if home is unknown.

    A return begins with the climb to its height. A vehicle that does not fly toward its home yet stops first.
    """
    vehicle = state.vehicle
    if vehicle.home_lat_lon is None:
        return None
    place = state.task.grid.frame.to_local(*vehicle.home_lat_lon)
    away_m = math.dist(here[:2], place)
    if away_m < VERTICAL_WITHIN_M:
        return land_from([here], [0.0])
    to_e, to_n = (place[0] - here[0]) / away_m, (place[1] - here[1]) / away_m
    toward_m_s = to_e * vehicle.east_m_s + to_n * vehicle.north_m_s
    if _is_high(here, height_m) and toward_m_s >= TOWARD_HOME * vehicle.ground_speed_m_s:
        speed_m_s, delay_s = state.task.speed_m_s, vehicle.start_delay_s
        return fly_along(here, here[2], [place], speed_m_s, toward_m_s, start_delay_s=delay_s)
    return _from_stop(state, here, lambda stop: _fly_home(state, stop, place, height_m))


def _fly_home(state: AgentState, here: LocalPoint, place: PlanarPoint, height_m: float) -> Trajectory:
    """Return the trajectory of a return from a stop to a place above the home."""
    speed_m_s, delay_s = state.task.speed_m_s, state.vehicle.start_delay_s
    if _is_high(here, height_m):
        return fly_along(here, here[2], [place], speed_m_s, start_delay_s=delay_s)
    return climb_then_fly(here, height_m, [place], speed_m_s, start_delay_s=delay_s)


def _is_high(here: LocalPoint, height_m: float) -> bool:
    return here[2] > height_m - AIRBORNE_M


def _landing_here(state: AgentState, here: LocalPoint) -> Trajectory:
    """Return the trajectory of an ordered landing, heights above home."""
    return _from_stop(state, here, lambda stop: land_from([stop], [0.0]))


def _from_stop(state: AgentState, here: LocalPoint, go_on: Callable[[LocalPoint], Trajectory]) -> Trajectory:
    """Return a trajectory that begins with a stop straight ahead; `go_on` returns the rest from there on."""
    if state.task.wings is not None or state.vehicle.ground_speed_m_s < STANDING_M_S:
        return go_on(here)
    stop = stop_from(state, here, 0.0)
    return stop.then(go_on(stop.points[-1]))


def _descends_vertically(here: LocalPoint, points_ahead: Sequence[PlanarPoint], height_m: float) -> bool:
    """Return whether the vehicle descends vertically at its landing spot; wind may move it a little.

    A route may lead over the landing spot before its end: there the descent does not begin.
    """
    spot = points_ahead[-1]
    if here[2] < height_m - AIRBORNE_M:
        return math.dist(here[:2], spot) < VERTICAL_WITHIN_M
    return all(math.dist(point, spot) < DESCENT_BEGINS_WITHIN_M for point in (here[:2], *points_ahead))


def _fixed_wing_trajectory(state: AgentState, here: LocalPoint, speed_m_s: float) -> Trajectory | None:
    """Return the trajectory of a fixed wing that launches, flies its plan or lands; None otherwise."""
    task, swap, vehicle = state.task, state.plans.pending or state.plans.mission, state.vehicle
    if swap is None or state.is_waiting:
        return None
    if state.phase in (Phase.LAUNCHING, Phase.FLYING):
        progress = state.progress_on(swap)
        remaining = waypoints_of(task, swap.plan)[:-1] if progress is None else progress.waypoints_ahead
        return wing_trajectory.in_flight(task, swap.plan, here, remaining, speed_m_s)
    if state.phase is Phase.LANDING and vehicle.ground_speed_m_s > 0.0:
        heading_rad = math.atan2(vehicle.east_m_s, vehicle.north_m_s)
        return wing_trajectory.approach_from(task, swap.plan, here, heading_rad, speed_m_s)
    return None


def _points_ahead(state: AgentState, here: LocalPoint, swap: PlannedMission) -> Sequence[PlanarPoint]:
    """Return the waypoints ahead and the landing spot; all of them while the vehicle levels off."""
    ahead = None if _levels_off(state, here, swap.plan) else state.points_ahead(swap)
    return ahead or waypoints_of(state.task, swap.plan)


def _levels_off(state: AgentState, here: LocalPoint, plan: FlightPlan) -> bool:
    """Return whether the vehicle still climbs or descends on the spot where its mission begins.

    Wind may have moved it past this spot, which then no longer counts as ahead (`with_level_off`).
    """
    if plan.begins is None or abs(plan.height_m - here[2]) < AIRBORNE_M:
        return False
    frame = state.task.grid.frame
    places = (frame.to_local(at.lat_deg, at.lon_deg) for at in (plan.begins, *plan.track[:1]))
    return all(math.dist(here[:2], place) < VERTICAL_WITHIN_M for place in places)


def _climbs_vertically(state: AgentState, here: LocalPoint, plan: FlightPlan) -> bool:
    """Return whether the vehicle is still in its take-off: in its first mission, low above home."""
    home, mission = state.vehicle.home_lat_lon, state.plans.mission
    if home is None or mission is None or mission.plan.begins is not None:
        return False
    place = state.task.grid.frame.to_local(*home)
    return math.dist(here[:2], place) < VERTICAL_WITHIN_M and here[2] < plan.height_m - AIRBORNE_M
