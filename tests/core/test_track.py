"""The cells under a straight track, compared with exact arithmetic and with dense sampling."""

from __future__ import annotations

import itertools
import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

from swarmctl.core.any_angle.legs import measure_legs
from swarmctl.core.any_angle.track import WALL_MARGIN, GridPoint, ThreatMap, centre, crossed_cells, is_clear
from swarmctl.core.grid import Cell

QUICK = settings(max_examples=examples(150), deadline=None, derandomize=True)
INDEX = st.integers(0, 12)
CELL = st.tuples(INDEX, INDEX)
COORDINATE = st.floats(0.0, 12.999)


def exact_crossings(a: Cell, b: Cell) -> list[tuple[Cell, Fraction]]:
    """Return cells and their shares of a leg between two centres, in rational arithmetic."""
    half = Fraction(1, 2)
    (y0, x0), (y1, x1) = ((a[0] + half, a[1] + half), (b[0] + half, b[1] + half))
    shares = {Fraction(0), Fraction(1)}
    for here, there in ((y0, y1), (x0, x1)):
        shares |= {
            (line - here) / (there - here) for line in range(14) if min(here, there) < line < max(here, there)
        }
    pieces = []
    for s, t in itertools.pairwise(sorted(shares)):
        middle = (s + t) / 2
        pieces.append(((math.floor(y0 + middle * (y1 - y0)), math.floor(x0 + middle * (x1 - x0))), t - s))
    return pieces


@QUICK
@given(CELL, CELL)
def test_the_cells_and_crossings_between_centres_are_exact(a: Cell, b: Cell) -> None:
    under = crossed_cells((centre(a), centre(b)))
    if a == b:
        assert under.cells == (a,)
        return
    exact = exact_crossings(a, b)
    assert under.cells == tuple(cell for cell, _ in exact)
    length = math.dist(a, b)
    assert under.lengths == pytest.approx([float(share) * length for _, share in exact], abs=1e-12)


@pytest.mark.parametrize("far", [9_999, 10_000])
def test_crossings_are_distinct_on_the_longest_legs(far: int) -> None:
    under = crossed_cells((centre((0, 0)), centre((far, far - 1))))
    crossings = {Fraction(2 * k + 1, 2 * n) for n in (far, far - 1) for k in range(n)}
    assert len(under.cells) == 1 + len(crossings)


@QUICK
@given(st.lists(st.tuples(COORDINATE, COORDINATE), min_size=1, max_size=4))
def test_a_track_passes_over_the_cells_of_its_points_in_order(points: list[GridPoint]) -> None:
    under = crossed_cells(points)
    assert all(a != b for a, b in itertools.pairwise(under.cells))
    assert sum(under.lengths) == pytest.approx(
        sum(itertools.starmap(math.dist, itertools.pairwise(points))), abs=1e-6
    )
    for here, there in itertools.pairwise(under.cells):
        assert max(abs(here[0] - there[0]), abs(here[1] - there[1])) == 1
    for a, b in itertools.pairwise(points):
        for share in np.linspace(0.0, 1.0, 30):
            x, y = a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])
            assert any(
                abs(x - c - 0.5) <= 0.5 + 1e-6 and abs(y - r - 0.5) <= 0.5 + 1e-6 for r, c in under.cells
            )


@st.composite
def fields(draw: st.DrawFn) -> np.ndarray:
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    p_s = rng.random((draw(st.integers(1, 9)), draw(st.integers(1, 9))))
    p_s[rng.random(p_s.shape) < draw(st.sampled_from([0.0, 0.1, 0.3]))] = math.inf
    return p_s


@QUICK
@given(fields())
def test_measures_of_many_legs_equal_those_of_single_legs(p_s: np.ndarray) -> None:
    threat = ThreatMap.of(p_s)
    cells = [(r, c) for r in range(p_s.shape[0]) for c in range(p_s.shape[1])]
    rng = np.random.default_rng(len(cells))
    pairs = [(cells[i], cells[j]) for i, j in rng.integers(0, len(cells), (30, 2)) if i != j]
    begins, ends = (np.array([pair[k] for pair in pairs], dtype=np.int64).reshape(-1, 2) for k in (0, 1))
    legs = measure_legs(threat, begins, ends)
    for k, (a, b) in enumerate(pairs):
        points = (centre(a), centre(b))
        under = crossed_cells(points)
        alone = [
            math.dist(a, b),
            *threat.integral(under.cells, under.lengths),
            *threat.entered(under.cells[1:]),
        ]
        assert legs.measures[:, k] == pytest.approx(alone, abs=1e-12)
        assert legs.clear[k] == is_clear(threat, points)


@QUICK
@given(fields(), st.integers(0, 2**32))
def test_a_clear_leg_keeps_away_from_every_wall(p_s: np.ndarray, seed: int) -> None:
    threat = ThreatMap.of(p_s)
    rows, cols = p_s.shape
    a, b = np.random.default_rng(seed).random((2, 2)) * (cols, rows)
    begin = (math.floor(a[1]), math.floor(a[0]))
    walls = [(r, c) for r, c in np.argwhere(threat.blocked).tolist() if (r, c) != begin]
    share = np.linspace(0.0, 1.0, 2001)[:, None]
    x, y = (a + share * (b - a)).T
    corners = [(r + i, c + j) for r, c in walls for i in (0, 1) for j in (0, 1)]
    inside = any(((y > r) & (y < r + 1) & (x > c) & (x < c + 1)).any() for r, c in walls)
    nearest = min((float(np.hypot(y - r, x - c).min()) for r, c in corners), default=math.inf)
    clear = is_clear(threat, (tuple(a.tolist()), tuple(b.tolist())))
    if inside or nearest < WALL_MARGIN - 0.01:
        assert not clear
    elif nearest > WALL_MARGIN + 0.01:
        assert clear


def test_the_integral_equals_the_sum_over_many_samples() -> None:
    p_s = np.random.default_rng(5).random((7, 7))
    a, b = (0.3, 6.2), (6.7, 0.9)
    under = crossed_cells((a, b))
    share = (np.arange(200_000) + 0.5) / 200_000
    x, y = a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])
    sampled = p_s[np.floor(y).astype(int), np.floor(x).astype(int)].mean() * math.dist(a, b)
    assert ThreatMap.of(p_s).integral(under.cells, under.lengths)[0] == pytest.approx(sampled, rel=1e-4)


def test_a_cell_above_the_maximum_exposure_is_a_wall() -> None:
    p_s = np.full((1, 3), 0.1)
    p_s[0, 1] = 0.3
    assert is_clear(ThreatMap.of(p_s), (centre((0, 0)), centre((0, 2))))
    assert not is_clear(ThreatMap.of(p_s, max_exposure=0.2), (centre((0, 0)), centre((0, 2))))
