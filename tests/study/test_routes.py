"""Rows of kind `routes`: drawn beliefs, methods and what happens on their routes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from swarmctl.config import model, scenario
from swarmctl.config.scenario import Scenario
from swarmctl.study.kinds import KINDS
from swarmctl.study.routes import Search, drawn_belief, unsupported
from swarmctl.study.world import World

YAML = """\
area: {origin_lat_deg: 46.0, origin_lon_deg: 14.0, rows: 12, cols: 12, cell_size_m: 50}
threats: {count: 9}
sensor: {p_miss: MISS, p_false_alarm: 0.0}
simulate: {count: 2}
planner: {w: 1}
"""


def built(tmp_path: Path, miss: str = "0.0") -> Scenario:
    file = tmp_path / "base.yaml"
    file.write_text(YAML.replace("MISS", miss))
    return scenario.build(model.load(file))


def rows(base: Scenario, seeds: range, settings: Search) -> Mapping[str, NDArray[Any]]:
    return KINDS["routes"].table(base, seeds, settings=settings).rows


def table(base: Scenario, **settings: Any) -> Mapping[str, NDArray[Any]]:
    return rows(base, range(8), Search(**{"observed": 0.3, **settings}))


def test_a_row_for_each_seed_and_vehicle_whatever_the_batches(tmp_path: Path) -> None:
    base = built(tmp_path)
    settings = Search(method="simulated_annealing", longer=0.2, observed=0.3)
    whole = rows(base, range(8), settings)
    assert list(zip(whole["seed"], whole["uav"], strict=True)) == [(s, u) for s in range(8) for u in (1, 2)]
    parts = [rows(base, seeds, settings) for seeds in (range(3), range(3, 8))]
    for name in whole:
        assert whole[name].tolist() == [*parts[0][name], *parts[1][name]], name


def test_more_observations_continue_fewer_and_tell_the_truth(tmp_path: Path) -> None:
    base = built(tmp_path)
    world = World.drawn(base, 4)
    few, many = (drawn_belief(base, world, share) for share in (0.1, 0.5))
    assert not drawn_belief(base, world, 0.0).looks.any()
    assert 0.1 <= few.n_observed / 144 < 0.1 + 9 / 144
    assert 0.5 <= many.n_observed / 144 < 0.5 + 9 / 144
    assert (few.looks <= many.looks).all()
    everything = drawn_belief(base, world, 1.0)
    assert {(int(r), int(c)) for r, c in np.argwhere(everything.known == 1)} == world.hostiles
    blind = drawn_belief(built(tmp_path, "0.9"), world, 1.0)
    assert 0 < blind.hits.sum() < 0.3 * everything.hits.sum()


def test_the_exact_planners_are_exact_and_the_others_not_better(tmp_path: Path) -> None:
    base = built(tmp_path)
    exact, best_w = (table(base, method=name, longer=0.1) for name in ("constrained", "time_bound"))
    assert exact["is_exact"].all()
    assert (exact["exposure_above_exact"] == 0.0).all()
    assert best_w["is_best_w"].all()
    assert (best_w["exposure_above_exact"] >= 0.0).all()
    grid = table(base, method="fixed_grid", longer=0.1, searches=4)
    assert grid["within_bound"].all()
    assert (grid["searches"] == 4).all()
    assert (grid["exposure_above_breakpoints"] >= -1e-12).all()
    np.testing.assert_allclose(
        grid["exposure_above_exact"] - grid["exposure_above_breakpoints"],
        best_w["exposure_above_exact"],
        atol=1e-12,
    )


def test_the_safest_route_is_found_by_survival_and_the_least_exposed_by_dijkstra(tmp_path: Path) -> None:
    base = built(tmp_path)
    least, safest = (table(base, method=name) for name in ("dijkstra", "survival"))
    assert safest["is_safest"].all()
    assert least["is_exact"].all()
    assert (least["safety_below_safest"] >= -1e-12).all()
    assert (least["believed_exposure_sum"] <= safest["believed_exposure_sum"] + 1e-12).all()
    assert least["within_bound"].all()
    assert ((least["strikes"] == 0) == least["survived"]).all()


def test_an_earliest_arrival_is_refused_before_the_first_search(tmp_path: Path) -> None:
    base = built(tmp_path)
    assert unsupported(base) is None
    simulate = base.config.simulate
    assert simulate is not None
    late = simulate.model_copy(update={"arrive_after_s": 900.0})
    assert unsupported(scenario.build(base.config.model_copy(update={"simulate": late}))) is not None


def test_everything_known_leaves_one_world(tmp_path: Path) -> None:
    base = built(tmp_path)
    known = table(base, method="dijkstra", observed=1.0)
    np.testing.assert_allclose(known["believed_survival"], known["true_survival"], rtol=1e-9)
    np.testing.assert_allclose(known["believed_exposure_sum"], known["exposure_sum"], atol=1e-12)
    np.testing.assert_allclose(known["believed_safety_factor"], known["safety_factor"], atol=1e-12)


def test_strikes_happen_as_often_as_the_true_hostiles_hit(tmp_path: Path) -> None:
    routes = rows(built(tmp_path), range(150), Search(method="dijkstra", simulated_worlds=2))
    expected = routes["true_survival"]
    spread = 3.0 * float(np.sqrt((expected * (1.0 - expected)).sum()))
    assert abs(routes["survived"].sum() - expected.sum()) < spread
    assert routes["strikes"].sum() == pytest.approx(routes["exposure_sum"].sum(), rel=0.15)
