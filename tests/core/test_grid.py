import math

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from profiles import examples

from swarmctl.core.geo import LatLon, distance_m
from swarmctl.core.grid import Cell, Grid

GRID = Grid(rows=6, cols=9, cell_size_m=50.0, origin_lat_deg=47.4, origin_lon_deg=8.5)
QUICK = settings(max_examples=examples(60), deadline=None, derandomize=True)


def at(east_m: float, north_m: float) -> LatLon:
    return GRID.frame.to_geodetic(east_m, north_m)


@pytest.mark.parametrize("cell", [(0, 0), (2, 7), (5, 8)])
def test_the_centre_of_a_cell_lies_in_it(cell: Cell) -> None:
    assert GRID.cell_at(*GRID.centre(cell)) == cell


def test_rows_grow_north_and_columns_east_from_the_south_west_corner() -> None:
    assert GRID.cell_at(*at(1.0, 1.0)) == (0, 0)
    assert GRID.cell_at(*at(449.0, 1.0)) == (0, 8)
    assert GRID.cell_at(*at(1.0, 299.0)) == (5, 0)
    assert GRID.cell_at(*at(149.0, 51.0)) == (1, 2)


@pytest.mark.parametrize("point", [(-1.0, 120.0), (451.0, 120.0), (120.0, -1.0), (120.0, 301.0)])
def test_a_point_beside_the_area_is_in_no_cell(point: tuple[float, float]) -> None:
    assert GRID.cell_at(*at(*point)) is None


@QUICK
@given(east_m=st.floats(-2000, 2000), north_m=st.floats(-2000, 2000))
@example(east_m=225.0, north_m=110.0)
@example(east_m=225.0, north_m=190.0)
@example(east_m=105.0, north_m=149.0)
@example(east_m=345.0, north_m=149.0)
def test_the_nearest_border_cell_has_the_least_distance(east_m: float, north_m: float) -> None:
    def gap(cell: Cell) -> float:
        south, west = cell[0] * 50.0, cell[1] * 50.0
        return math.hypot(
            max(west - east_m, east_m - west - 50.0, 0.0), max(south - north_m, north_m - south - 50.0, 0.0)
        )

    rim = [(r, c) for r in range(6) for c in range(9) if r in (0, 5) or c in (0, 8)]
    assert gap(GRID.nearest_border_cell(*at(east_m, north_m))) == pytest.approx(min(map(gap, rim)), abs=1e-3)


def test_corners_go_round_from_the_south_west() -> None:
    south_west, south_east, north_east, north_west = GRID.corners()
    assert south_west == pytest.approx((47.4, 8.5))
    assert distance_m(south_west, south_east) == pytest.approx(450.0, abs=1e-3)
    assert distance_m(south_east, north_east) == pytest.approx(300.0, abs=1e-3)
    assert distance_m(north_east, north_west) == pytest.approx(450.0, abs=1e-3)


def test_a_nan_position_is_in_no_cell() -> None:
    assert GRID.cell_at(math.nan, 8.5) is None
    with pytest.raises(ValueError, match=r"\(nan, 8\.5\)"):
        GRID.nearest_border_cell(math.nan, 8.5)


@pytest.mark.parametrize(
    ("rows", "cols", "size", "value"),
    [
        (0, 5, 50.0, "0 × 5"),
        (5, -1, 50.0, "5 × -1"),
        (5, 5, 0.0, "0.0 m"),
        (5, 5, math.nan, "nan m"),
    ],
)
def test_an_impossible_area_is_refused(rows: int, cols: int, size: float, value: str) -> None:
    with pytest.raises(ValueError, match=value):
        Grid(rows, cols, size, 47.0, 8.0)


def test_the_centre_of_a_cell_outside_the_area_is_refused() -> None:
    with pytest.raises(ValueError, match=r"\(6, 0\).*\b0\.\.5\b"):
        GRID.centre((6, 0))
