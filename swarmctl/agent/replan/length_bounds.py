"""Conversion of a vehicle's time bound to bounds on the remaining length of its route. Pure.

A time bound limits the time from the take-off to the arrival over the goal cell, without the descent. The
take-off is the first report that the vehicle is armed. Times are by the vehicle's own clock.
"""

from __future__ import annotations

import math

import msgspec

from swarmctl.agent.replan import travel_time
from swarmctl.agent.replan.climb import LIFT_S, climb_s

HOLD_S = 0.5
"""assumed hold for the first swap in flight [s]; later swaps use measured times"""

ROUNDING_CELLS = 1e-6
"""greatest rounding difference between a planner's length and this module's [cells]"""

HALF_DIAGONAL_CELLS = math.sqrt(0.5)
"""greatest distance between the edge of the goal cell and its centre [cells]"""


class TimeBound(msgspec.Struct, frozen=True):
    """The bound on a vehicle's arrival time, and the numbers that turn time into length."""

    speed_m_s: float = 10.0
    """ground speed [m/s]"""
    after_s: float = 0.0
    """earliest arrival, from the take-off [s]"""
    within_s: float = math.inf
    """latest arrival, from the take-off [s]"""
    approach_m: float = 0.0
    """distance from the take-off position to the centre of the entry cell [m]"""

    def __str__(self) -> str:
        if self.after_s > 0.0:
            is_open = math.isinf(self.within_s)
            return f"at least {self.after_s:g} s" if is_open else f"{self.after_s:g} to {self.within_s:g} s"
        return f"{self.within_s:g} s"

    @property
    def is_bounded(self) -> bool:
        return self.after_s > 0.0 or not math.isinf(self.within_s)


UNBOUNDED = TimeBound()


class LeadIn(msgspec.Struct, frozen=True):
    """The flight before the planned route: elapsed time, and remaining flight to the route's first cell."""

    elapsed_s: float
    """time since the take-off [s]"""
    climb_m: float
    """height still to climb [m]"""
    lead_m: float
    """distance to the centre of the route's first cell [m]; negative for a vehicle past the centre"""
    lost_s: float = 0.0
    """time lost by the lift-off, and by a stop at the start of the route [s]"""

    def arrives_s(self, arrival: TimeBound, length_m: float, lost_s: float = 0.0) -> float:
        """Return the arrival time for a route of this length, from the take-off [s].

        `lost_s` is the time lost at turns (`travel_time.lost_s`).
        """
        at_speed_s = (self.lead_m + length_m) / arrival.speed_m_s
        return self.elapsed_s + climb_s(max(self.climb_m, 0.0)) + self.lost_s + at_speed_s + lost_s


class LengthBounds(msgspec.Struct, frozen=True):
    """Bounds on the length of a route [cells]."""

    min_cells: float = 0.0
    max_cells: float = math.inf

    def misses_by(self, length_cells: float, lost_cells: float = 0.0) -> float:
        """Return the distance of a length from the bounds [cells]; 0 inside, and for a rounding difference.

        `lost_cells` is the length that could be flown in the time lost at turns. This length counts toward
        the greatest length only.
        """
        missed = max(self.min_cells - length_cells, length_cells + lost_cells - self.max_cells)
        return missed if missed > ROUNDING_CELLS else 0.0

    def with_reserve(self, cells: float) -> LengthBounds:
        """Return the bounds with the greatest length reduced by `cells`, but not below the middle of both."""
        kept = max(self.max_cells - cells, 0.5 * (self.min_cells + self.max_cells))
        return LengthBounds(self.min_cells, min(kept, self.max_cells))


def before_takeoff(arrival: TimeBound, altitude_m: float, start_delay_s: float) -> LeadIn:
    """Return the lead-in of a vehicle on the ground: a climb, the flight to the entry cell, and a stop.

    A stop at the entry cell is assumed, because the turn there may have any angle.
    """
    approach = ((0.0, 0.0), (arrival.approach_m, 0.0))
    lost_s = LIFT_S + travel_time.lost_s(approach, arrival.speed_m_s, start_delay_s=start_delay_s)
    return LeadIn(elapsed_s=0.0, climb_m=altitude_m, lead_m=arrival.approach_m, lost_s=lost_s)


def swap_loss_s(arrival: TimeBound, stop_s: float | None = None, brakes_m_s2: float | None = None) -> float:
    """Return the time lost by a swap before the new route begins [s], at least the time lost by braking.

    `stop_s` is the vehicle's measured stop (`SwapTimes.stop_s`); None: not measured, a stop is assumed.
    `brakes_m_s2` is the vehicle's deceleration before a new mission; None: the vehicle does not brake.
    """
    brakes_s = 0.0 if brakes_m_s2 is None else travel_time.braking_loss_s(arrival.speed_m_s, brakes_m_s2)
    return max(travel_time.braking_loss_s(arrival.speed_m_s) + HOLD_S if stop_s is None else stop_s, brakes_s)


def length_bounds(arrival: TimeBound, cell_size_m: float, lead_in: LeadIn) -> LengthBounds:
    """Return the bounds on the length of the route; both are 0 if no time is left.

    Time lost at turns is not part of the bounds. The least length ignores `lead_in.lost_s`, too, because a
    vehicle without losses must not be early.
    """
    if not arrival.is_bounded:
        return LengthBounds()
    at_route_s = lead_in.arrives_s(arrival, 0.0)
    at_best_s = at_route_s - lead_in.lost_s
    cells_per_s = arrival.speed_m_s / cell_size_m
    max_cells = max((arrival.within_s - at_route_s) * cells_per_s, 0.0)
    min_cells = (arrival.after_s - at_best_s) * cells_per_s + HALF_DIAGONAL_CELLS
    min_cells = min(max(min_cells, 0.0), max_cells) if arrival.after_s > 0.0 else 0.0
    return LengthBounds(min_cells, max_cells)
