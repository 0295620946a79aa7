"""Last resort: a copter stops if it will come too close to another vehicle within `look_ahead_s`. Pure.

All other layers decide earlier, by plans. This layer acts when those decisions were not enough: the other
vehicle follows closely, has just changed its plan, or is late. Both vehicles compare the same flights: each
one's plan, each one's present velocity, and each one's stop. A vehicle whose stop does not help cannot give
way in time, so the other one stops; otherwise the rule of `priority` decides. A vehicle with priority stops,
too, when its last moment for a stop has come. It also keeps far enough away to stop if a copter ahead stops.

| the vehicle | waits for | goes on |
|---|---|---|
| flies its route | a clear route | `route_hold` |
| lands | a clear descent | `landing_queue` |
| returns or lands by an order, without urgent reason | a clear path | `returning` |
"""

from __future__ import annotations

from collections.abc import Sequence

from swarmctl.agent.commands import StepResult
from swarmctl.agent.failsafes.base import is_urgent
from swarmctl.agent.phases import EN_ROUTE, Phase
from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.check import ENOUGH, come_within, share_of
from swarmctl.agent.traffic.known_flights import known_flights
from swarmctl.agent.traffic.landing_queue import HOLD_BEFORE_DESCENT_S, hold_before_landing
from swarmctl.agent.traffic.own_flight import planned_flight, reach
from swarmctl.agent.traffic.prediction import (
    HEARD_S,
    acknowledged_s,
    hears_nobody,
    position_amsl,
    predict,
)
from swarmctl.agent.traffic.priority import Activity, Standing, activity_of, gives_way, own_standing
from swarmctl.agent.traffic.returning import hold_before_leaving, may_hold_before_leaving
from swarmctl.agent.traffic.route_hold import follows_own_order, hold, may_give_way
from swarmctl.agent.traffic.separation.approach import Limits
from swarmctl.agent.traffic.separation.other_vehicles import KnownFlight, NeighbourReport
from swarmctl.agent.traffic.separation.trajectory import (
    LocalPoint,
    Trajectory,
    brake,
    extrapolate,
    landing_start_s,
    until_landing,
)
from swarmctl.agent.traffic.wait import WAITS_ABOVE_M
from swarmctl.core import events as ev
from swarmctl.core.vehicle import BRAKING_M_S2

STRAIGHT_ON_S = 5.0
"""Time for which a vehicle may fly straight on instead of by its plan [s]."""
REACTS_S = 1.5
"""Longest time from a decision to the start of braking [s]: the last moment for a stop allows for it."""
DECIDES_WITHIN_S = 1.0
"""Time before the last moment for a stop in which the rule of priority decides [s]."""
LIKELY_REACTION_S, LIKELY_BRAKING_M_S2 = 0.75, 2.6
"""Probable time to the start of braking [s], and deceleration."""
SPEED_OVER_S = 0.5
"""Time over which the speed on an announced flight is taken [s]."""
BETTER_STOP_SHARE = 0.2
"""Least improvement by a stop that is still too close, as a share of the limits."""

Paths = Sequence[Trajectory]


def stop_in_time(state: AgentState) -> StepResult:
    """Hold if the vehicle comes too close to another one soon, and has to stop for it."""
    if hears_nobody(state):
        return _stop_if_unannounced(state)
    if not may_stop(state) or (not state.neighbours and not state.intents):
        return state, []
    look_ahead_s = _compared_s(state)
    box = reach(state, look_ahead_s, STRAIGHT_ON_S)
    others = {} if box is None else known_flights(state, near=box)
    if not others:
        return state, []
    here, plan = position_amsl(state), planned_flight(state, look_ahead_s)
    if here is None or plan is None:
        return state, []
    vehicle, limits = state.vehicle, state.task.separation.limits
    now_s, velocity = vehicle.time_boot_s, (vehicle.east_m_s, vehicle.north_m_s, vehicle.climb_m_s)
    if state.phase in EN_ROUTE or _queues_later(state, plan):
        plan = until_landing(plan)  # over the goal the landing queue decides
    plan = plan.lasting(now_s + look_ahead_s)
    mine = _own_paths(state, here, velocity, plan)
    stop, late_stop = _stop(state, here, velocity, now_s), _later_stop(state, plan, REACTS_S, BRAKING_M_S2)
    to_avoid = frozenset(
        uav for uav, flight in others.items() if _has_to_stop(state, mine, stop, late_stop, uav, flight)
    )
    if not to_avoid:
        return state, []
    # The stop must not be worse with regard to all vehicles that cannot stop for it in time.
    cannot_stop = {
        uav: f for uav, f in others.items() if uav in to_avoid or not _can_stop_for(state, stop, uav, f)
    }
    if not _helps(stop, mine, [_paths(state, uav, flight) for uav, flight in cannot_stop.items()], limits):
        return state, []
    names = " and ".join(map(state.task.name_of, sorted(to_avoid)))
    text = (
        f"the vehicle would come too close to {names} soon; it holds until its way is clear [stops-in-time]"
    )
    return _hold(state, to_avoid, text)


