"""Straightening of lattice routes: never worse, the fewest legs, and turns that a fixed wing can fly."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from profiles import examples

from swarmctl.core.any_angle.corners import CostWeights, ExposureMeasure, Unflyable
from swarmctl.core.any_angle.pull import Track, is_still_good, may_join, pull_straight
from swarmctl.core.any_angle.track import WALL_MARGIN, ThreatMap, centre, crossed_cells, is_clear
from swarmctl.core.any_angle.turns import rounded, tangent_length
from swarmctl.core.exposure import exposure_sum, length_cells, safety_factor
from swarmctl.core.grid import Cell
from swarmctl.core.route import ends_and_turns
from swarmctl.planners import PLANNERS, Problem, Unreachable

QUICK = settings(max_examples=examples(80), deadline=None, derandomize=True)
BOTH = pytest.mark.parametrize("measure", list(ExposureMeasure))
DIJKSTRA = PLANNERS["dijkstra"]


@dataclass(frozen=True)
class Case:
    p_s: np.ndarray
    route: tuple[Cell, ...]
    w: float

    @property
    def threat(self) -> ThreatMap:
        return ThreatMap.of(self.p_s)


@st.composite
def cases(draw: st.DrawFn, largest: int = 16) -> Case:
    """Draw a planned route over a random field with walls, flat parts and cells known to be clear."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    rows, cols = draw(st.integers(2, largest)), draw(st.integers(2, largest))
    p_s = rng.choice([0.0, 0.13, 0.13, 0.3], (rows, cols)) + rng.random((rows, cols)) * draw(
        st.sampled_from([0.0, 0.2])
    )
    p_s[rng.random((rows, cols)) < draw(st.sampled_from([0.0, 0.15]))] = math.inf
    start, goal = ((int(rng.integers(rows)), int(rng.integers(cols))) for _ in range(2))
    w = draw(st.sampled_from([0.0, 0.3, 0.7, 1.0]))
    try:
        route = DIJKSTRA.plan(Problem(p_s, start, (goal,), w, 0.13), DIJKSTRA.Params())
    except Unreachable:
        assume(False)
    return Case(p_s, route.cells, w)


def measures(threat: ThreatMap, cells: list[Cell], measure: ExposureMeasure) -> np.ndarray:
    """Return length and exposures of the straight legs between cells, leg by leg."""
    points = [centre(cell) for cell in cells]
    under = crossed_cells(points)
    length = sum(math.dist(a, b) for a, b in itertools.pairwise(points))
    rows = [length, *threat.integral(under.cells, under.lengths)]
    if measure is ExposureMeasure.ENTERED:
        rows += [*threat.entered(under.cells[1:])]
    return np.array(rows)


def indices(route: tuple[Cell, ...], track: Track) -> list[int]:
    return [route.index(corner) for corner in track.corners]


@BOTH
@given(case=cases())
@QUICK
def test_a_track_is_never_worse_than_its_route(measure: ExposureMeasure, case: Case) -> None:
    track = pull_straight(case.threat, case.route, measure)
    pulled = measures(case.threat, list(track.corners), measure)
    assert (pulled <= measures(case.threat, list(case.route), measure) + 1e-7).all()
    assert track.length_cells == pytest.approx(pulled[0])
    if measure is ExposureMeasure.ENTERED:
        assert track.exposure_sum <= exposure_sum(case.p_s, case.route) + 1e-7
        assert track.safety_factor >= safety_factor(case.p_s, case.route) - 1e-7


@BOTH
@given(case=cases())
@QUICK
def test_a_track_keeps_its_ends_clear_of_walls_and_has_no_more_items(
    measure: ExposureMeasure, case: Case
) -> None:
    track = pull_straight(case.threat, case.route, measure)
    assert (track.corners[0], track.corners[-1]) == (case.route[0], case.route[-1])
    assert len(track.corners) <= len(ends_and_turns(case.route))
    assert indices(case.route, track) == sorted(indices(case.route, track))
    assert not any(math.isinf(case.p_s[cell]) for cell in track.over[1:])
    for a, b in itertools.pairwise(track.corners):
        k, m = case.route.index(a), case.route.index(b)
        if len(ends_and_turns(case.route[k : m + 1])) > 2:  # no straight piece of the lattice route
            assert is_clear(case.threat, (centre(a), centre(b)), WALL_MARGIN)


