"""When each of many vehicles that are called back begins its return, so that no two meet. Pure.

A vehicle holds where it is, at its own height, until its turn; then it climbs, flies straight home and comes
down there. How high it climbs is a parameter of its firmware, and how fast it flies is not known exactly: it
is taken to be anywhere that a fast and a slow return allow, and vehicles that move are kept apart over ground
at whatever height they are.

Points are (east, north) [m] in one plane, heights above the sea [m], times from the moment of the call [s].
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from swarmctl.core.geo import LocalFrame
from swarmctl.core.messages import Place

Point = tuple[float, float]
Floats = NDArray[np.float64]

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
SINK_M_S = 0.8
"""from that height to the ground on the average, a wait above home included"""


@dataclass(frozen=True, slots=True)
class Caller:
    """A vehicle that is to return."""

    uav: int
    here: Point
    alt_amsl_m: float
    home: Point
    home_alt_amsl_m: float
    speed_m_s: float
    """expected over ground"""
    is_returning: bool = False
    """it is on its way already, and has no turn to wait for"""

    @property
    def way_m(self) -> float:
        return float(np.hypot(self.home[0] - self.here[0], self.home[1] - self.here[1]))

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
class Turns:
    """Who begins when."""

    begins_s: Mapping[int, float]
    """by system id, in the order of the turns"""
    down_s: float
    """when the slowest is down"""
    not_apart: tuple[tuple[int, int], ...] = ()
    """pairs of which the first passes the second's place while that holds: no order avoids it, and only their
    heights keep them apart"""


def turns(callers: Sequence[Caller], *, horizontal_m: float, vertical_m: float) -> Turns:
    """The turn of each, so that no two come nearer than `horizontal_m` over ground, unless one of them holds
    and the other is `vertical_m` above or below it."""

    @cache
    def passes(mover: Caller, holder: Caller) -> bool:
        return _passes(mover, holder, horizontal_m, vertical_m)

    @cache
    def meetings(one: Caller, other: Caller) -> frozenset[int]:
        return _meetings(one, other, horizontal_m)

    begins = {caller: 0 for caller in callers if caller.is_returning}
    waiting = sorted((c for c in callers if not c.is_returning), key=lambda c: (c.way_m, c.uav))
    not_apart = [(m.uav, h.uav) for m in begins for h in waiting if passes(m, h)]
    while waiting:
        in_the_way = {c: [h for h in waiting if h is not c and passes(c, h)] for c in waiting}
        nearest = min(waiting, key=lambda c: len(in_the_way[c]))
        not_apart += [(nearest.uav, holder.uav) for holder in in_the_way[nearest]]
        waiting.remove(nearest)
        begins[nearest] = _first_turn(nearest, begins, passes, meetings)
    order = sorted(begins, key=lambda c: (begins[c], c.uav))
    return Turns(
        {c.uav: STEP_S * begins[c] for c in order},
        max((STEP_S * begins[c] + c.takes_s for c in order), default=0.0),
        tuple(not_apart),
    )


def turns_of(places: Mapping[int, Place]) -> Turns:
    """The turns of vehicles, by system id, each of which tells where it is and what it keeps from others."""
    if not places:
        return Turns({}, 0.0)
    first = next(iter(places.values()))
    frame = LocalFrame(first.lat_deg, first.lon_deg)
    callers = [
        Caller(
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
    return turns(callers, horizontal_m=max(k[0] for k in keeps), vertical_m=max(k[1] for k in keeps))


def told(turns: Turns, names: Mapping[int, str]) -> str:
    """Who returns when, as a line."""
    groups: dict[float, list[str]] = {}
    for uav, begins_s in turns.begins_s.items():
        groups.setdefault(begins_s, []).append(names[uav])
    when = [
        f"{', '.join(group)} {f'after {begins_s:g} s' if begins_s else 'at once'}"
        for begins_s, group in groups.items()
    ]
    pairs = ", ".join(f"{names[one]} past {names[other]}" for one, other in turns.not_apart)
    only = f"; only their heights keep apart {pairs}" if pairs else ""
    return f"{'; '.join(when)}; the last is down within {turns.down_s:.0f} s{only}"


def _first_turn(
    caller: Caller,
    begins: Mapping[Caller, int],
    passes: Callable[[Caller, Caller], bool],
    meetings: Callable[[Caller, Caller], frozenset[int]],
) -> int:
    """In steps; whom it passes must have left."""
    step = max((begun for other, begun in begins.items() if passes(caller, other)), default=0)
    while any(step - begun in meetings(other, caller) for other, begun in begins.items()):
        step += 1
    return step


def _passes(mover: Caller, holder: Caller, horizontal_m: float, vertical_m: float) -> bool:
    """Whether one that returns comes too near to the place at which another holds."""
    if holder.alt_amsl_m >= mover.top_amsl_m + vertical_m:
        return False
    over_home = _apart(_points(mover.home), _points(mover.home), _points(holder.here), _points(holder.here))
    if over_home[0] < horizontal_m:
        return True
    if holder.alt_amsl_m <= mover.alt_amsl_m - vertical_m:
        return False
    on_the_way = _apart(_points(mover.here), _points(mover.home), _points(holder.here), _points(holder.here))
    return bool(on_the_way[0] < horizontal_m)


def _meetings(one: Caller, other: Caller, horizontal_m: float) -> frozenset[int]:
    """By how many steps the other may not begin after the one, both being under way."""
    ways = (one.here, one.home, other.here, other.home)
    if _apart(*map(_points, ways))[0] >= horizontal_m:
        return frozenset()
    begin_one, end_one = _reach(one)
    begin_other, end_other = _reach(other)
    n, m = len(begin_one), len(begin_other)
    i, j = np.repeat(np.arange(n), m), np.tile(np.arange(m), n)
    near = _apart(begin_one[i], end_one[i], begin_other[j], end_other[j]) < horizontal_m
    return frozenset(int(lag) for lag in np.unique(i[near] - j[near]))


def _reach(caller: Caller) -> tuple[Floats, Floats]:
    """Both ends (steps, 2) of the piece of its way on which it may be during each step of its return."""
    begin_s = np.arange(0.0, caller.takes_s, STEP_S)
    slow_m = SLOWER * caller.speed_m_s * (begin_s - caller.departs_within_s)
    fast_m = FASTER * caller.speed_m_s * (begin_s + STEP_S)
    here, home = np.array(caller.here), np.array(caller.home)
    shares = (np.clip(along_m / max(caller.way_m, 1e-9), 0.0, 1.0) for along_m in (slow_m, fast_m))
    first, last = (here + share[:, None] * (home - here) for share in shares)
    return first, last


def _points(point: Point) -> Floats:
    return np.array([point])


def _apart(a: Floats, b: Floats, c: Floats, d: Floats) -> Floats:
    """Least distances between the pieces a to b and c to d, row by row [m]; all (n, 2)."""
    ends = (_to_piece(a, c, d), _to_piece(b, c, d), _to_piece(c, a, b), _to_piece(d, a, b))
    least: Floats = np.minimum.reduce(ends)
    crossing = (_side(a, b, c) * _side(a, b, d) < 0.0) & (_side(c, d, a) * _side(c, d, b) < 0.0)
    return np.where(crossing, 0.0, least)


def _side(a: Floats, b: Floats, point: Floats) -> Floats:
    u, v = b - a, point - a
    side: Floats = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    return side


def _to_piece(point: Floats, a: Floats, b: Floats) -> Floats:
    along = b - a
    length2 = np.maximum((along * along).sum(axis=1), 1e-12)
    share = np.clip(((point - a) * along).sum(axis=1) / length2, 0.0, 1.0)
    gap = point - a - share[:, None] * along
    lengths: Floats = np.hypot(gap[:, 0], gap[:, 1])
    return lengths
