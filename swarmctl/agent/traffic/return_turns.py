"""When each of many vehicles that are called back begins its return, so that no two meet. Pure.

A vehicle holds where it is, at its own height, until its turn; then it climbs, flies straight home and comes
down there. How high it climbs is a parameter of its firmware, and how fast it flies is not known exactly: it
is taken to be anywhere that a fast and a slow return allow, and vehicles that move are kept apart over ground
at whatever height they are.

Points are (east, north) [m] in one plane, heights above the sea [m], times from the moment of the call [s].
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmctl.core.frames import StateShared
from swarmctl.core.geo import LocalFrame, distance_m
from swarmctl.core.messages import VehiclePosition
from swarmctl.core.planar import distance_to_leg

PlanePoint = tuple[float, float]
Floats = NDArray[np.float64]
Steps = NDArray[np.int64]

LEAST_APART_M, LEAST_ABOVE_M = 20.0, 5.0
"""What vehicles that return keep over ground and in height, where they need not keep more."""
STEP_S = 2.0
"""Turns begin at multiples of this."""
FASTER, SLOWER = 1.25, 0.5
"""by which the speed over ground may differ from the expected: wind, and parameters of the return"""
REACTS_WITHIN_S = 10.0
CLIMBS_TO_M = 60.0
"""above home, at most; PX4's RTL_RETURN_ALT as it comes, more than ArduCopter's RTL_ALT"""
CLIMB_M_S = 1.5
SILENT_S = 10.0
"""Who is not heard for so long waits no more, and is taken to be on its way if it was."""
SINK_M_S = 0.8
"""from that height to the ground on the average, a wait above home included"""
MOST_AWAY_M, MOST_UP_M = 100_000.0, 10_000.0
"""Who tells of a longer way home, or of a greater height above it, is not waited for: it errs, or lies."""
LEAST_SPEED_M_S = 0.1
"""as nobody flies who tells of less"""


@dataclass(frozen=True, slots=True)
class ReturningVehicle:
    """A vehicle that is to return."""

    uav: int
    here: PlanePoint
    alt_amsl_m: float
    home: PlanePoint
    home_alt_amsl_m: float
    speed_m_s: float
    """expected over ground"""
    is_returning: bool = False
    """it is on its way already, and has no turn to wait for"""

    @property
    def way_m(self) -> float:
        return math.dist(self.here, self.home)

    @property
    def direction(self) -> PlanePoint:
        """Of its way, as long as 1; any where it is at home."""
        if self.way_m == 0.0:
            return 1.0, 0.0
        return (self.home[0] - self.here[0]) / self.way_m, (self.home[1] - self.here[1]) / self.way_m

    @property
    def top_amsl_m(self) -> float:
        """As high as it may climb."""
        return max(self.alt_amsl_m, self.home_alt_amsl_m + CLIMBS_TO_M)

    @property
    def departs_within_s(self) -> float:
        """Until the slowest has left its place."""
        return REACTS_WITHIN_S + (self.top_amsl_m - self.alt_amsl_m) / CLIMB_M_S

    @property
    def takes_s(self) -> float:
        """Until the slowest is down."""
        sinks_m = self.top_amsl_m - self.home_alt_amsl_m
        return self.departs_within_s + self.way_m / (SLOWER * self.speed_m_s) + sinks_m / SINK_M_S


@dataclass(frozen=True, slots=True)
class ReturnSchedule:
    """Who begins when."""

    begins_s: Mapping[int, float]
    """by system id, in the order of the turns"""
    down_s: float
    """when the slowest is down"""
    not_apart: tuple[tuple[int, int], ...] = ()
    """pairs of which the first passes the second's place while that holds: no order avoids it, and only their
    heights keep them apart"""


def schedule_returns(
    callers: Sequence[ReturningVehicle], *, horizontal_m: float, vertical_m: float
) -> ReturnSchedule:
    """The turn of each, so that no two come nearer than `horizontal_m` over ground, unless one of them holds
    and the other is `vertical_m` above or below it."""

    begins = {caller: 0 for caller in callers if caller.is_returning}
    waiting = sorted((c for c in callers if not c.is_returning), key=lambda c: (c.way_m, c.uav))
    passes = {
        mover: [h for h in waiting if h is not mover and _passes(mover, h, horizontal_m, vertical_m)]
        for mover in (*begins, *waiting)
    }
    not_apart = [(mover.uav, holder.uav) for mover in begins for holder in passes[mover]]
    in_the_way = {caller: len(passes[caller]) for caller in waiting}
    passed_by: dict[ReturningVehicle, list[ReturningVehicle]] = {caller: [] for caller in waiting}
    for mover in waiting:
        for holder in passes[mover]:
            passed_by[holder].append(mover)
    while in_the_way:
        nearest = min(in_the_way, key=in_the_way.__getitem__)
        not_apart += [(nearest.uav, holder.uav) for holder in passes[nearest] if holder in in_the_way]
        del in_the_way[nearest]
        for mover in passed_by[nearest]:
            if mover in in_the_way:
                in_the_way[mover] -= 1
        # Whom it passes must have left.
        from_step = max((begins[other] for other in passes[nearest] if other in begins), default=0)
        begins[nearest] = _first_turn(nearest, begins, from_step, horizontal_m)
    order = sorted(begins, key=lambda c: (begins[c], c.uav))
    return ReturnSchedule(
        {c.uav: STEP_S * begins[c] for c in order},
        max((STEP_S * begins[c] + c.takes_s for c in order), default=0.0),
        tuple(not_apart),
    )


def schedule_for(places: Mapping[int, VehiclePosition]) -> ReturnSchedule:
    """The turns of vehicles, by system id, each of which tells where it is and what it keeps from others."""
    if not places:
        return ReturnSchedule({}, 0.0)
    first = next(iter(places.values()))
    frame = LocalFrame(first.lat_deg, first.lon_deg)
    callers = [
        ReturningVehicle(
            uav,
            frame.to_local(place.lat_deg, place.lon_deg),
            place.alt_amsl_m,
            frame.to_local(place.home_lat_deg, place.home_lon_deg),
            place.home_alt_amsl_m,
            place.speed_m_s,
            place.is_returning,
        )
        for uav, place in places.items()
    ]
    keeps = [(LEAST_APART_M, LEAST_ABOVE_M), *(place.keeps_m for place in places.values())]
    return schedule_returns(
        callers, horizontal_m=max(k[0] for k in keeps), vertical_m=max(k[1] for k in keeps)
    )


def is_plausible(place: VehiclePosition) -> bool:
    """Whether turns can be reckoned with what a vehicle tells of itself; else it errs, or lies."""
    here, home = (place.lat_deg, place.lon_deg), (place.home_lat_deg, place.home_lon_deg)
    if not all(abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0 for lat_deg, lon_deg in (here, home)):
        return False
    is_near = distance_m(here, home) <= MOST_AWAY_M and all(0.0 <= m <= MOST_AWAY_M for m in place.keeps_m)
    up_m = place.alt_amsl_m - place.home_alt_amsl_m
    return is_near and abs(up_m) <= MOST_UP_M and LEAST_SPEED_M_S <= place.speed_m_s < math.inf


def place_from_state(state: StateShared, own: VehiclePosition) -> VehiclePosition | None:
    """Of one that is on the way home, or waits to be, by what it has told: as fast as this vehicle is, and
    keeping as much; from its ground, if it tells no height. None where it has told no home, or what cannot
    be."""
    if state.returns_to is None or abs(state.alt_rel_m) > MOST_UP_M:
        return None
    if distance_m((state.lat_deg, state.lon_deg), state.returns_to) > MOST_AWAY_M:
        return None
    if state.alt_amsl_m is None:
        alt_amsl_m, ground_amsl_m = own.home_alt_amsl_m + state.alt_rel_m, own.home_alt_amsl_m
    else:
        alt_amsl_m, ground_amsl_m = state.alt_amsl_m, state.alt_amsl_m - state.alt_rel_m
    return VehiclePosition(
        state.lat_deg,
        state.lon_deg,
        alt_amsl_m,
        *state.returns_to,
        ground_amsl_m,
        own.speed_m_s,
        own.keeps_m,
        is_returning=True,
    )


def may_be_returning(place: VehiclePosition, age_s: float) -> bool:
    """Whether one that was on the way home when it was heard, so long ago, may be yet: while it is silent for
    no longer than that takes."""
    return age_s <= max(SILENT_S, schedule_for({0: place}).down_s)


def describe_schedule(schedule_returns: ReturnSchedule, names: Mapping[int, str]) -> str:
    """Who returns when, as a line."""
    groups: dict[float, list[str]] = {}
    for uav, begins_s in schedule_returns.begins_s.items():
        groups.setdefault(begins_s, []).append(names[uav])
    when = [
        f"{', '.join(group)} {f'after {begins_s:g} s' if begins_s else 'at once'}"
        for begins_s, group in groups.items()
    ]
    pairs = ", ".join(f"{names[one]} past {names[other]}" for one, other in schedule_returns.not_apart)
    only = f"; only their heights keep apart {pairs}" if pairs else ""
    return f"{'; '.join(when)}; the last is down within {schedule_returns.down_s:.0f} s{only}"


def _first_turn(
    caller: ReturningVehicle, begins: Mapping[ReturningVehicle, int], from_step: int, horizontal_m: float
) -> int:
    """In steps, not before `from_step`."""
    taken = set[int]()
    for other, begun in begins.items():
        taken.update((_meetings(other, caller, horizontal_m) + begun).tolist())
    step = from_step
    while step in taken:
        step += 1
    return step


def _passes(
    mover: ReturningVehicle, holder: ReturningVehicle, horizontal_m: float, vertical_m: float
) -> bool:
    """Whether one that returns comes too near to the place at which another holds."""
    if holder.alt_amsl_m >= mover.top_amsl_m + vertical_m:
        return False
    if math.dist(mover.home, holder.here) < horizontal_m:
        return True
    if holder.alt_amsl_m <= mover.alt_amsl_m - vertical_m:
        return False
    return distance_to_leg(holder.here, mover.here, mover.home) < horizontal_m


def _meetings(one: ReturningVehicle, other: ReturningVehicle, horizontal_m: float) -> Steps:
    """By how many steps the other may not begin after the one, both being under way.

    On the other's straight way the places too near to a piece of the one's are a piece as well, because the
    places of both that are near each other are a convex set.
    """
    low_m, high_m = _near(one, other, *_reach(one), horizontal_m)
    first_m, last_m = _reach(other)
    begin, end = np.searchsorted(last_m, low_m, "left"), np.searchsorted(first_m, high_m, "right")
    steps = np.flatnonzero(begin < end)
    # In step i of the one the other is in its steps from begin to end - 1: it has begun so much later.
    changes = np.zeros(len(low_m) + len(first_m) + 1, dtype=np.int64)
    np.add.at(changes, steps - end[steps] + 1 + len(first_m), 1)
    np.add.at(changes, steps - begin[steps] + 1 + len(first_m), -1)
    lags: Steps = np.flatnonzero(np.cumsum(changes)) - len(first_m)
    return lags


def _near(
    one: ReturningVehicle, other: ReturningVehicle, first_m: Floats, last_m: Floats, horizontal_m: float
) -> tuple[Floats, Floats]:
    """From where to where along the other's way (steps,) it is too near to the one somewhere between
    `first_m` and `last_m` (steps,) along its own [m]; nowhere where the second is the less."""
    (ue, un), (ve, vn) = one.direction, other.direction
    east_m, north_m = one.here[0] - other.here[0], one.here[1] - other.here[1]
    # Seen along the other's way: `ahead` and `aside` of the one's begin, and of a metre of its way.
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


def _reach(caller: ReturningVehicle) -> tuple[Floats, Floats]:
    """From where to where on its way (steps,) it may be during each step of its return [m]."""
    begin_s = np.arange(0.0, caller.takes_s, STEP_S)
    slow_m = SLOWER * caller.speed_m_s * (begin_s - caller.departs_within_s)
    fast_m = FASTER * caller.speed_m_s * (begin_s + STEP_S)
    return np.clip(slow_m, 0.0, caller.way_m), np.clip(fast_m, 0.0, caller.way_m)