@BOTH
@given(case=cases(7))
@QUICK
def test_a_track_has_the_fewest_legs_and_the_least_length_among_those(
    measure: ExposureMeasure, case: Case
) -> None:
    route, threat = case.route, case.threat
    assume(len(route) <= 9)

    def good(i: int, j: int) -> bool:
        a, b = route[i], route[j]
        if math.dist(a, b) == pytest.approx(length_cells(route[i : j + 1])):
            return True
        leg, replaced = (measures(threat, list(c), measure) for c in ((a, b), route[i : j + 1]))
        return bool((leg <= replaced + 1e-9).all()) and is_clear(threat, (centre(a), centre(b)))

    inner = range(1, len(route) - 1)
    best = (math.inf, math.inf)
    for n in range(len(route)):
        for chosen in itertools.combinations(inner, n):
            corners = (0, *chosen, len(route) - 1) if len(route) > 1 else (0,)
            if all(good(i, j) for i, j in itertools.pairwise(corners)):
                length = sum(math.dist(route[i], route[j]) for i, j in itertools.pairwise(corners))
                best = min(best, (len(corners), length))
    track = pull_straight(threat, route, measure)
    assert len(track.corners) == best[0]
    assert track.length_cells == pytest.approx(best[1])


@BOTH
def test_a_knights_move_over_cells_known_to_be_clear(measure: ExposureMeasure) -> None:
    track = pull_straight(ThreatMap.of(np.zeros((2, 3))), [(0, 0), (0, 1), (1, 2)], measure)
    assert track == Track(((0, 0), (1, 2)), ((0, 0), (0, 1), (1, 1), (1, 2)), math.sqrt(5), 0.0, 1.0)


@pytest.mark.parametrize("route", [[(1, 1)], [(1, 1), (1, 2)], [(1, 1), (1, 2), (1, 1)]])
def test_routes_of_few_cells(route: list[Cell]) -> None:
    track = pull_straight(ThreatMap.of(np.full((3, 3), 0.1)), route, ExposureMeasure.ENTERED)
    assert track.corners == tuple(route)
    assert track.over == tuple(route)
    assert track.exposure_sum == pytest.approx(0.1 * (len(route) - 1))


def test_a_track_leaves_a_start_cell_in_a_wall() -> None:
    p_s = np.zeros((4, 4))
    p_s[0, 0] = math.inf
    track = pull_straight(ThreatMap.of(p_s), [(0, 0), (0, 1), (1, 2), (1, 3)], ExposureMeasure.ENTERED)
    assert track.corners == ((0, 0), (1, 3))
    assert track.exposure_sum == 0.0