def _queues_later(state: AgentState, plan: Trajectory) -> bool:
    """Return whether the landing queue decides about the descent later, near the landing spot."""
    descends_in_s = landing_start_s(plan) - state.vehicle.time_boot_s
    is_queued = state.phase is Phase.LANDING and state.plans.pending is None
    return is_queued and descends_in_s > HOLD_BEFORE_DESCENT_S


def _stop_if_unannounced(state: AgentState) -> StepResult:
    """Hold if no other vehicle has acknowledged the present flight before the silence began.

    The others expect the flight announced before. They also expect that the vehicle may have stopped on it.
    """
    changed_s = state.plans.swaps.decided_boot_s
    if state.wait is not None and state.wait.ended_boot_s is not None:
        changed_s = max(changed_s, state.wait.ended_boot_s)
    heard_s = max(report.at_s for report in state.neighbours.values())
    is_unannounced = acknowledged_s(state) < changed_s <= heard_s + HEARD_S
    begins_route = (
        state.phase is Phase.FLYING and state.plans.mission is None and state.plans.pending is not None
    )
    if not is_unannounced or not (may_stop(state) or (follows_own_order(state) and begins_route)):
        return state, []
    text = "no other vehicle is heard any more, and none knows this flight; the vehicle holds [unannounced]"
    return _hold(state, frozenset(), text)


def _hold(state: AgentState, to: frozenset[int], text: str) -> StepResult:
    match state.phase:
        case Phase.FLYING | Phase.FORMATION:
            state, effects = hold(state, state.plans.mission or state.plans.pending, to)
        case Phase.LANDING:
            state, effects = hold_before_landing(state, to)
        case _:
            state, effects = hold_before_leaving(state, to)
    return state, [ev.NotifyOperator(text), *effects]


def _has_to_stop(
    state: AgentState, mine: Paths, stop: Trajectory, late_stop: Paths, uav: int, known: KnownFlight
) -> bool:
    """Return whether this vehicle has to stop for another one.

    At its last moment, when a later stop is too late, the vehicle stops whatever the priority. It does so too
    if only a stop of the other one would be too close. Otherwise the rule of priority decides.
    """
    limits = known.limits(state.task.separation.limits)

    def comes_close(paths: Paths, theirs: Paths) -> bool:
        return come_within(paths, theirs, limits, ENOUGH)

    theirs, their_stop, has_to_stop = _paths(state, uav, known), _stop_of(state, uav), False
    for paths in (their_stop, theirs):
        has_to_stop = comes_close(mine, paths) and _helps(stop, mine, [paths], limits)
        if has_to_stop and comes_close(late_stop, paths):
            return True
    if not has_to_stop:
        return False
    if state.task.separation.action == "climb" and state.phase is Phase.FLYING:
        return False  # until its last moment the vehicle climbs to give way
    here = position_amsl(state)
    assert here is not None
    return gives_way(own_standing(state, here[2]), _standing(state, mine, theirs, their_stop, uav, limits))


def _standing(
    state: AgentState, mine: Paths, theirs: Paths, their_stop: Paths, uav: int, limits: Limits
) -> Standing:
    """Return another vehicle's standing; it cannot yield without a stop, or if the stop does not help."""
    if not their_stop:
        return Standing(Activity.EMERGENCY, False, uav)
    report, (stop,) = state.neighbours[uav], their_stop
    can_yield = _may_hold(state, report) and _helps(stop, theirs, [mine], limits)
    return Standing(activity_of(report.state.phase), can_yield, uav, stop.points[0][2])


def _stop_of(state: AgentState, uav: int) -> Paths:
    """Return the probable flight of another copter in flight that stops now; empty if it is not heard."""
    report = state.neighbours.get(uav)
    if report is None or not report.state.hovers or report.state.phase == Phase.LAUNCHING:
        return ()
    now_s, path = state.vehicle.time_boot_s, predict(state, report)
    here = None if path is None else path.at(now_s)
    return () if here is None else (_stop(state, here, report.state.velocity_m_s, now_s),)


def _may_hold(state: AgentState, other: NeighbourReport) -> bool:
    """Return whether another vehicle may hold for this one: a copter in contact, en route or landing."""
    is_heard = other.is_recent(state.vehicle.time_boot_s) and other.hears(state.task.uav)
    is_free = activity_of(other.state.phase) in (Activity.EN_ROUTE, Activity.LANDING)
    is_high = other.state.alt_rel_m >= WAITS_ABOVE_M
    return is_heard and is_free and is_high and other.state.hovers


