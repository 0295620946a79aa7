"""The stop of a vehicle that brakes for a new plan: its time, its place and its cost. Pure.

An ArduPilot copter that is sent to another mission item brakes to a stop first, wherever that item is
(`VehicleState.brakes_m_s2`). Until then it flies by its old plan; from there it speeds up again. At speed v
and deceleration b, braking costs v / 2b, and speeding up as much again: about 4 s at 10 m/s.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from swarmctl.agent.replan.travel_time import ACCELERATION_M_S2
from swarmctl.agent.state import AgentState
from swarmctl.core.planar import PlanarPoint

STANDING_M_S = 1.0
"""Greatest speed of a vehicle that needs no stop [m/s]."""
RESTART_M_S = 0.1
"""Begin speed after a stop [m/s]: above 0, because the vehicle does not swerve there as at a corner."""
CORNER_M = 0.01
"""Distance behind a stop within which a corner counts as the stop [m]."""


@dataclass(frozen=True, slots=True)
class BrakingStop:
    """A stop on the track ahead of a vehicle."""

    on_s: float
    """time until it brakes [s]"""
    on_m: float
    """distance until it brakes [m]"""
    speed_m_s: float
    """speed at which it begins to brake [m/s]"""
    brakes_m_s2: float
    """deceleration [m/s²]"""

    @property
    def in_s(self) -> float:
        """Time until it stops [s]."""
        return self.on_s + self.speed_m_s / self.brakes_m_s2

    @property
    def in_m(self) -> float:
        """Distance until it stops [m]."""
        return self.on_m + self.speed_m_s**2 / (2.0 * self.brakes_m_s2)

    def passed_s(self, way_m: float) -> float:
        """Return the time at which `way_m` of that distance is flown [s]; the speed is constant before
        braking."""
        if way_m <= self.on_m:
            return self.on_s * way_m / self.on_m if self.on_m > 0.0 else 0.0
        return self.in_s - math.sqrt(2.0 * max(self.in_m - way_m, 0.0) / self.brakes_m_s2)


def distance_and_speed_after(state: AgentState, seconds: float) -> tuple[float, float]:
    """Return the distance flown after `seconds` by the plan, with speeding up [m], and the speed then
    [m/s]."""
    told_m_s, speed_m_s = state.speed_m_s or state.task.arrival.speed_m_s, state.vehicle.ground_speed_m_s
    top_m_s = max(speed_m_s, min(told_m_s, speed_m_s + ACCELERATION_M_S2 * seconds))
    return 0.5 * (speed_m_s + top_m_s) * seconds, top_m_s


def stop_for_new(state: AgentState) -> BrakingStop | None:
    """Return the stop for a plan that is sent now; None without one."""
    return _stop(state, state.swap_times.likely_s) if state.route is not None else None


def stop_ahead(state: AgentState) -> BrakingStop | None:
    """Return the stop for the pending plan, or for the one just accepted; None without one."""
    now_s = state.vehicle.time_boot_s
    if state.pending is not None:
        due_s = state.swap_started_boot_s + state.swap_times.likely_s
        return _stop(state, max(due_s - now_s, 0.0)) if state.route is not None else None
    return _stop(state, 0.0) if state.swapped_boot_s <= now_s < state.braking_until_boot_s else None


def _stop(state: AgentState, on_s: float) -> BrakingStop | None:
    brakes_m_s2 = state.vehicle.brakes_m_s2
    if brakes_m_s2 is None:
        return None
    on_m, speed_m_s = distance_and_speed_after(state, on_s)
    return BrakingStop(on_s, on_m, speed_m_s, brakes_m_s2) if speed_m_s >= STANDING_M_S else None


def stopped_at(state: AgentState) -> float:
    """Return the end of braking, by the vehicle's clock, if it starts its plan now; now without a stop."""
    stop = _stop(state, 0.0)
    return state.vehicle.time_boot_s + (0.0 if stop is None else stop.in_s)


def split_track(
    track: Sequence[PlanarPoint], at_m: float
) -> tuple[list[PlanarPoint], list[PlanarPoint]] | None:
    """Return a track up to `at_m`, and the rest of it, both with that place; None if the track is shorter.

    A corner nearer than CORNER_M behind that place counts as the place.
    """
    left_m = at_m
    for i, (a, b) in enumerate(pairwise(track), start=1):
        leg_m = math.dist(a, b)
        if leg_m - left_m > CORNER_M:
            share = left_m / leg_m
            place = (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]))
            return [*track[:i], place], [place, *track[i:]]
        left_m = max(left_m - leg_m, 0.0)
    return None


def after_stop(
    track: Sequence[PlanarPoint], begins_m_s: float, stop: BrakingStop | None
) -> tuple[float, Sequence[PlanarPoint], float]:
    """Return the time of the stop, the track after it and the begin speed there; the whole track without a
    stop."""
    parts = None if stop is None else split_track(track, stop.in_m)
    if stop is None or parts is None:
        return 0.0, track, begins_m_s
    return stop.in_s, parts[1], RESTART_M_S
