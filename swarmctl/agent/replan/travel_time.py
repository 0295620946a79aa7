"""The travel time of a copter on a track, with braking before turns and speeding up after them. Pure.

Acceleration, jerk and corner radius are the defaults of ArduCopter's parameters; the other constants are
estimates. ArduCopter plans each leg from rest to rest, and blends it with its neighbours: so a short leg is
slow, even straight on. A PX4 is faster on short legs (`docs/measured.md`). Estimates of turns are high, so
that a vehicle is early rather than late.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence
from itertools import pairwise

import msgspec

from swarmctl.core.planar import PlanarPoint
from swarmctl.core.vehicle import BRAKING_M_S2

ACCELERATION_M_S2 = 2.5
"""WPNAV_ACCEL"""
JERK_M_S3 = 1.0
"""WPNAV_JERK"""
LEG_SHARE = 0.95
"""Greatest speed on a short leg, as a share of the greatest one between two stops with JERK_M_S3."""
CORNER_RADIUS_M = 2.0
"""WPNAV_RADIUS: greatest distance from a corner at which the vehicle may cut the corner"""
CORNER_SHARE = 0.75
"""Estimated speed at a corner, as a share of the speed by ACCELERATION_M_S2 and CORNER_RADIUS_M."""
SETTLE_S = 0.8
"""additional time at each turn at which the vehicle slows down, until it follows the next leg [s]"""
STARTED_M_S = 1.0
"""Speed from which a start is no longer delayed [m/s]; below, the delay (`VehicleState.start_delay_s`) falls
evenly."""
STRAIGHT_RAD = 0.1
"""Greatest turn that counts as straight [rad]."""
BESIDE_M, BESIDE_RAD = 3.0, 0.5
"""Greatest distance from the line of a leg [m], and greatest turn [rad], with which a vehicle beside the line
flies on to it as if it came along the line."""
LEAST_RAMP_S = 0.5
"""Least time between two points of a timed track between corners [s]."""
LEAST_RAMP_M = 0.1
"""Least distance of such a point from the next corner [m]."""


def braking_loss_s(speed_m_s: float, brakes_m_s2: float = BRAKING_M_S2) -> float:
    """Return how much longer braking to a stop takes than the same distance at full speed [s]."""
    return speed_m_s / (2.0 * brakes_m_s2)


def lost_s(
    track: Sequence[PlanarPoint],
    speed_m_s: float,
    *,
    initial_m_s: float = 0.0,
    remaining_m: float = 0.0,
    start_delay_s: float,
) -> float:
    """Return the time lost by braking and turns on a track that ends in a stop [s]; at least 0.

    The loss is the time of `arrives_s`, minus the time for the whole track at constant `speed_m_s`.
    """
    at_speed_s = math.fsum(math.dist(a, b) for a, b in pairwise(_corners(track))) / speed_m_s
    arrival_s = arrives_s(
        track, speed_m_s, initial_m_s=initial_m_s, remaining_m=remaining_m, start_delay_s=start_delay_s
    )
    return max(arrival_s - at_speed_s, 0.0)


def arrives_s(
    track: Sequence[PlanarPoint],
    speed_m_s: float,
    *,
    initial_m_s: float = 0.0,
    remaining_m: float = 0.0,
    start_delay_s: float,
) -> float:
    """Return the time until a vehicle is `remaining_m` before the end of a track that ends in a stop [s].

    `initial_m_s` is the speed at the start, `start_delay_s` the delay of a start from a stand. The result is
    not before the start of the last leg.
    """
    _, legs = _corners_and_legs(track, speed_m_s, initial_m_s, start_delay_s)
    if not legs:
        return 0.0
    last = legs[-1]
    return math.fsum(leg.duration_s for leg in legs) - last.last_s(min(remaining_m, last.length_m))


class TimedTrack(msgspec.Struct, frozen=True):
    """A flight along a track that ends in a stop, as points with times."""

    points: Sequence[PlanarPoint]
    """both ends, the corners, and points between them, (east, north) [m]"""
    at_m: Sequence[float]
    """distance of each point along the track [m]"""
    times_s: Sequence[float]
    """time from the start to each point [s]"""
    speeds_m_s: Sequence[float]
    """speed at each point [m/s]"""

    def at(self, distance_m: float) -> tuple[PlanarPoint, float]:
        """Return the point at a distance along the track, and the time from the start to it [s]."""
        if distance_m <= 0.0:
            return self.points[0], self.times_s[0]
        if distance_m >= self.at_m[-1]:
            return self.points[-1], self.times_s[-1]
        i = bisect_left(self.at_m, distance_m) - 1
        share = (distance_m - self.at_m[i]) / (self.at_m[i + 1] - self.at_m[i])
        (e0, n0), (e1, n1) = self.points[i : i + 2]
        slow, fast = self.speeds_m_s[i : i + 2]
        # By constant acceleration, share · mean = slow · u + change · u² / 2, with the share u of the time.
        mean_m_s, change_m_s = 0.5 * (slow + fast), fast - slow
        if abs(change_m_s) > 1e-6 * mean_m_s:
            root = math.sqrt(max(slow * slow + 2.0 * change_m_s * mean_m_s * share, 0.0))
            u = (root - slow) / change_m_s
        else:
            u = share
        t0, t1 = self.times_s[i : i + 2]
        return (e0 + share * (e1 - e0), n0 + share * (n1 - n0)), t0 + u * (t1 - t0)

    def after(self, seconds: float) -> tuple[float, float]:
        """Return the distance flown after a time [m], and the speed then [m/s]."""
        if seconds >= self.times_s[-1]:
            return self.at_m[-1], 0.0
        i = max(bisect_right(self.times_s, seconds), 1) - 1
        u = (seconds - self.times_s[i]) / (self.times_s[i + 1] - self.times_s[i])
        slow, fast = self.speeds_m_s[i : i + 2]
        share = u * (2.0 * slow + (fast - slow) * u) / (slow + fast) if slow + fast > 0.0 else u
        return self.at_m[i] + share * (self.at_m[i + 1] - self.at_m[i]), slow + u * (fast - slow)


def timed_track(
    track: Sequence[PlanarPoint],
    speed_m_s: float,
    *,
    initial_m_s: float = 0.0,
    start_delay_s: float,
    ramps_s: float = math.inf,
) -> TimedTrack:
    """Return the flight from the speed `initial_m_s` along a track, of at least one point, to a stop.

    Legs that begin after `ramps_s` have no points between their corners.
    """
    corners, legs = _corners_and_legs(track, speed_m_s, initial_m_s, start_delay_s)
    points, at_m, each_s, speeds_m_s = corners[:1], [0.0], [0.0], [min(initial_m_s, speed_m_s)]
    begin_s = 0.0
    for leg, (a, b) in zip(legs, pairwise(corners), strict=True):
        end_s, from_m = begin_s + leg.duration_s, at_m[-1]
        for on_m, on_s, at_m_s in leg.ramps() if begin_s <= ramps_s else ():
            is_later = each_s[-1] + LEAST_RAMP_S < begin_s + on_s < end_s - LEAST_RAMP_S
            if is_later and 0.0 <= on_m < leg.length_m - LEAST_RAMP_M:
                share = on_m / leg.length_m
                points.append((a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])))
                at_m.append(from_m + on_m)
                each_s.append(begin_s + on_s)
                speeds_m_s.append(at_m_s)
        points.append(b)
        at_m.append(from_m + leg.length_m)
        each_s.append(end_s)
        speeds_m_s.append(leg.end_m_s)
        begin_s = end_s
    return TimedTrack(points, at_m, each_s, speeds_m_s)


class _Leg(msgspec.Struct, frozen=True):
    """A leg between two corners: speeding up, full speed if it is long enough, and braking."""

    length_m: float
    up_m: float
    """distance of speeding up [m]"""
    down_m: float
    """distance of braking [m]"""
    begin_m_s: float
    top_m_s: float
    end_m_s: float
    settle_s: float
    """delay at the begin of the leg: SETTLE_S after a turn, or of a start from a stand [s]"""

    @property
    def duration_s(self) -> float:
        up_m_s, down_m_s = self.top_m_s - self.begin_m_s, self.top_m_s - self.end_m_s
        level_m = max(self.length_m - self.up_m - self.down_m, 0.0)
        level_s = level_m / self.top_m_s if self.top_m_s > 0.0 else 0.0
        return self.settle_s + up_m_s / ACCELERATION_M_S2 + level_s + down_m_s / BRAKING_M_S2

    def ramps(self) -> Iterator[tuple[float, float, float]]:
        """Yield points of the leg in order: distance [m] and time [s] from its start, and speed [m/s].

        The points are the end of a delay, and the middles and inner ends of speeding up and braking.
        """
        if self.begin_m_s < STARTED_M_S:
            yield 0.0, self.settle_s, self.begin_m_s
        up_m_s, down_m_s = self.top_m_s - self.begin_m_s, self.top_m_s - self.end_m_s
        for share in (0.5, 1.0):
            speed_m_s = self.begin_m_s + share * up_m_s
            on_m = (speed_m_s**2 - self.begin_m_s**2) / (2 * ACCELERATION_M_S2)
            yield on_m, self.settle_s + share * up_m_s / ACCELERATION_M_S2, speed_m_s
        for share in (1.0, 0.5):
            speed_m_s = self.end_m_s + share * down_m_s
            left_m = (speed_m_s**2 - self.end_m_s**2) / (2 * BRAKING_M_S2)
            yield self.length_m - left_m, self.duration_s - share * down_m_s / BRAKING_M_S2, speed_m_s

    def last_s(self, last_m: float) -> float:
        """Return the time for the last metres of a leg that ends in a stop [s]."""
        if last_m <= self.down_m:
            return math.sqrt(2 * last_m / BRAKING_M_S2)
        return self.top_m_s / BRAKING_M_S2 + (last_m - self.down_m) / self.top_m_s


def _corners_and_legs(
    track: Sequence[PlanarPoint], speed_m_s: float, initial_m_s: float, start_delay_s: float
) -> tuple[list[PlanarPoint], list[_Leg]]:
    """Return both ends and the corners of a track, and the legs between them."""
    corners = _corners(track)
    legs_m = [math.dist(a, b) for a, b in pairwise(corners)]
    if not legs_m:
        return corners, []
    tops_m_s = [min(_top_m_s(leg_m), speed_m_s) for leg_m in legs_m]
    passed_m_s = [min(initial_m_s, speed_m_s)]
    settles_s = [start_delay_s * max(1.0 - initial_m_s / STARTED_M_S, 0.0)]
    tops_m_s[0] = max(passed_m_s[0], tops_m_s[0])  # the vehicle may have begun this leg earlier
    for i, straight_m_s in enumerate(map(min, pairwise(tops_m_s))):
        turned_m_s = _corner_m_s(_turn_rad(*corners[i : i + 3]))
        passed_m_s.append(min(turned_m_s, straight_m_s))
        settles_s.append(SETTLE_S if turned_m_s < straight_m_s else 0.0)
    passed_m_s.append(0.0)
    _make_flyable(passed_m_s, legs_m)
    ends_m_s = pairwise(passed_m_s)
    return corners, [_leg(*leg) for leg in zip(legs_m, ends_m_s, tops_m_s, settles_s, strict=True)]


def _leg(length_m: float, ends_m_s: tuple[float, float], most_m_s: float, settle_s: float) -> _Leg:
    """Return the leg that is flown with at most `most_m_s`."""
    up, down = ACCELERATION_M_S2, BRAKING_M_S2
    begin_m_s, end_m_s = ends_m_s
    crossing_m_s = math.sqrt((2 * up * down * length_m + down * begin_m_s**2 + up * end_m_s**2) / (up + down))
    top_m_s = min(max(crossing_m_s, begin_m_s, end_m_s), most_m_s)
    up_m, down_m = (top_m_s**2 - begin_m_s**2) / (2 * up), (top_m_s**2 - end_m_s**2) / (2 * down)
    return _Leg(length_m, up_m, down_m, begin_m_s, top_m_s, end_m_s, settle_s)


def _top_m_s(leg_m: float) -> float:
    """Return the greatest speed on a leg [m/s].

    With the jerk J, a vehicle reaches (J · L² / 4)^(1/3) half-way between two stops (`SCurve`).
    """
    return LEG_SHARE * math.cbrt(0.25 * JERK_M_S3 * leg_m**2)


def _corners(track: Sequence[PlanarPoint]) -> list[PlanarPoint]:
    corners: list[PlanarPoint] = list(track[:1])
    for here, after in pairwise(track[1:]):
        turn_rad = 0.0 if here == corners[-1] else _turn_rad(corners[-1], here, after)
        is_drift = len(corners) == 1 and turn_rad <= BESIDE_RAD and _is_beside(corners[0], here, after)
        if turn_rad > STRAIGHT_RAD and not is_drift:
            corners.append(here)
    return corners + [end for end in track[1:][-1:] if end != corners[-1]]


def _is_beside(start: PlanarPoint, here: PlanarPoint, after: PlanarPoint) -> bool:
    """Return whether `start` is within BESIDE_M of the line through `here` and `after`."""
    leg_m = math.dist(here, after)
    east, north = after[0] - here[0], after[1] - here[1]
    return abs((start[0] - here[0]) * north - (start[1] - here[1]) * east) <= BESIDE_M * leg_m


def _turn_rad(before: PlanarPoint, here: PlanarPoint, after: PlanarPoint) -> float:
    angle_in = math.atan2(here[1] - before[1], here[0] - before[0])
    angle_out = math.atan2(after[1] - here[1], after[0] - here[0])
    return abs(math.remainder(angle_out - angle_in, math.tau))


def _corner_m_s(turn_rad: float) -> float:
    widening = 1.0 / max(math.cos(turn_rad / 2.0), 1e-6) - 1.0
    return CORNER_SHARE * math.sqrt(ACCELERATION_M_S2 * CORNER_RADIUS_M / max(widening, 1e-9))


def _make_flyable(passed_m_s: list[float], legs_m: Sequence[float]) -> None:
    """Reduce the speeds at corners, in place, to those that the lengths of the legs allow."""
    for i in range(len(legs_m) - 1, 0, -1):
        passed_m_s[i] = min(passed_m_s[i], math.sqrt(passed_m_s[i + 1] ** 2 + 2 * BRAKING_M_S2 * legs_m[i]))
    for i, leg_m in enumerate(legs_m):
        reached_m_s = math.sqrt(passed_m_s[i] ** 2 + 2 * ACCELERATION_M_S2 * leg_m)
        passed_m_s[i + 1] = min(passed_m_s[i + 1], reached_m_s)
