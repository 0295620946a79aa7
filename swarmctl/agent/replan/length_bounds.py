"""From a time bound of a vehicle to bounds on the length of what remains of its route. Pure.

A bound counts from the take-off, which is when the vehicle is first seen armed, to when it is over its goal
cell; what it takes to come down is not counted. Times are by the vehicle's own clock.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from swarmctl.agent.replan import travel_time

CLIMB_M_S = 2.5
"""at which vehicles are taken to climb to their altitude: ArduCopter's WPNAV_SPEED_UP as it comes"""

LIFT_S = 1.5
"""what leaving the ground costs beyond that: until the motors turn and the climb is under way"""

HOLD_S = 0.5
"""for so long a vehicle is taken to hold for its first change of mission in flight: then it is measured"""

ROUNDING_CELLS = 1e-6
"""by so much the sums of a planner may differ from ours; it is some micrometres of way"""

HALF_DIAGONAL_CELLS = math.sqrt(0.5)
"""before its centre, at most, a vehicle is over its goal cell"""


@dataclass(frozen=True, slots=True)
class TimeBound:
    """When a vehicle is to be over its goal, and what turns that time into length."""

    speed_m_s: float = 10.0
    """over ground"""
    after_s: float = 0.0
    """not earlier, from its take-off"""
    within_s: float = math.inf
    """not later, from its take-off"""
    approach_m: float = 0.0
    """from where it takes off to the centre of its entry cell"""

    def __str__(self) -> str:
        if self.after_s > 0.0:
            return f"{self.after_s:g} to {self.within_s:g} s"
        return f"{self.within_s:g} s"

    @property
    def is_bounded(self) -> bool:
        return self.after_s > 0.0 or not math.isinf(self.within_s)


UNBOUNDED = TimeBound()


@dataclass(frozen=True, slots=True)
class LeadIn:
    """What is behind a vehicle, and what lies between it and the route that is planned."""

    elapsed_s: float
    """since its take-off"""
    climb_m: float
    """still to climb"""
    lead_m: float
    """from where it is to the centre of the cell the route begins in; negative where it is past it already"""
    lost_s: float = 0.0
    """what leaving the ground, and stopping where the route begins, cost on that way"""

    def arrives_s(self, arrival: TimeBound, length_m: float, lost_s: float = 0.0) -> float:
        """When it is over its goal with a route of this length, from its take-off; `lost_s` at its turns
        (`pace.lost_s`)."""
        climb_s = max(self.climb_m, 0.0) / CLIMB_M_S
        at_speed_s = (self.lead_m + length_m) / arrival.speed_m_s
        return self.elapsed_s + climb_s + self.lost_s + at_speed_s + lost_s


@dataclass(frozen=True, slots=True)
class LengthBounds:
    """Bounds on the length of a route [cells]."""

    min_cells: float = 0.0
    max_cells: float = math.inf

    def misses_by(self, length_cells: float, lost_cells: float = 0.0) -> float:
        """How far outside a length lies [cells]; 0 inside, and where rounding may have put it outside.
        `lost_cells` could be flown in the time lost at turns: they make it late, and never late enough."""
        missed = max(self.min_cells - length_cells, length_cells + lost_cells - self.max_cells)
        return missed if missed > ROUNDING_CELLS else 0.0

    def less(self, cells: float) -> LengthBounds:
        """With so much kept free at its late end, but never more than half of it."""
        kept = max(self.max_cells - cells, 0.5 * (self.min_cells + self.max_cells))
        return LengthBounds(self.min_cells, min(kept, self.max_cells))


def before_takeoff(arrival: TimeBound, altitude_m: float) -> LeadIn:
    """A vehicle on the ground: it climbs first, then flies to its entry, where it may have to turn by any
    angle and is taken to stop."""
    approach = ((0.0, 0.0), (arrival.approach_m, 0.0))
    lost_s = LIFT_S + travel_time.lost_s(approach, arrival.speed_m_s)
    return LeadIn(elapsed_s=0.0, climb_m=altitude_m, lead_m=arrival.approach_m, lost_s=lost_s)


def change_s(arrival: TimeBound, stop_s: float | None = None, brakes_m_s2: float | None = None) -> float:
    """What changing the mission in flight costs before the new route is begun: for as long as that makes the
    vehicle stand (`SwapTimes.stop_s`), where that is known, and at least what it loses by braking for it."""
    brakes_s = 0.0 if brakes_m_s2 is None else travel_time.brake_s(arrival.speed_m_s, brakes_m_s2)
    return max(travel_time.brake_s(arrival.speed_m_s) + HOLD_S if stop_s is None else stop_s, brakes_s)


def length_bounds(arrival: TimeBound, cell_size_m: float, underway: LeadIn) -> LengthBounds:
    """What the bound leaves for the length of the route, if it loses no time at turns. Where nothing is left,
    both ends are 0. At the early end nothing is reckoned lost: it must hold however well a vehicle turns."""
    if not arrival.is_bounded:
        return LengthBounds()
    at_once_s = underway.arrives_s(arrival, 0.0)
    at_best_s = at_once_s - underway.lost_s
    cells_per_s = arrival.speed_m_s / cell_size_m
    latest = max((arrival.within_s - at_once_s) * cells_per_s, 0.0)
    earliest = (arrival.after_s - at_best_s) * cells_per_s + HALF_DIAGONAL_CELLS
    earliest = min(max(earliest, 0.0), latest) if arrival.after_s > 0.0 else 0.0
    return LengthBounds(earliest, latest)
