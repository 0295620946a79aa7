"""Schedule of returns: start times for recalled vehicles, so that no two vehicles conflict. Pure.

A vehicle holds at its position and height until its start. Then it climbs, flies straight home and lands. The
return height is a parameter of the firmware, and the speed is uncertain. So the vehicle may be anywhere
between the positions of a fast and of a slow return. Heights do not separate two vehicles that return.

Points are (east, north) [m] in one plane, heights above the sea [m], times from the moment of the recall [s].
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from swarmctl.core.frames import StateShared
from swarmctl.core.geo import LocalFrame, distance_m
from swarmctl.core.messages import VehiclePosition
from swarmctl.core.planar import PlanarPoint, distance_to_leg

Floats = NDArray[np.float64]
Steps = NDArray[np.int64]

MIN_HORIZONTAL_M, MIN_VERTICAL_M = 20.0, 5.0
"""Least horizontal and vertical separation of returning vehicles [m]."""
STEP_S = 2.0
"""Resolution of the start times [s]."""
FAST_FACTOR, SLOW_FACTOR = 1.25, 0.5
"""Factors on the expected ground speed, for wind and for the parameters of the return."""
CLIMBS_WITHIN_S = 10.0
"""Longest time from the start of the return to the climb [s]."""
CLIMBS_TO_M = 60.0
"""Greatest return height above home [m]: PX4's default RTL_RETURN_ALT, more than ArduCopter's RTL_ALT."""
LEAST_CLIMB_M_S = 1.5
"""Least climb rate [m/s]."""
MIN_SILENCE_S = 10.0
"""Shortest silence after which a returning vehicle may count as landed [s]."""
MEAN_SINK_M_S = 0.8
"""Average descent rate from the return height to the ground [m/s], including a wait above home."""
MAX_HOME_DISTANCE_M, MAX_HOME_HEIGHT_M = 100_000.0, 10_000.0
"""Greatest plausible distance and height above home [m]; beyond them the sender errs or lies."""
MIN_SPEED_M_S = 0.1
"""Least plausible announced speed [m/s]."""


class ReturningVehicle(msgspec.Struct, frozen=True):
    """A recalled vehicle."""

    uav: int
    here: PlanarPoint
    alt_amsl_m: float
    home: PlanarPoint
    home_alt_amsl_m: float
    speed_m_s: float
    """expected ground speed [m/s]"""
    is_returning: bool = False
    """True if the vehicle already returns; its start is then 0 s"""

    @property
    def home_distance_m(self) -> float:
        """Distance home over ground [m]."""
        return math.dist(self.here, self.home)

    @property
    def direction(self) -> PlanarPoint:
        """Unit vector towards home; arbitrary at home."""
        if self.home_distance_m == 0.0:
            return 1.0, 0.0
        return (self.home[0] - self.here[0]) / self.home_distance_m, (
            self.home[1] - self.here[1]
        ) / self.home_distance_m

    @property
    def top_amsl_m(self) -> float:
        """Greatest possible height above the sea during the return [m]."""
        return max(self.alt_amsl_m, self.home_alt_amsl_m + CLIMBS_TO_M)

    @property
    def departs_within_s(self) -> float:
        """Longest time until the vehicle leaves its position [s]."""
        return CLIMBS_WITHIN_S + (self.top_amsl_m - self.alt_amsl_m) / LEAST_CLIMB_M_S

    @property
    def takes_s(self) -> float:
        """Longest time until the vehicle has landed [s]."""
        sinks_m = self.top_amsl_m - self.home_alt_amsl_m
        return (
            self.departs_within_s
            + self.home_distance_m / (SLOW_FACTOR * self.speed_m_s)
            + sinks_m / MEAN_SINK_M_S
        )


class ReturnSchedule(msgspec.Struct, frozen=True):
    """Start times of returns."""

    begins_s: Mapping[int, float]
    """start by system id [s], in order of time"""
    all_landed_s: float
    height_only: tuple[tuple[int, int], ...] = ()
    """pairs that only height can separate: the first vehicle passes near the second vehicle, which holds"""


def schedule_returns(
    vehicles: Sequence[ReturningVehicle], *, horizontal_m: float, vertical_m: float
) -> ReturnSchedule:
    """Return start times with which no two vehicles come closer than `horizontal_m` over ground.

    Exceptions: a vehicle may pass at least `vertical_m` above or below a vehicle that holds. Pairs in
    `height_only`, and two vehicles that already return, may come closer.
    """
    start_steps = {vehicle: 0 for vehicle in vehicles if vehicle.is_returning}
    waiting = sorted((c for c in vehicles if not c.is_returning), key=lambda c: (c.home_distance_m, c.uav))
    passes = {
        mover: [h for h in waiting if h is not mover and _passes(mover, h, horizontal_m, vertical_m)]
        for mover in (*start_steps, *waiting)
    }
    height_only = [(mover.uav, holder.uav) for mover in start_steps for holder in passes[mover]]
    n_in_the_way = {vehicle: len(passes[vehicle]) for vehicle in waiting}
    passed_by: dict[ReturningVehicle, list[ReturningVehicle]] = {vehicle: [] for vehicle in waiting}
    for mover in waiting:
        for holder in passes[mover]:
            passed_by[holder].append(mover)
    while n_in_the_way:
        freest = min(n_in_the_way, key=n_in_the_way.__getitem__)
        height_only += [(freest.uav, holder.uav) for holder in passes[freest] if holder in n_in_the_way]
        del n_in_the_way[freest]
        for mover in passed_by[freest]:
            if mover in n_in_the_way:
                n_in_the_way[mover] -= 1
        # The vehicles on the path of `freest` start no later.
        from_step = max((start_steps[other] for other in passes[freest] if other in start_steps), default=0)
        start_steps[freest] = _first_free_step(freest, start_steps, from_step, horizontal_m)
    order = sorted(start_steps, key=lambda c: (start_steps[c], c.uav))
    return ReturnSchedule(
        {c.uav: STEP_S * start_steps[c] for c in order},
        max((STEP_S * start_steps[c] + c.takes_s for c in order), default=0.0),
        tuple(height_only),
    )


def schedule_for(positions: Mapping[int, VehiclePosition]) -> ReturnSchedule:
    """Return the schedule for vehicles by system id, from their announced positions and separations."""
    if not positions:
        return ReturnSchedule({}, 0.0)
    first = next(iter(positions.values()))
    frame = LocalFrame(first.lat_deg, first.lon_deg)
    vehicles = [
        ReturningVehicle(
            uav,
            frame.to_local(position.lat_deg, position.lon_deg),
            position.alt_amsl_m,
            frame.to_local(position.home_lat_deg, position.home_lon_deg),
            position.home_alt_amsl_m,
            position.speed_m_s,
            position.is_returning,
        )
        for uav, position in positions.items()
    ]
    least_m = (MIN_HORIZONTAL_M, MIN_VERTICAL_M)
    limits_m = zip(least_m, *(position.min_separation_m for position in positions.values()), strict=True)
    horizontal_m, vertical_m = (max(values) for values in limits_m)
    return schedule_returns(vehicles, horizontal_m=horizontal_m, vertical_m=vertical_m)


def is_plausible(position: VehiclePosition) -> bool:
    """Return whether an announced position can be scheduled; otherwise the sender errs or lies."""
    here, home = (position.lat_deg, position.lon_deg), (position.home_lat_deg, position.home_lon_deg)
    if not all(abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0 for lat_deg, lon_deg in (here, home)):
        return False
    is_near = distance_m(here, home) <= MAX_HOME_DISTANCE_M and all(
        0.0 <= m <= MAX_HOME_DISTANCE_M for m in position.min_separation_m
    )
    up_m = position.alt_amsl_m - position.home_alt_amsl_m
    return is_near and abs(up_m) <= MAX_HOME_HEIGHT_M and MIN_SPEED_M_S <= position.speed_m_s < math.inf


def position_from_state(state: StateShared, own: VehiclePosition) -> VehiclePosition | None:
    """Return the position of a vehicle that returns or waits to return, from its broadcast state.

    Speed and separation come from `own`. The result is None if the vehicle does not return, or if the state
    is implausible.
    """
    if state.returns_to is None or abs(state.alt_rel_m) > MAX_HOME_HEIGHT_M:
        return None
    if distance_m((state.lat_deg, state.lon_deg), state.returns_to) > MAX_HOME_DISTANCE_M:
        return None
    return VehiclePosition(
        state.lat_deg,
        state.lon_deg,
        state.alt_amsl_m,
        *state.returns_to,
        state.alt_amsl_m - state.alt_rel_m,
        own.speed_m_s,
        own.min_separation_m,
        is_returning=True,
    )


def may_be_returning(position: VehiclePosition, age_s: float) -> bool:
    """Return whether a vehicle that was returning `age_s` [s] ago may still be on its return."""
    return age_s <= max(MIN_SILENCE_S, schedule_for({0: position}).all_landed_s)


def describe_schedule(schedule: ReturnSchedule, names: Mapping[int, str]) -> str:
    """Return the schedule as one line of text."""
    groups: dict[float, list[str]] = {}
    for uav, begins_s in schedule.begins_s.items():
        groups.setdefault(begins_s, []).append(names[uav])
    when = [
        f"{', '.join(group)} {f'after {begins_s:g} s' if begins_s else 'at once'}"
        for begins_s, group in groups.items()
    ]
    pairs = ", ".join(f"{names[one]} passing {names[other]}" for one, other in schedule.height_only)
    only = f"; only height can separate: {pairs}" if pairs else ""
    return f"{'; '.join(when)}; all vehicles have landed after {schedule.all_landed_s:.0f} s{only}"


def _first_free_step(
    vehicle: ReturningVehicle, starts: Mapping[ReturningVehicle, int], from_step: int, horizontal_m: float
) -> int:
    """Return the first start without a conflict [steps], not before `from_step`."""
    taken = set[int]()
    for other, start_step in starts.items():
        taken.update((_conflicting_delays(other, vehicle, horizontal_m) + start_step).tolist())
    step = from_step
    while step in taken:
        step += 1
    return step


def _passes(
    mover: ReturningVehicle, holder: ReturningVehicle, horizontal_m: float, vertical_m: float
) -> bool:
    """Return whether a returning vehicle passes too close to the position of a holding vehicle."""
    if holder.alt_amsl_m >= mover.top_amsl_m + vertical_m:
        return False
    if math.dist(mover.home, holder.here) < horizontal_m:
        return True
    if holder.alt_amsl_m <= mover.alt_amsl_m - vertical_m:
        return False
    return distance_to_leg(holder.here, mover.here, mover.home) < horizontal_m


def _conflicting_delays(one: ReturningVehicle, other: ReturningVehicle, horizontal_m: float) -> Steps:
    """Return the delays [steps] of the start of `other` after the start of `one` that cause a conflict.

    The pairs of positions that are too close form a convex set. So for each piece of the path of `one`, a
    single piece of the path of `other` is too close.
    """
    low_m, high_m = _close_piece_m(one, other, *_distance_range_m(one), horizontal_m)
    first_m, last_m = _distance_range_m(other)
    begin, end = np.searchsorted(last_m, low_m, "left"), np.searchsorted(first_m, high_m, "right")
    steps = np.flatnonzero(begin < end)
    # In step i of `one`, `other` is in one of its steps begin to end - 1: each difference is a delay.
    changes = np.zeros(len(low_m) + len(first_m) + 1, dtype=np.int64)
    np.add.at(changes, steps - end[steps] + 1 + len(first_m), 1)
    np.add.at(changes, steps - begin[steps] + 1 + len(first_m), -1)
    delays: Steps = np.flatnonzero(np.cumsum(changes)) - len(first_m)
    return delays


def _close_piece_m(
    one: ReturningVehicle, other: ReturningVehicle, first_m: Floats, last_m: Floats, horizontal_m: float
) -> tuple[Floats, Floats]:
    """Return the ends of the piece of the path of `other` that is too close to `one` in each step [m].

    Both arrays have the shape (steps,). In each step, `one` is between `first_m` and `last_m` (steps,) of its
    path. A piece with its second end before its first end is empty.
    """
    (ue, un), (ve, vn) = one.direction, other.direction
    east_m, north_m = one.here[0] - other.here[0], one.here[1] - other.here[1]
    # In the frame along the path of `other`: start (ahead, aside) and direction (along, across) of `one`.
    ahead, aside = east_m * ve + north_m * vn, north_m * ve - east_m * vn
    along, across = ue * ve + un * vn, un * ve - ue * vn
    if abs(across) < 1e-9:
        if abs(aside) >= horizontal_m:
            return np.full_like(first_m, np.inf), np.full_like(first_m, -np.inf)
        begin_m, end_m = first_m, last_m
        lowest, highest = (begin_m, end_m) if along > 0.0 else (end_m, begin_m)
    else:
        ends = sorted(((-horizontal_m - aside) / across, (horizontal_m - aside) / across))
        begin_m, end_m = np.maximum(first_m, ends[0]), np.minimum(last_m, ends[1])
        turn_m = horizontal_m * along / across * abs(across)
        lowest = np.clip((-turn_m - aside) / across, begin_m, end_m)
        highest = np.clip((turn_m - aside) / across, begin_m, end_m)

    def half_m(at_m: Floats) -> Floats:
        return np.sqrt(np.maximum(horizontal_m**2 - (aside + across * at_m) ** 2, 0.0))

    is_somewhere = begin_m <= end_m
    low_m = np.where(is_somewhere, ahead + along * lowest - half_m(lowest), np.inf)
    high_m = np.where(is_somewhere, ahead + along * highest + half_m(highest), -np.inf)
    return low_m, high_m


def _distance_range_m(vehicle: ReturningVehicle) -> tuple[Floats, Floats]:
    """Return the least and the greatest distance from the start (steps,) [m] in each step of the return."""
    begin_s = np.arange(0.0, vehicle.takes_s, STEP_S)
    slow_m = SLOW_FACTOR * vehicle.speed_m_s * (begin_s - vehicle.departs_within_s)
    fast_m = FAST_FACTOR * vehicle.speed_m_s * (begin_s + STEP_S)
    return np.clip(slow_m, 0.0, vehicle.home_distance_m), np.clip(fast_m, 0.0, vehicle.home_distance_m)