def _can_stop_for(state: AgentState, stop: Trajectory, uav: int, known: KnownFlight) -> bool:
    """Return whether another vehicle, on its known flight, can still stop clear of this vehicle's stop."""
    report = state.neighbours.get(uav)
    if report is None or not _may_hold(state, report):
        return False
    flight, after_s = known.straight or known.flight, LIKELY_REACTION_S + REACTS_S
    their_stop = _later_stop(state, flight, after_s, LIKELY_BRAKING_M_S2)
    limits = known.limits(state.task.separation.limits)
    return not come_within((stop,), their_stop, limits, ENOUGH)


def _helps(stop: Trajectory, paths: Paths, others: Sequence[Paths], limits: Limits) -> bool:
    """Return whether a stop is clear of the others' paths, or better than to fly on by `paths`.

    A stop that is much worse with regard to the announced flights is not better, whatever else may happen.
    """
    every = [path for theirs in others for path in theirs]
    share = share_of((stop,), every, limits)
    if share >= ENOUGH:
        return True
    announced = [theirs[0] for theirs in others]
    if share < share_of(paths, every, limits) + BETTER_STOP_SHARE:
        return False
    flown_on = min(share_of(paths[:1], announced, limits), 1.0)
    return share_of((stop,), announced, limits) > flown_on - BETTER_STOP_SHARE


def _paths(state: AgentState, uav: int, known: KnownFlight) -> Paths:
    """Return the flights that another vehicle may take: its known flight first, then straight on.

    A vehicle off its intent flies straight on. A vehicle with a hold as its intent brakes.
    """
    now_s, report = state.vehicle.time_boot_s, state.neighbours.get(uav)
    straight = None if report is None else predict(state, report)
    if straight is None:
        return (known.flight,)
    if known.straight is not None:
        return (straight,)
    if known.flight.ends_in_hold:
        return (known.flight,)
    return known.flight, straight.lasting(max(now_s, straight.times_s[0]) + STRAIGHT_ON_S)


def _own_paths(state: AgentState, here: LocalPoint, velocity_m_s: LocalPoint, plan: Trajectory) -> Paths:
    """Return the flights that this vehicle may take: first its plan, then straight on for some seconds.

    A climb or descent straight on ends at the plan's heights. A landing vehicle brakes for its spot.
    """
    if state.phase is Phase.LANDING:
        return (plan,)
    heights_m = [here[2], *(point[2] for point in plan.points)]
    least_m_s, most_m_s = ((z - here[2]) / STRAIGHT_ON_S for z in (min(heights_m), max(heights_m)))
    climb_m_s = min(max(velocity_m_s[2], least_m_s), most_m_s)
    velocity_m_s = velocity_m_s[0], velocity_m_s[1], climb_m_s
    return plan, extrapolate(here, velocity_m_s, state.vehicle.time_boot_s, STRAIGHT_ON_S)


def _stop(state: AgentState, here: LocalPoint, velocity_m_s: LocalPoint, now_s: float) -> Trajectory:
    """Return the probable flight of a vehicle that stops now, heights above the sea."""
    stop = brake(here, velocity_m_s, now_s, LIKELY_REACTION_S, LIKELY_BRAKING_M_S2)
    return stop.holding(_compared_s(state))


def _later_stop(state: AgentState, flight: Trajectory, after_s: float, brakes_m_s2: float) -> Paths:
    """Return a flight for the next `after_s` [s], and the stop after it."""
    brakes_s = state.vehicle.time_boot_s + after_s
    until = flight.lasting(brakes_s)
    before, there = until.at(brakes_s - SPEED_OVER_S), until.points[-1]
    if before is None:
        return (until,)
    (e0, n0, u0), (e1, n1, u1) = before, there
    velocity_m_s = (e1 - e0) / SPEED_OVER_S, (n1 - n0) / SPEED_OVER_S, (u1 - u0) / SPEED_OVER_S
    return until, brake(there, velocity_m_s, brakes_s, brakes_m_s2=brakes_m_s2).holding(_compared_s(state))


def _compared_s(state: AgentState) -> float:
    """Return the time ahead in which flights are compared [s]: enough for the rule of priority to decide."""
    last_moment_s = REACTS_S + state.task.speed_m_s / BRAKING_M_S2
    return max(state.task.separation.look_ahead_s, last_moment_s + DECIDES_WITHIN_S)


def may_stop(state: AgentState) -> bool:
    """Return whether the vehicle can stop for another one now."""
    if not follows_own_order(state):
        return False
    match state.phase:
        case Phase.FLYING | Phase.FORMATION:
            return may_give_way(state)
        case Phase.LANDING:
            return state.followed is not None and not is_urgent(state.demands)
        case Phase.LEAVING:
            return may_hold_before_leaving(state)
    return False
