"""The travel time of a copter on a track, with braking before turns and speeding up after them. Pure.

Acceleration and corner radius are the defaults of ArduCopter's parameters; the other constants are estimates.
The table has the time lost at a turn between long legs, in flight and as estimated here. Estimates are high,
so that a vehicle is early rather than late.

| speed | 45° | 90° | 135° |
|---|---|---|---|
| 5 m/s | 0.1 s | 1.3 s | 1.8 s |
| 10 m/s | 1.1 s | 3.3 s | 4.1 s |
| 10 m/s, estimated | 1.6 s | 3.5 s | 4.5 s |
| 20 m/s | 4.8 s | 8.0 s | 9.0 s |

Between short legs a turn may cost as much as a stop, so the estimate has a stop there.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise

from swarmctl.core.planar import PlanarPoint
from swarmctl.core.vehicle import BRAKING_M_S2

ACCELERATION_M_S2 = 2.5
"""WPNAV_ACCEL"""
CORNER_RADIUS_M = 2.0
"""WPNAV_RADIUS: greatest distance from a corner at which the vehicle may cut the corner"""
CORNER_SHARE = 0.75
"""Estimated speed at a corner, as a share of the speed by ACCELERATION_M_S2 and CORNER_RADIUS_M."""
SETTLE_S = 0.8
"""additional time at each turn until the vehicle follows the next leg [s]"""
SHORT_S = 4.5
"""Duration of a leg at full speed [s]; the estimate has a stop at both ends of a shorter leg."""
STRAIGHT_RAD = 0.1
"""Greatest turn that counts as straight [rad]."""
BESIDE_M, BESIDE_RAD = 3.0, 0.5
"""Greatest distance from the line of a leg [m], and greatest turn [rad], with which a vehicle beside the line
flies on to it as if it came along the line."""
LEAST_RAMP_S = 0.5
"""Least time between two points of a timed track between corners [s]."""
LEAST_RAMP_M = 0.1
"""Least distance of such a point from a corner [m]."""


def braking_loss_s(speed_m_s: float, brakes_m_s2: float = BRAKING_M_S2) -> float:
    """Return how much longer braking to a stop takes than the same distance at full speed [s]."""
    return speed_m_s / (2.0 * brakes_m_s2)


def lost_s(
    track: Sequence[PlanarPoint], speed_m_s: float, *, initial_m_s: float = 0.0, remaining_m: float = 0.0
) -> float:
    """Return the time lost by braking and turns on a track that ends in a stop [s]; at least 0.

    The loss is the time of `arrives_s`, minus the time for the whole track at constant `speed_m_s`.
    """
    at_speed_s = math.fsum(math.dist(a, b) for a, b in pairwise(_corners(track))) / speed_m_s
    return max(
        arrives_s(track, speed_m_s, initial_m_s=initial_m_s, remaining_m=remaining_m) - at_speed_s, 0.0
    )


def arrives_s(
    track: Sequence[PlanarPoint], speed_m_s: float, *, initial_m_s: float = 0.0, remaining_m: float = 0.0
) -> float:
    """Return the time until a vehicle is `remaining_m` before the end of a track that ends in a stop [s].

    `initial_m_s` is the speed at the start. The result is not before the start of the last leg.
    """
    corners, times_s, passed_m_s = _corner_times_and_speeds(track, speed_m_s, initial_m_s)
    if len(corners) < 2:
        return 0.0
    last_m = math.dist(corners[-2], corners[-1])
    return times_s[-1] - _leg_end_s(passed_m_s[-2], last_m, min(remaining_m, last_m), speed_m_s)


@dataclass(frozen=True, slots=True)
class TimedTrack:
    """A flight along a track that ends in a stop: the points at which the acceleration changes."""

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
        if distance_m >= self.at_m[-1]:
            return self.points[-1], self.times_s[-1]
        i = max(bisect_right(self.at_m, distance_m), 1) - 1
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
    track: Sequence[PlanarPoint], speed_m_s: float, *, initial_m_s: float = 0.0, ramps_s: float = math.inf
) -> TimedTrack:
    """Return the flight from the speed `initial_m_s` along a track, of at least one point, to a stop.

    Legs that begin after `ramps_s` have no points between their corners.
    """
    corners, times_s, passed_m_s = _corner_times_and_speeds(track, speed_m_s, initial_m_s)
    points, at_m, each_s, speeds_m_s = corners[:1], [0.0], [0.0], passed_m_s[:1]
    for i, (a, b) in enumerate(pairwise(corners)):
        begin_m_s, end_m_s, leg_m = passed_m_s[i], passed_m_s[i + 1], math.dist(a, b)
        (top_m_s, up_m, down_m), from_m = _ramps(begin_m_s, end_m_s, leg_m, speed_m_s), at_m[-1]
        up_s = times_s[i] + (SETTLE_S if i else 0.0) + (top_m_s - begin_m_s) / ACCELERATION_M_S2
        down_s = times_s[i + 1] - (top_m_s - end_m_s) / BRAKING_M_S2
        for on_m, on_s in ((up_m, up_s), (leg_m - down_m, down_s)):
            is_later = each_s[-1] + LEAST_RAMP_S < on_s < times_s[i + 1] - LEAST_RAMP_S
            is_farther = LEAST_RAMP_M < on_m < leg_m - LEAST_RAMP_M
            if is_later and is_farther and times_s[i] <= ramps_s:
                share = on_m / leg_m
                points.append((a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])))
                at_m.append(from_m + on_m)
                each_s.append(on_s)
                speeds_m_s.append(top_m_s)
        points.append(b)
        at_m.append(from_m + leg_m)
        each_s.append(times_s[i + 1])
        speeds_m_s.append(end_m_s)
    return TimedTrack(points, at_m, each_s, speeds_m_s)


def _corner_times_and_speeds(
    track: Sequence[PlanarPoint], speed_m_s: float, initial_m_s: float
) -> tuple[list[PlanarPoint], list[float], list[float]]:
    """Return both ends and the corners, the time at each [s], and the speed at each [m/s]."""
    corners = _corners(track)
    legs_m = [math.dist(a, b) for a, b in pairwise(corners)]
    if not legs_m:
        return corners, [0.0] * len(corners), [0.0] * len(corners)
    short = [leg_m < SHORT_S * speed_m_s for leg_m in legs_m]
    short[0] = short[0] and initial_m_s == 0.0 and len(legs_m) > 1
    passed_m_s = [min(initial_m_s, speed_m_s)]
    for i in range(1, len(legs_m)):
        turn_rad = _turn_rad(*corners[i - 1 : i + 2])
        passed_m_s.append(0.0 if short[i - 1] or short[i] else _corner_m_s(turn_rad, speed_m_s))
    passed_m_s.append(0.0)
    _make_flyable(passed_m_s, legs_m)
    legs = zip(pairwise(passed_m_s), legs_m, strict=True)
    each_s = [_leg_s(*ends, leg_m, speed_m_s) for ends, leg_m in legs]
    each_s[1:] = [leg_s + SETTLE_S for leg_s in each_s[1:]]
    return corners, list(accumulate(each_s, initial=0.0)), passed_m_s


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


def _corner_m_s(turn_rad: float, speed_m_s: float) -> float:
    widening = 1.0 / max(math.cos(turn_rad / 2.0), 1e-6) - 1.0
    rounded_m_s = math.sqrt(ACCELERATION_M_S2 * CORNER_RADIUS_M / max(widening, 1e-9))
    return min(CORNER_SHARE * rounded_m_s, speed_m_s)


def _make_flyable(passed_m_s: list[float], legs_m: Sequence[float]) -> None:
    """Reduce the speeds at corners, in place, to those that the lengths of the legs allow."""
    for i in range(len(legs_m) - 1, 0, -1):
        passed_m_s[i] = min(passed_m_s[i], math.sqrt(passed_m_s[i + 1] ** 2 + 2 * BRAKING_M_S2 * legs_m[i]))
    for i, leg_m in enumerate(legs_m):
        reached_m_s = math.sqrt(passed_m_s[i] ** 2 + 2 * ACCELERATION_M_S2 * leg_m)
        passed_m_s[i + 1] = min(passed_m_s[i + 1], reached_m_s)


def _leg_s(begin_m_s: float, end_m_s: float, leg_m: float, speed_m_s: float) -> float:
    """Return the time for a leg: speeding up, full speed if the leg is long enough, and braking [s]."""
    top_m_s, up_m, down_m = _ramps(begin_m_s, end_m_s, leg_m, speed_m_s)
    ramps_s = (top_m_s - begin_m_s) / ACCELERATION_M_S2 + (top_m_s - end_m_s) / BRAKING_M_S2
    return ramps_s + (max(leg_m - up_m - down_m, 0.0) / top_m_s if top_m_s > 0.0 else 0.0)


def _ramps(begin_m_s: float, end_m_s: float, leg_m: float, speed_m_s: float) -> tuple[float, float, float]:
    """Return the greatest speed on a leg [m/s], and the distances of speeding up and of braking [m]."""
    top_m_s = _top_m_s(begin_m_s, end_m_s, leg_m, speed_m_s)
    up_m = (top_m_s**2 - begin_m_s**2) / (2 * ACCELERATION_M_S2)
    return top_m_s, up_m, (top_m_s**2 - end_m_s**2) / (2 * BRAKING_M_S2)


def _top_m_s(begin_m_s: float, end_m_s: float, leg_m: float, speed_m_s: float) -> float:
    up, down = ACCELERATION_M_S2, BRAKING_M_S2
    crossing_m_s = math.sqrt((2 * up * down * leg_m + down * begin_m_s**2 + up * end_m_s**2) / (up + down))
    return min(max(crossing_m_s, begin_m_s, end_m_s), speed_m_s)


def _leg_end_s(begin_m_s: float, leg_m: float, last_m: float, speed_m_s: float) -> float:
    """Return the least time for the last metres of a leg that ends in a stop [s]."""
    if last_m <= 0.0:
        return 0.0
    top_m_s = _top_m_s(begin_m_s, 0.0, leg_m, speed_m_s)
    braking_m = top_m_s**2 / (2 * BRAKING_M_S2)
    if last_m <= braking_m:
        return math.sqrt(2 * last_m / BRAKING_M_S2)
    return top_m_s / BRAKING_M_S2 + (last_m - braking_m) / top_m_s
