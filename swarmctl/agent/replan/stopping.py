"""What taking up another plan costs a vehicle that brakes for it, and where on its way that is. Pure.

A copter of ArduPilot that is told to fly to another item brakes down to a stop first, wherever that item is
(`VehicleState.brakes_m_s2`). Until then it flies on along its old plan; from there it speeds up again. At v,
braking by b, it is v / 2b later than who flies on, and as much again for speeding up: some 4 s at 10 m/s.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from swarmctl.agent.replan.travel_time import ACCELERATION_M_S2
from swarmctl.agent.state import AgentState
from swarmctl.core.planar import PlanarPoint

STANDS_M_S = 1.0
"""Who is slower stops for nothing."""
ANEW_M_S = 0.1
"""From where it has stopped it flies straight on: it does not swerve as from a corner."""
CORNER_M = 0.01


@dataclass(frozen=True, slots=True)
class BrakingStop:
    """On the way ahead of a vehicle."""

    on_s: float
    """so long it flies on before it brakes …"""
    on_m: float
    """… and so far"""
    speed_m_s: float
    """from which it brakes …"""
    brakes_m_s2: float
    """… so hard"""

    @property
    def in_s(self) -> float:
        """until it stops"""
        return self.on_s + self.speed_m_s / self.brakes_m_s2

    @property
    def in_m(self) -> float:
        """of way until then"""
        return self.on_m + self.speed_m_s**2 / (2.0 * self.brakes_m_s2)

    def passed_s(self, way_m: float) -> float:
        """When so much of that is flown: at one speed until it brakes."""
        if way_m <= self.on_m:
            return self.on_s * way_m / self.on_m if self.on_m > 0.0 else 0.0
        return self.in_s - math.sqrt(2.0 * max(self.in_m - way_m, 0.0) / self.brakes_m_s2)


def distance_and_speed_after(state: AgentState, seconds: float) -> tuple[float, float]:
    """How far it flies in so long along its plan [m], speeding up, and how fast it is then."""
    told_m_s, speed_m_s = state.speed_m_s or state.task.arrival.speed_m_s, state.vehicle.ground_speed_m_s
    top_m_s = max(speed_m_s, min(told_m_s, speed_m_s + ACCELERATION_M_S2 * seconds))
    return 0.5 * (speed_m_s + top_m_s) * seconds, top_m_s


def stop_for_new(state: AgentState) -> BrakingStop | None:
    """Where it stops if it is given another plan now; None where it does not."""
    return _stop(state, state.swap_times.likely_s) if state.route is not None else None


def stop_ahead(state: AgentState) -> BrakingStop | None:
    """Where it stops for the plan that is on its way to it, or that it has just got; None: it does not."""
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
    return BrakingStop(on_s, on_m, speed_m_s, brakes_m_s2) if speed_m_s >= STANDS_M_S else None


def stopped_at(state: AgentState) -> float:
    """When one that begins to take up its plan now has braked for it, by its clock; now if it does not."""
    stop = _stop(state, 0.0)
    return state.vehicle.time_boot_s + (0.0 if stop is None else stop.in_s)


def split_track(
    track: Sequence[PlanarPoint], at_m: float
) -> tuple[list[PlanarPoint], list[PlanarPoint]] | None:
    """A track until so much of it is flown, and the rest, both with that place; None where it ends before.
    A corner nearer than CORNER_M behind that place is it."""
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
    """What of a track is after the stop, when that is begun, and how fast; all of it where there is none."""
    parts = None if stop is None else split_track(track, stop.in_m)
    if stop is None or parts is None:
        return 0.0, track, begins_m_s
    return stop.in_s, parts[1], ANEW_M_S
