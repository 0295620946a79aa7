"""The paper's sensor."""

from __future__ import annotations

import pytest

from swarmctl.core.grid import Grid
from swarmctl.core.vehicle import Landed, VehicleState
from swarmctl.sensors.footprint import Footprint

GRID = Grid(5, 5, 50.0, 46.0, 14.0)
HOSTILES = frozenset({(1, 1), (4, 4)})


def at(east_m: float, north_m: float, **changes: object) -> VehicleState:
    lat_deg, lon_deg = GRID.frame.to_geodetic(east_m, north_m)
    fields = {"alt_rel_m": 30.0, "armed": True, "landed": Landed.IN_AIR, **changes}
    return VehicleState(lat_deg=lat_deg, lon_deg=lon_deg, **fields)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("east_m", "north_m", "cells"),
    [
        (125.0, 125.0, {(r, c) for r in (1, 2, 3) for c in (1, 2, 3)}),
        (10.0, 10.0, {(0, 0), (0, 1), (1, 0), (1, 1)}),
        (-20.0, 125.0, {(1, 0), (2, 0), (3, 0)}),
        (-60.0, 125.0, set()),
        (260.0, 260.0, {(4, 4)}),
    ],
    ids=["inside", "in a corner", "just outside", "farther out", "beyond the corner"],
)
def test_it_sees_three_by_three_cells_of_the_area(
    east_m: float, north_m: float, cells: set[tuple[int, int]]
) -> None:
    seen = Footprint(GRID, HOSTILES).look(at(east_m, north_m))
    assert {(row, col) for row, col, _ in seen} == cells
    assert all(occupied is ((row, col) in HOSTILES) for row, col, occupied in seen)


def test_it_looks_once_over_each_cell() -> None:
    sensor = Footprint(GRID, HOSTILES)
    assert sensor.look(at(125.0, 125.0))
    assert sensor.look(at(130.0, 120.0)) == ()
    assert sensor.look(at(175.0, 125.0))
    assert sensor.look(at(125.0, 125.0))


@pytest.mark.parametrize(
    "changes",
    [{"armed": False}, {"landed": Landed.ON_GROUND}, {"alt_rel_m": 0.5}],
    ids=["disarmed", "on the ground", "hardly off the ground"],
)
def test_on_the_ground_it_sees_nothing(changes: dict[str, object]) -> None:
    assert Footprint(GRID, HOSTILES).look(at(125.0, 125.0, **changes)) == ()


def test_without_a_position_it_sees_nothing() -> None:
    assert Footprint(GRID, HOSTILES).look(VehicleState(armed=True)) == ()
