"""Watching the others in flight: the alarm, and giving way without leaving the mission for good."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from swarmctl.agent.orders import Step, command
from swarmctl.agent.state import IN_FLIGHT, AgentState, Phase
from swarmctl.core import events as ev
from swarmctl.core.frames import StateShared
from swarmctl.core.plane import distance_to_leg
from swarmctl.core.vehicle import VehicleState
from swarmctl.separation import Point, Trajectory, intervals, onward
from swarmctl.separation.watch import Alarm, Heard, clear_height_m, gives_way, watch

FRESH_S = 5.0
"""Where another was that has said nothing for longer, nobody knows."""
AIRBORNE_M = 1.0
"""above home: lower vehicles are in nobody's way"""
MARGIN_M_S = 5.0
"""by so much two may become faster"""
GOES_ON_AFTER_S = (0.0, 2.0, 4.0, 6.0)
"""Who is told to go on does so within some seconds: all that time the way has to be clear."""
BRAKING_M_S2 = 1.75
"""at which a copter stops (`swarmctl.agent.pace`)"""


def is_near(state: AgentState, other: StateShared) -> bool:
    """Whether another is so near that it could come too close within the time looked ahead."""
    vehicle, rules = state.vehicle, state.task.separation
    if vehicle.lat_deg is None or vehicle.lon_deg is None:
        return False
    frame = state.task.grid.frame
    here, there = (
        frame.to_local(vehicle.lat_deg, vehicle.lon_deg),
        frame.to_local(other.lat_deg, other.lon_deg),
    )
    speeds_m_s = vehicle.ground_speed_m_s + math.hypot(*other.velocity_m_s[:2]) + MARGIN_M_S
    return math.dist(here, there) < 2.0 * rules.limits.horizontal_m + speeds_m_s * (
        rules.look_ahead_s + FRESH_S
    )


def keep_apart(state: AgentState) -> Step:
    """With each position: who will be too close, what is told of it, and what this vehicle does about it."""
    if not (state.neighbours or state.alarms or state.gave_way):
        return state, []
    if state.gave_way is not None and state.phase not in (Phase.FLYING, Phase.LANDING):
        state = replace(state, gave_way=None)  # it was ordered otherwise
    before = {alarm.other for alarm in state.alarms}
    own = own_trajectory(state)
    if own is None or state.phase not in IN_FLIGHT:
        return replace(state, alarms=(), gave_way=None), []
    others = {uav: path for uav, heard in state.neighbours.items() if (path := _predicted(state, heard))}
    now_s = state.vehicle.time_boot_s
    alarms = watch(state.alarms, own, others, state.task.separation, now_s)
    new = [alarm for alarm in alarms if alarm.other not in before]
    state = replace(state, alarms=alarms, n_alarms=state.n_alarms + len(new))
    told: list[ev.Effect] = [ev.Tell(f"{_in_words(alarm, now_s)}{_who(state, alarm)}") for alarm in new]
    if state.gave_way is not None:
        state, done = _go_on_if_clear(state, own, others)
    else:
        state, done = _give_way(state, new, others)
    return state, [*told, *done]


def _give_way(state: AgentState, new: Sequence[Alarm], others: dict[int, Trajectory]) -> Step:
    rules = state.task.separation
    if not may_give_way(state) or not any(gives_way(state.task.uav, alarm.other) for alarm in new):
        return state, []
    stays = _standing(state)
    blocked = (
        {a.other for a in watch((), stays, others, rules, state.vehicle.time_boot_s)} if stays else set()
    )
    if rules.action == "hold" and not blocked:
        # Its route is given again when all is clear: until then it flies none.
        held = replace(state, gave_way=state.route, route=None, pending=None, n_holds=state.n_holds + 1)
        return command(held, ev.Order.HOLD)
    return _climb(state, others), []


def may_give_way(state: AgentState) -> bool:
    """Whether the vehicle may leave its mission for a while: it flies it, and is up."""
    vehicle, task = state.vehicle, state.task
    if state.task.separation.action == "none" or state.phase is not Phase.FLYING or state.route is None:
        return False
    up_m = task.altitude_m - 2.0 * task.separation.limits.vertical_m
    return not state.lost and vehicle.alt_rel_m is not None and vehicle.alt_rel_m >= up_m


def _climb(state: AgentState, others: dict[int, Trajectory]) -> AgentState:
    """Its next plan, which is made at once, is flown clear of the heights of all who are near."""
    now_s, here_m = state.vehicle.time_boot_s, state.vehicle.alt_rel_m or 0.0
    heights_m = [at[2] for path in others.values() if (at := path.at(now_s)) is not None]
    height_m = clear_height_m(max(here_m, state.height_m), heights_m, state.task.separation.limits)
    if height_m <= state.height_m:
        return state
    state = replace(state, raised_m=height_m - state.task.altitude_m, n_climbs=state.n_climbs + 1)
    return replace(state, dirty=True, must_change=True)


def _go_on_if_clear(state: AgentState, own: Trajectory, others: dict[int, Trajectory]) -> Step:
    """The route is planned anew from where it holds."""
    limits = state.task.separation.limits
    starts = [own.later(seconds) for seconds in GOES_ON_AFTER_S]
    if state.alarms or any(intervals(path, other, limits) for path in starts for other in others.values()):
        return state, []
    if state.phase is Phase.LANDING:
        return command(replace(state, gave_way=None), ev.Order.LAND)
    state = replace(state, gave_way=None, ordered=ev.Order.LAUNCH, order_seen=True, dirty=True)
    state = replace(state, order_again_at_s=math.inf)
    return state, [ev.Tell("clear of the others: it flies on")]


