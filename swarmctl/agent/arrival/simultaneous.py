"""Simultaneous arrival of one vehicle: its earliest arrival, and its speed for the common time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import msgspec

from swarmctl.agent.arrival.common_time import ArrivalGroup, due_s, speed_for
from swarmctl.agent.commands import StepResult, may_set_speed, set_speed
from swarmctl.agent.phases import IN_FLIGHT, Phase
from swarmctl.agent.replan import travel_time
from swarmctl.agent.replan.climb import climb_s
from swarmctl.agent.replan.spare_time import update_spare_time
from swarmctl.agent.replan.stopping import MissionChange, after_stop, change_ahead
from swarmctl.agent.replan.wing_trajectory import ROLL_S
from swarmctl.agent.state import ARRIVED, AgentState
from swarmctl.core import events as ev
from swarmctl.core.any_angle.turns import rounded
from swarmctl.core.frames import StateShared
from swarmctl.core.planar import PlanarPoint
from swarmctl.core.records import replace

FIXED_SPEED_WITHIN_S = 4.0
"""time to the goal at full speed below which the speed stays [s], because the vehicle brakes there"""
BEFORE_ARRIVAL = frozenset({Phase.STANDBY, Phase.LAUNCHING, Phase.FLYING})
"""phases in which this vehicle is still to arrive"""


def earliest_in_s(state: AgentState) -> float | None:
    """Return the least time until the vehicle is over its goal, on its route at full speed [s].

    On standby, a launch now is assumed. After the arrival, the time is 0 or negative. The result is None if
    there is no simultaneous arrival or no position, or if the vehicle does not fly to its goal.
    """
    if state.task.arrival_group is None:
        return None
    if state.arrived_boot_s is not None and (state.phase is Phase.LANDING or state.outcome == ARRIVED):
        return state.arrived_boot_s - state.vehicle.time_boot_s
    path = _path_to_goal(state) if state.phase in BEFORE_ARRIVAL else None
    return None if path is None else path.arrives_in_s(state.task.speed_m_s)


def note_arrival_times(state: AgentState, states: Sequence[tuple[int, StateShared]]) -> AgentState:
    """Store the earliest arrivals of other vehicles, by this vehicle's clock.

    Vehicles without an arrival time (None) are removed.
    """
    if state.task.arrival_group is None:
        return state
    now_s = state.vehicle.time_boot_s
    new = {
        uav: now_s + other.earliest_in_s - other.age_s
        for uav, other in states
        if other.earliest_in_s is not None
    }
    removed = {uav for uav, other in states if other.earliest_in_s is None}
    arrival = state.common_arrival
    kept = {uav: at_s for uav, at_s in arrival.others_earliest_s.items() if uav not in removed}
    return replace(state, common_arrival=replace(arrival, others_earliest_s={**kept, **new}))


def adjust_speed(state: AgentState) -> StepResult:
    """Set another speed if the vehicle would otherwise miss its arrival time. Called for each telemetry."""
    group, now_s = state.task.arrival_group, state.vehicle.time_boot_s
    if group is None or not may_set_speed(state):
        return state, []
    full_m_s = state.task.speed_m_s
    path = _path_to_goal(state)
    if path is None or (soonest_s := path.arrives_in_s(full_m_s)) < FIXED_SPEED_WITHIN_S:
        return state, []
    known = {uav: at_s for uav, at_s in state.common_arrival.others_earliest_s.items() if uav in group.rank}
    due = due_s(group, state.task.uav, {**known, state.task.uav: now_s + soonest_s})
    state = update_spare_time(state, due, now_s + soonest_s)
    state = replace(state, common_arrival=replace(state.common_arrival, due_s=due))
    new_m_s = speed_for(path.arrives_in_s, due - now_s, full_m_s, _slowest_m_s(state, group))
    return set_speed(state, new_m_s)


def speed_failed(state: AgentState, event: ev.SpeedFailed, _now: float) -> StepResult:
    """Mark the speed as unknown, so that the agent sets the speed again."""
    return replace(state, speed=state.speed.unknown(), trouble=event.reason), []


class _PathToGoal(msgspec.Struct, frozen=True):
    """The flight from a vehicle to its goal cell."""

    track: Sequence[PlanarPoint]
    """points from the vehicle to the centre of the goal cell"""
    edge_m: float
    """distance from the edge of the goal cell to the end of the track [m]"""
    initial_m_s: float
    """present speed [m/s]"""
    takeoff_s: float
    """time until the lift-off and remaining climb of a copter, or ground roll of a fixed wing that is not
    armed yet [s]"""
    change: MissionChange | None = None
    """change to a new plan"""
    start_delay_s: float = 0.0
    """delay of a start from a stand [s]"""
    turn_radius_m: float | None = None
    """turn radius of a fixed wing, which flies at one speed [m]; None for a vehicle that brakes at corners"""

    def arrives_in_s(self, speed_m_s: float) -> float:
        """Return the time until the vehicle is over its goal cell, if it flies at this speed [s]."""
        if self.turn_radius_m is not None:
            flown, _ = rounded(self.track, self.turn_radius_m)
            flown_m = math.fsum(math.dist(a, b) for a, b in pairwise(flown))
            return self.takeoff_s + max(flown_m - self.edge_m, 0.0) / speed_m_s
        stop_s, track, initial_m_s = after_stop(self.track, min(self.initial_m_s, speed_m_s), self.change)
        in_s = travel_time.arrives_s(
            track,
            speed_m_s,
            initial_m_s=initial_m_s,
            remaining_m=self.edge_m,
            start_delay_s=self.start_delay_s,
        )
        return self.takeoff_s + stop_s + in_s


def _path_to_goal(state: AgentState) -> _PathToGoal | None:
    vehicle, swap = state.vehicle, state.plans.pending or state.followed
    progress = None if swap is None else state.progress_on(swap)
    if progress is None:
        return None
    track = (progress.here, *progress.waypoints_ahead)
    wings, edge_m = state.task.wings, _leg_in_goal_cell_m(track, state.task.grid.cell_size_m)
    speed_m_s = vehicle.ground_speed_m_s
    if wings is not None:  # a fixed wing climbs along its route
        roll_s = 0.0 if vehicle.armed else ROLL_S
        return _PathToGoal(track, edge_m, speed_m_s, roll_s, turn_radius_m=state.task.turn_radius_m)
    lift_s = 0.0 if state.phase in IN_FLIGHT else state.launch.lifts_off_in_s(vehicle.time_boot_s)
    takeoff_s = lift_s + climb_s(max(state.height_m - (vehicle.alt_rel_m or 0.0), 0.0))
    return _PathToGoal(track, edge_m, speed_m_s, takeoff_s, change_ahead(state), vehicle.start_delay_s)


def _slowest_m_s(state: AgentState, group: ArrivalGroup) -> float:
    wings = state.task.wings
    return group.slowest_m_s if wings is None else max(group.slowest_m_s, wings.min_speed_m_s)


def _leg_in_goal_cell_m(track: Sequence[PlanarPoint], cell_size_m: float) -> float:
    """Return the distance along the last leg from the edge of the goal cell to its centre [m]."""
    if len(track) < 2:
        return 0.0
    (e0, n0), (e1, n1) = track[-2:]
    leg_m = math.dist(track[-2], track[-1])
    longer_m = max(abs(e1 - e0), abs(n1 - n0))
    return 0.5 * cell_size_m * leg_m / longer_m if longer_m > 0.0 else 0.0