def test_a_long_route_is_straightened() -> None:
    threat = ThreatMap.of(np.zeros((200, 400)))
    route = tuple((min(k // 2, 199), k) for k in range(400))
    assert pull_straight(threat, route, ExposureMeasure.ENTERED).corners == ((0, 0), (199, 399))
    straight = tuple((0, k) for k in range(400))
    assert pull_straight(ThreatMap.of(np.full((1, 400), 0.1)), straight, ExposureMeasure.ENTERED).corners == (
        (0, 0),
        (0, 399),
    )


# --- a vehicle in flight

FIELD = np.zeros((4, 9))
ROUTE = (*tuple((0, k) for k in range(6)), (1, 6), (2, 7), (3, 8))
TRACK = pull_straight(ThreatMap.of(FIELD), ROUTE, ExposureMeasure.ENTERED)
assert TRACK.corners == ((0, 0), (3, 8))


@pytest.mark.parametrize(
    ("news", "over", "holds"),
    [
        ({}, (0, 1), True),
        ({(1, 3): 0.3}, (0, 1), False),  # on the track ahead, not on the route
        ({(1, 3): 0.3}, (2, 5), True),  # behind
        ({(0, 4): 0.3}, (0, 1), True),  # on the route alone, so the track is better
        ({(3, 8): 0.6}, (0, 1), True),  # on both, so only the planner can help
        ({(1, 3): math.inf}, (0, 1), False),
        ({(1, 3): 0.3, (0, 4): 0.4}, (0, 1), True),  # the route is worse
        ({(0, 1): 0.9, (1, 3): 0.3}, (1, 1), False),  # the route was worse, but behind the vehicle
    ],
)
def test_new_exposure_ahead_ends_a_track(news: dict[Cell, float], over: Cell, holds: bool) -> None:
    p_s = FIELD.copy()
    for cell, value in news.items():
        p_s[cell] = value
    now, before = ThreatMap.of(p_s), ThreatMap.of(FIELD)
    verdict = is_still_good(
        now, before, ExposureMeasure.ENTERED, ROUTE, TRACK, radius_cells=0.0, here=centre(over), index=over[1]
    )
    assert verdict is holds


@BOTH
@given(case=cases())
@QUICK
def test_a_track_stays_good_along_its_length_without_new_exposure(
    measure: ExposureMeasure, case: Case
) -> None:
    track = pull_straight(case.threat, case.route, measure)
    for index, cell in enumerate(case.route):
        assert is_still_good(
            case.threat,
            case.threat,
            measure,
            case.route,
            track,
            radius_cells=0.0,
            here=centre(cell),
            index=index,
        )


@pytest.mark.parametrize(
    ("position", "wall", "dear", "joins"),
    [
        ((0.9, 0.5), None, None, True),
        ((0.95, 0.5), None, None, True),  # over (0, 1) instead of (1, 0): no worse
        ((0.95, 0.5), None, (0, 1), False),
        ((0.95, 0.5), (0, 1), None, False),
        ((0.5, 0.05), (0, 1), None, True),
    ],
)
def test_a_vehicle_joins_a_track_directly_or_over_the_centre_of_its_cell(
    position: tuple[float, float], wall: Cell | None, dear: Cell | None, joins: bool
) -> None:
    p_s = np.full((3, 4), 0.1)
    if wall is not None:
        p_s[wall] = math.inf
    if dear is not None:
        p_s[dear] = 0.5
    assert may_join(ThreatMap.of(p_s), position, (0, 0), (2, 1)) is joins


# --- room to turn


def turns(track: Track) -> list[tuple[tuple[float, float], ...]]:
    points = [centre(corner) for corner in track.corners]
    return list(zip(points, points[1:], points[2:], strict=False))


@BOTH
@given(case=cases(), radius=st.sampled_from([0.3, 0.8, 1.5, 4.0]))
@QUICK
def test_turns_are_as_wide_as_asked_and_clear_of_walls(
    measure: ExposureMeasure, case: Case, radius: float
) -> None:
    try:
        track = pull_straight(
            case.threat, case.route, measure, radius_cells=radius, weights=CostWeights(case.w, 0.13)
        )
    except Unflyable:
        return
    corners = [centre(corner) for corner in track.corners]
    for before, corner, after in turns(track):
        away = tangent_length(before, corner, after, radius)
        assert away <= math.dist(before, corner) * (1.0 if before == corners[0] else 0.5) + 1e-9
        assert away <= math.dist(corner, after) * (1.0 if after == corners[-1] else 0.5) + 1e-9
    flown, _ = rounded(corners, radius)
    assert not any(math.isinf(case.p_s[cell]) for cell in crossed_cells(flown).cells[1:])
    length = sum(math.dist(a, b) for a, b in itertools.pairwise(flown))
    assert track.length_cells == pytest.approx(length)
    # Menger's curvature: except at joints, three neighbouring points of a track lie on no tighter circle.
    for a, b, c in zip(flown, flown[1:], flown[2:], strict=False):
        assert (
            math.degrees(_turn(a, b, c))
            <= math.degrees(2.0 * math.acos(max(1.0 - 0.005 / radius, 0.0))) + 1e-6
        )


def _turn(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> float:
    (ix, iy), (ox, oy) = (b[0] - a[0], b[1] - a[1]), (c[0] - b[0], c[1] - b[1])
    return abs(math.atan2(ix * oy - iy * ox, ix * ox + iy * oy))


def test_an_unflyable_zigzag_becomes_straight_even_with_more_exposure() -> None:
    p_s = np.full((3, 9), 0.4)
    route = tuple((k % 2, k) for k in range(9))
    for cell in route:
        p_s[cell] = 0.1
    threat = ThreatMap.of(p_s)
    assert len(pull_straight(threat, route, ExposureMeasure.ENTERED, radius_cells=0.2).corners) == 9
    wide = pull_straight(
        threat, route, ExposureMeasure.ENTERED, radius_cells=3.0, weights=CostWeights(1.0, 0.1)
    )
    assert len(wide.corners) < 9
    assert wide.exposure_sum > exposure_sum(p_s, route)


def test_a_route_without_flyable_turns_is_refused() -> None:
    p_s = np.full((3, 3), math.inf)
    route = ((0, 0), (0, 1), (0, 2), (1, 2), (2, 2))
    for cell in route:
        p_s[cell] = 0.1
    threat = ThreatMap.of(p_s)
    assert pull_straight(threat, route, ExposureMeasure.ENTERED, radius_cells=1.0).corners == (
        (0, 0),
        (0, 2),
        (2, 2),
    )
    with pytest.raises(Unflyable, match=r"\(0, 0\).*\(2, 2\).*\b2\.5\b"):
        pull_straight(threat, route, ExposureMeasure.ENTERED, radius_cells=2.5)


def test_an_arc_over_an_exposed_cell_is_avoided() -> None:
    p_s = np.full((7, 7), 0.1)
    route = (*((0, k) for k in range(7)), *((k, 6) for k in range(1, 7)))
    p_s[:, :] = 0.9
    for cell in route:
        p_s[cell] = 0.1
    sharp = pull_straight(ThreatMap.of(p_s), route, ExposureMeasure.ENTERED, radius_cells=0.5)
    assert sharp.exposure_sum == pytest.approx(1.2)
    wide = pull_straight(
        ThreatMap.of(p_s), route, ExposureMeasure.ENTERED, radius_cells=5.0, weights=CostWeights(1.0, 0.1)
    )
    assert wide.exposure_sum > 1.2  # the only flyable track, and its measured exposure