# --- where all will be, in metres of the area's plane, up above this vehicle's home


def own_trajectory(state: AgentState) -> Trajectory | None:
    """Along its plan as fast as it is, or as it would be if it did not hold for others; straight on where it
    flies none."""
    vehicle, rules = state.vehicle, state.task.separation
    here = _here(state)
    if here is None:
        return None
    now_s, for_s = vehicle.time_boot_s, rules.look_ahead_s
    swap = state.gave_way or (state.route if state.pending is None else None)
    if swap is None or state.phase is not Phase.FLYING:
        return onward(here, (vehicle.east_m_s, vehicle.north_m_s, vehicle.climb_m_s), now_s, for_s)
    speed_m_s = state.task.arrival.speed_m_s if state.gave_way else max(vehicle.ground_speed_m_s, 0.5)
    frame = state.task.grid.frame
    points = (*swap.plan.track, swap.plan.landing)
    track = [(*frame.to_local(point.lat_deg, point.lon_deg), point.alt_rel_m) for point in points]
    return _along([here, *track_ahead(track, here)], speed_m_s, now_s, for_s)


def _here(state: AgentState) -> Point | None:
    vehicle = state.vehicle
    if vehicle.lat_deg is None or vehicle.lon_deg is None or vehicle.alt_rel_m is None:
        return None
    return (*state.task.grid.frame.to_local(vehicle.lat_deg, vehicle.lon_deg), vehicle.alt_rel_m)


def track_ahead(track: Sequence[Point], here: Point) -> Sequence[Point]:
    """What of a track lies before a vehicle that flies along it: from the end of the leg it is nearest to."""
    best, nearest_m = 0, math.dist(track[0][:2], here[:2])
    for i in range(1, len(track)):
        away_m = distance_to_leg(here[:2], track[i - 1][:2], track[i][:2])
        if away_m < nearest_m - 1e-6:  # else it is at a corner, which is still to be passed
            best, nearest_m = i, away_m
    return track[best:]


def _along(points: Sequence[Point], speed_m_s: float, from_s: float, for_s: float) -> Trajectory:
    """From point to point for so long, at the end standing."""
    times_s, passed = [from_s], [points[0]]
    for point in points[1:]:
        takes_s = math.dist(passed[-1][:2], point[:2]) / speed_m_s
        left_s = from_s + for_s - times_s[-1]
        if takes_s >= left_s > 0.0:
            share = left_s / takes_s
            passed.append(tuple(a + share * (b - a) for a, b in zip(passed[-1], point, strict=True)))  # type: ignore[arg-type]
            times_s.append(from_s + for_s)
            break
        if takes_s > 0.0:
            times_s.append(times_s[-1] + takes_s)
            passed.append(point)
    if times_s[-1] < from_s + for_s:
        times_s.append(from_s + for_s)
        passed.append(passed[-1])
    return Trajectory(tuple(times_s), tuple(passed))


def _standing(state: AgentState) -> Trajectory | None:
    """Where it comes to a stop if it holds now, and stays."""
    vehicle, here = state.vehicle, _here(state)
    if here is None:
        return None
    braking_s = vehicle.ground_speed_m_s / (2.0 * BRAKING_M_S2)
    stop = here[0] + vehicle.east_m_s * braking_s, here[1] + vehicle.north_m_s * braking_s, here[2]
    return onward(stop, (0.0, 0.0, 0.0), vehicle.time_boot_s, state.task.separation.look_ahead_s)


def _predicted(state: AgentState, heard: Heard) -> Trajectory | None:
    """Straight on from where it said it was; None where it is in nobody's way or was not heard of late."""
    told, now_s = heard.state, state.vehicle.time_boot_s
    if not 0.0 <= now_s - heard.at_s <= FRESH_S or told.alt_rel_m < AIRBORNE_M:
        return None
    east_m, north_m = state.task.grid.frame.to_local(told.lat_deg, told.lon_deg)
    for_s = now_s - heard.at_s + state.task.separation.look_ahead_s
    return onward((east_m, north_m, _up_m(state.vehicle, told)), told.velocity_m_s, heard.at_s, for_s)


def _up_m(vehicle: VehicleState, other: StateShared) -> float:
    """The height of another above this vehicle's home, which may lie higher than the other's."""
    if vehicle.alt_amsl_m is None or vehicle.alt_rel_m is None or other.alt_amsl_m is None:
        return other.alt_rel_m
    return other.alt_amsl_m - vehicle.alt_amsl_m + vehicle.alt_rel_m


# --- for the operator


def _in_words(alarm: Alarm, now_s: float) -> str:
    at = alarm.approach
    return (
        f"too close to vehicle {alarm.other} in {max(at.t_s - now_s, 0.0):.0f} s: {at.horizontal_m:.0f} m "
        f"over ground and {at.vertical_m:.1f} m in height"
    )


def _who(state: AgentState, alarm: Alarm) -> str:
    if state.task.separation.action == "none":
        return ""
    if not gives_way(state.task.uav, alarm.other):
        return "; the other gives way"
    return "; it gives way" if may_give_way(state) or state.gave_way else "; it cannot give way now"
