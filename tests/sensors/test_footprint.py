"""The paper's sensor, perfect and with errors."""

from __future__ import annotations

import numpy as np
import pytest

from swarmctl.core.grid import Grid
from swarmctl.core.inference.sensor import PERFECT, SensorModel
from swarmctl.core.vehicle import Landed, VehicleState
from swarmctl.sensors.footprint import Footprint

GRID = Grid(5, 5, 50.0, 46.0, 14.0)
HOSTILES = frozenset({(1, 1), (4, 4)})


def at(east_m: float, north_m: float, **changes: object) -> VehicleState:
    lat_deg, lon_deg = GRID.frame.to_geodetic(east_m, north_m)
    fields = {"alt_rel_m": 30.0, "armed": True, "landed": Landed.IN_AIR, **changes}
    return VehicleState(lat_deg=lat_deg, lon_deg=lon_deg, **fields)  # type: ignore[arg-type]


def sensor(model: SensorModel = PERFECT, seed: int = 0) -> Footprint:
    return Footprint(GRID, HOSTILES, model, np.random.default_rng(seed))


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
def test_the_sensor_sees_three_by_three_cells_of_the_area(
    east_m: float, north_m: float, cells: set[tuple[int, int]]
) -> None:
    seen = sensor().observe(at(east_m, north_m))
    assert {(row, col) for row, col, _ in seen} == cells
    assert all(occupied is ((row, col) in HOSTILES) for row, col, occupied in seen)


def test_the_sensor_looks_once_over_each_cell() -> None:
    eye = sensor()
    assert eye.observe(at(125.0, 125.0))
    assert eye.observe(at(130.0, 120.0)) == ()
    assert eye.observe(at(175.0, 125.0))
    assert eye.observe(at(125.0, 125.0))


@pytest.mark.parametrize(
    "changes",
    [{"armed": False}, {"landed": Landed.ON_GROUND}, {"alt_rel_m": 0.5}],
    ids=["disarmed", "on the ground", "hardly off the ground"],
)
def test_the_sensor_sees_nothing_on_the_ground(changes: dict[str, object]) -> None:
    assert sensor().observe(at(125.0, 125.0, **changes)) == ()


def test_the_sensor_sees_nothing_without_a_position() -> None:
    assert sensor().observe(VehicleState(armed=True)) == ()


def there_and_back(eye: Footprint, n_times: int) -> list[tuple[int, int, bool]]:
    """Return the observations from (1, 1) and (2, 1), alternately."""
    return [cell for i in range(n_times) for cell in eye.observe(at(75.0, 75.0 + 50.0 * (i % 2)))]


def test_misses_and_false_alarms_have_the_configured_rates() -> None:
    seen = there_and_back(sensor(SensorModel(0.2, 0.05)), 4000)
    of_hostile = [occupied for row, col, occupied in seen if (row, col) == (1, 1)]
    of_clear = [occupied for row, col, occupied in seen if (row, col) != (1, 1)]
    assert len(of_hostile) == 4000
    assert np.mean(of_hostile) == pytest.approx(0.8, abs=4 * (0.16 / 4000) ** 0.5)
    assert np.mean(of_clear) == pytest.approx(0.05, abs=4 * (0.0475 / 30_000) ** 0.5)


def test_equal_seeds_give_equal_errors_and_different_seeds_do_not() -> None:
    model = SensorModel(0.3, 0.2)
    one, same, other = (there_and_back(sensor(model, seed), 20) for seed in (1, 1, 2))
    assert one == same
    assert one != other
