"""The announced number of hostiles, and the errors of the sensors, in a configuration."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from config_files import assert_problems
from scipy.spatial.distance import pdist

from swarmctl.config import model, scenario
from swarmctl.config.checks import check_config
from swarmctl.core.grid import Cell
from swarmctl.core.inference.hostiles import HostileCount
from swarmctl.core.inference.sensor import SensorModel

PLAIN = """\
area: {origin_lat_deg: 46.0, origin_lon_deg: 14.0, rows: 10, cols: 10, cell_size_m: 50}
threats:
  count: COUNT
sensor: SENSOR
simulate: {count: 1}
"""


def loaded(tmp_path: Path, count: str, sensor: str = "{}") -> model.Config:
    file = tmp_path / "swarm.yaml"
    file.write_text(PLAIN.replace("COUNT", count).replace("SENSOR", sensor))
    return model.load(file, check_config)


COUNTS = [
    ("24", HostileCount.known(24)),
    ("{distribution: poisson, mean: 6.5}", HostileCount.poisson(6.5, 100)),
    ("{distribution: binomial, trials: 30, p: 0.2}", HostileCount.binomial(30, 0.2)),
    ("{distribution: uniform, min: 3, max: 9}", HostileCount.uniform(3, 9)),
    ("{distribution: weights, weights: {4: 1, 8: 2.5}}", HostileCount.weighted({4: 1.0, 8: 2.5})),
]


@pytest.mark.parametrize(("text", "count"), COUNTS, ids=[text for text, _ in COUNTS])
def test_the_number_of_hostiles_is_a_number_or_a_distribution(
    text: str, count: HostileCount, tmp_path: Path
) -> None:
    read = loaded(tmp_path, text)
    built = scenario.build(read)
    assert built.prior.count.n.tolist() == count.n.tolist()
    np.testing.assert_allclose(built.prior.count.pmf, count.pmf, rtol=1e-12)
    assert count.least <= len(built.hostiles) <= count.greatest
    assert built.psi_per_cell == pytest.approx(count.mean / 100 * (0.6 + 4 * 0.3 + 4 * 0.1))
    # a record keeps the configuration as JSON
    assert model.Config.model_validate_json(read.model_dump_json()) == read


def test_the_true_number_is_drawn_from_the_announced_distribution(tmp_path: Path) -> None:
    read = loaded(tmp_path, "{distribution: weights, weights: {4: 1, 8: 3}}")
    sizes = [len(scenario.build(read.model_copy(update={"seed": seed})).hostiles) for seed in range(200)]
    assert set(sizes) == {4, 8}
    assert sizes.count(8) / 200 == pytest.approx(0.75, abs=0.12)


def test_the_sensor_is_perfect_by_default(tmp_path: Path) -> None:
    assert scenario.build(loaded(tmp_path, "5")).prior.sensor.is_perfect
    erring = scenario.build(loaded(tmp_path, "5", "{p_miss: 0.1, p_false_alarm: 0.02}"))
    assert erring.prior.sensor == SensorModel(0.1, 0.02)


def test_each_vehicle_and_use_has_a_random_stream_of_its_own(tmp_path: Path) -> None:
    built = scenario.build(loaded(tmp_path, "5"))
    stream = scenario.RandomStream
    ends = [(stream.SENSOR, 1), (stream.SENSOR, 2), (stream.SURVIVAL, 1)]
    draws = {built.generator(*end).random() for end in ends}
    assert len(draws) == 3
    assert built.generator(*ends[0]).random() in draws


def drawn(tmp_path: Path, count: str, hostiles: str, n_seeds: int = 200) -> list[frozenset[Cell]]:
    """Return the hostiles of several seeds."""
    read = loaded(tmp_path, f"{count}\n  hostiles: {hostiles}")
    return [scenario.build(read.model_copy(update={"seed": seed})).hostiles for seed in range(n_seeds)]


def mean_distance(worlds: list[frozenset[Cell]]) -> float:
    return float(np.mean([pdist(np.array(sorted(hostiles), dtype=float)).mean() for hostiles in worlds]))


def test_hostiles_in_clusters_are_closer_together_than_anywhere_in_the_area(tmp_path: Path) -> None:
    clusters = drawn(tmp_path, "12", "{clusters: 3, spread_cells: 1}")
    assert {len(hostiles) for hostiles in clusters} == {12}
    assert all(0 <= row < 10 and 0 <= col < 10 for hostiles in clusters for row, col in hostiles)
    assert clusters == drawn(tmp_path, "12", "{clusters: 3, spread_cells: 1}")
    wide, anywhere = drawn(tmp_path, "12", "{clusters: 3, spread_cells: 2}"), drawn(tmp_path, "12", "random")
    assert mean_distance(clusters) < 0.95 * mean_distance(wide) < 0.95 * mean_distance(anywhere)
    (one,) = drawn(tmp_path, "9", "{clusters: 1, spread_cells: 0.4}", n_seeds=1)
    assert len({row for row, _ in one}) <= 4
    assert len({col for _, col in one}) <= 4


def test_clusters_without_room_spill_over(tmp_path: Path) -> None:
    assert {len(h) for h in drawn(tmp_path, "90", "{clusters: 1, spread_cells: 0.05}", 3)} == {90}


def test_the_true_number_of_hostiles_may_differ_from_the_announced_number(tmp_path: Path) -> None:
    read = loaded(tmp_path, "12\n  hostiles: {count: 20}")
    built = scenario.build(read)
    assert len(built.hostiles) == 20
    assert built.prior.count.n.tolist() == [12]
    assert model.Config.model_validate_json(read.model_dump_json()) == read
    # One draw of equal numbers, with or without a section.
    assert drawn(tmp_path, "12", "{count: 12}", 5) == drawn(tmp_path, "12", "random", 5)


WRONG: list[tuple[str, str, tuple[str, ...]]] = [
    ("{distribution: gauss, mean: 3}", "{}", (":3: threats.count", "poisson")),
    ("{mean: 3}", "{}", (":3: threats.count", "{distribution: poisson")),
    ("[3, 4]", "{}", (":3: threats.count", "integer")),
    ("-3", "{}", (":3: threats.count", "0", "-3")),
    ("{distribution: poisson}", "{}", (":3: threats.count.mean",)),
    ("{distribution: poisson, maen: 3, mean: 3}", "{}", (":3: threats.count.maen", "'mean'")),
    ("{distribution: poisson, mean: -3}", "{}", (":3: threats.count.mean", "-3")),
    ("{distribution: poisson, mean: 300}", "{}", (":3: threats.count.mean", "300", "100")),
    ("{distribution: uniform, min: 9, max: 3}", "{}", (":3: threats.count", "min 9", "max 3")),
    ("{distribution: uniform, min: 9, max: 101}", "{}", (":3: threats.count.max", "101", "100")),
    ("{distribution: binomial, trials: 4, p: 2}", "{}", (":3: threats.count.p", "1", "2")),
    ("{distribution: binomial, trials: 101, p: 0.1}", "{}", (":3: threats.count.trials", "101", "100")),
    ("{distribution: weights, weights: {}}", "{}", (":3: threats.count.weights", "{20: 1, 24: 3}")),
    ("{distribution: weights, weights: {3: -1}}", "{}", (":3: threats.count.weights.3", "-1")),
    ("{distribution: weights, weights: {400: 1}}", "{}", (":3: threats.count.weights.400", "400", "100")),
    ("3\n  hostiles: {clusters: 0, spread_cells: 1}", "{}", (":4: threats.hostiles.clusters", "1", "0")),
    (
        "3\n  hostiles: {clusters: 101, spread_cells: 1}",
        "{}",
        (":4: threats.hostiles.clusters", "101", "100"),
    ),
    ("3\n  hostiles: {count: 101}", "{}", (":4: threats.hostiles.count", "101", "100")),
    ("3\n  hostiles: {spread_cells: 2}", "{}", (":4: threats.hostiles", "clusters")),
    ("3\n  hostiles: {clusters: 2}", "{}", (":4: threats.hostiles", "spread_cells")),
    ("3\n  hostiles: {clusters: 2, spread: 2}", "{}", (":4: threats.hostiles.spread", "'spread_cells'")),
    ("3\n  hostiles: anywhere", "{}", (":4: threats.hostiles", "'random'", "'anywhere'")),
    ("3", "{p_miss: 1.5}", (":4: sensor.p_miss", "1", "1.5")),
    ("3", "{p_miss: 0.6, p_false_alarm: 0.4}", (":4: sensor", "0.6", "0.4")),
]


@pytest.mark.parametrize(("count", "sensor", "expected"), WRONG, ids=[f"{c} {s}" for c, s, _ in WRONG])
def test_an_error_is_reported_at_its_key(
    count: str, sensor: str, expected: tuple[str, ...], tmp_path: Path
) -> None:
    with pytest.raises(model.ConfigError) as error:
        loaded(tmp_path, count, sensor)
    file = str(tmp_path / "swarm.yaml")
    assert_problems([line.removeprefix(file) for line in error.value.lines], [expected])


def test_an_error_in_a_distribution_over_several_lines_is_reported_at_its_line(tmp_path: Path) -> None:
    text = "\n    distribution: uniform\n    min: 2\n    max: 400"
    with pytest.raises(model.ConfigError) as error:
        loaded(tmp_path, text)
    (line,) = error.value.lines
    assert line.removeprefix(str(tmp_path / "swarm.yaml")).startswith(":6: threats.count.max: ")
