"""The change to a new plan in flight: its time and place, and the stop for it. Pure.

An ArduPilot copter brakes to a stop before it flies by a new mission, even straight on
(`VehicleState.brakes_m_s2`). The copter flies by its old plan until it brakes, and speeds up after the stop.
At 10 m/s, braking and speeding up again together cost about 6 s, and `travel_time` counts that.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import msgspec

from swarmctl.agent.replan.travel_time import ACCELERATION_M_S2
from swarmctl.agent.state import AgentState
from swarmctl.core.planar import PlanarPoint

STANDING_M_S = 1.0
"""Greatest speed of a vehicle that needs no stop [m/s]."""
STOPPED_M_S = 0.1
"""Speed up to which a vehicle counts as stopped [m/s]."""
CORNER_M = 0.01
"""Greatest distance from a stop to the next corner at which both count as one point [m]."""


class MissionChange(msgspec.Struct, frozen=True):
    """A change to a new plan ahead of a vehicle. Until then the vehicle flies by its present plan.

    Distance and speed are estimates without corners: the vehicle is not farther, and not faster.
    """

    in_s: float
    """time until the vehicle accepts the new plan [s]"""
    in_m: float
    """distance flown until then [m]"""
    speed_m_s: float
    """speed at that time [m/s]"""
    brakes_m_s2: float | None
    """deceleration to a stop [m/s²]; None: the vehicle does not stop"""

    @property
    def stops_in_s(self) -> float:
        """Time until the stop, or until the change of a vehicle that does not stop [s]."""
        return self.in_s + (self.speed_m_s / self.brakes_m_s2 if self.brakes_m_s2 else 0.0)

    @property
    def stops_in_m(self) -> float:
        """Distance to the stop, or to the change of a vehicle that does not stop [m]."""
        return self.in_m + (self.speed_m_s**2 / (2.0 * self.brakes_m_s2) if self.brakes_m_s2 else 0.0)


def distance_and_speed_after(state: AgentState, seconds: float) -> tuple[float, float]:
    """Return the estimated distance flown by the plan in `seconds` [m], and the final speed [m/s]."""
    planned_m_s, speed_m_s = state.speed.m_s or state.task.speed_m_s, state.vehicle.ground_speed_m_s
    top_m_s = max(speed_m_s, min(planned_m_s, speed_m_s + ACCELERATION_M_S2 * seconds))
    return 0.5 * (speed_m_s + top_m_s) * seconds, top_m_s


def change_for_new_plan(state: AgentState) -> MissionChange | None:
    """Return the change to a plan that is sent now; None if the vehicle flies no plan."""
    if state.plans.mission is None:
        return None
    return _change_of_plans(state, state.plans.swap_times.likely_s)


def change_ahead(state: AgentState) -> MissionChange | None:
    """Return the change to the pending plan, or to the plan for which the vehicle brakes; otherwise None."""
    if state.plans.mission is None:
        return None
    if state.plans.pending is None:
        return _stop_under_way(state)
    return _change_of_plans(state, max(swap_due_s(state), 0.0))


def _stop_under_way(state: AgentState) -> MissionChange | None:
    """Return the present stop of a vehicle that has just accepted a plan; None if it does not brake."""
    now_s, swaps = state.vehicle.time_boot_s, state.plans.swaps
    return _change(state, 0.0) if swaps.done_boot_s <= now_s < swaps.braking_until_boot_s else None


def _change_of_plans(state: AgentState, in_s: float) -> MissionChange:
    """Return the change to a plan that the vehicle accepts in `in_s`; during a present stop no second one."""
    stop = _stop_under_way(state)
    return stop if stop is not None and in_s <= stop.stops_in_s else _change(state, in_s)


def swap_due_s(state: AgentState) -> float:
    """Return the probable time until the pending plan is accepted [s]; below 0 if it is late."""
    plans = state.plans
    return plans.swaps.decided_boot_s + plans.swap_times.likely_s - state.vehicle.time_boot_s


def _change(state: AgentState, in_s: float) -> MissionChange:
    in_m, speed_m_s = distance_and_speed_after(state, in_s)
    brakes_m_s2 = state.vehicle.brakes_m_s2 if speed_m_s >= STANDING_M_S else None
    return MissionChange(in_s, in_m, speed_m_s, brakes_m_s2)


def stop_end_s(state: AgentState) -> float:
    """Return the end of a stop for which braking begins now, by the vehicle's clock [s].

    Without a stop the result is the present time.
    """
    return state.vehicle.time_boot_s + _change(state, 0.0).stops_in_s


def split_track(
    track: Sequence[PlanarPoint], at_m: float
) -> tuple[list[PlanarPoint], list[PlanarPoint]] | None:
    """Return the two parts of a track, split after `at_m` [m]; None if the track is shorter.

    Both parts have the split point. A corner at most CORNER_M after that point counts as the split point.
    """
    remaining_m = at_m
    for i, (a, b) in enumerate(pairwise(track), start=1):
        leg_m = math.dist(a, b)
        if leg_m - remaining_m > CORNER_M:
            share = remaining_m / leg_m
            point = (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]))
            return [*track[:i], point], [point, *track[i:]]
        remaining_m = max(remaining_m - leg_m, 0.0)
    return None


def after_stop(
    track: Sequence[PlanarPoint], initial_m_s: float, change: MissionChange | None
) -> tuple[float, Sequence[PlanarPoint], float]:
    """Return the time until the stop [s], the track after the stop, and the start speed on that track [m/s].

    Without a stop on the track the result is 0, the whole track and `initial_m_s`.
    """
    if change is None or not change.brakes_m_s2:
        return 0.0, track, initial_m_s
    parts = split_track(track, change.stops_in_m)
    return (0.0, track, initial_m_s) if parts is None else (change.stops_in_s, parts[1], 0.0)
