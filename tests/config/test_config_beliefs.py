"""How many hostiles, and how good the sensors: what a configuration may say, what is said if it is wrong."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from swarmctl.config import model, scenario
from swarmctl.config.checks import check_config
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


def test_the_truth_is_drawn_from_what_is_announced(tmp_path: Path) -> None:
    read = loaded(tmp_path, "{distribution: weights, weights: {4: 1, 8: 3}}")
    sizes = [len(scenario.build(read.model_copy(update={"seed": seed})).hostiles) for seed in range(200)]
    assert set(sizes) == {4, 8}
    assert sizes.count(8) / 200 == pytest.approx(0.75, abs=0.12)


def test_the_sensor_is_perfect_unless_it_is_said_to_err(tmp_path: Path) -> None:
    assert scenario.build(loaded(tmp_path, "5")).prior.sensor.is_perfect
    erring = scenario.build(loaded(tmp_path, "5", "{p_miss: 0.1, p_false_alarm: 0.02}"))
    assert erring.prior.sensor == SensorModel(0.1, 0.02)


def test_each_vehicle_and_purpose_draws_for_itself(tmp_path: Path) -> None:
    built = scenario.build(loaded(tmp_path, "5"))
    purpose = scenario.RandomStream
    ends = [(purpose.SENSOR, 1), (purpose.SENSOR, 2), (purpose.CHANCE, 1)]
    draws = {built.generator(*end).random() for end in ends}
    assert len(draws) == 3
    assert built.generator(*ends[0]).random() in draws


WRONG = [
    ("{distribution: gauss, mean: 3}", "{}", ":3: threats.count: expected a number of hostiles, or a dist"),
    ("{mean: 3}", "{}", ":3: threats.count: expected a number of hostiles, or a distribution of it: {dis"),
    ("[3, 4]", "{}", ":3: threats.count: input should be a valid integer"),
    ("-3", "{}", ":3: threats.count: input should be greater than or equal to 0, found -3"),
    ("{distribution: poisson}", "{}", ":3: threats.count.mean: is missing"),
    ("{distribution: poisson, maen: 3, mean: 3}", "{}", ":3: threats.count.maen: unknown key; did you me"),
    ("{distribution: poisson, mean: -3}", "{}", ":3: threats.count.mean: input should be greater than 0,"),
    ("{distribution: poisson, mean: 300}", "{}", ":3: threats.count.mean: 300 hostiles do not fit into 1"),
    ("{distribution: uniform, min: 9, max: 3}", "{}", ":3: threats.count: min 9 exceeds max 3; exchange "),
    ("{distribution: uniform, min: 9, max: 101}", "{}", ":3: threats.count.max: 101 hostiles do not fit "),
    ("{distribution: binomial, trials: 4, p: 2}", "{}", ":3: threats.count.p: input should be less than "),
    ("{distribution: binomial, trials: 101, p: 0.1}", "{}", ":3: threats.count.trials: 101 hostiles do n"),
    ("{distribution: weights, weights: {}}", "{}", ":3: threats.count.weights: no number of hostiles has"),
    ("{distribution: weights, weights: {3: -1}}", "{}", ":3: threats.count.weights.3: input should be gr"),
    ("{distribution: weights, weights: {400: 1}}", "{}", ":3: threats.count.weights.400: 400 hostiles do"),
    ("3", "{p_miss: 1.5}", ":4: sensor.p_miss: input should be less than 1, found 1.5"),
    ("3", "{p_miss: 0.6, p_false_alarm: 0.4}", ":4: sensor: a sensor that misses 0.6 and raises false al"),
]  # fmt: skip


@pytest.mark.parametrize(("count", "sensor", "said"), WRONG, ids=[f"{c} {s}" for c, s, _ in WRONG])
def test_what_makes_no_sense_is_said_with_line_and_cure(
    count: str, sensor: str, said: str, tmp_path: Path
) -> None:
    with pytest.raises(model.ConfigError) as error:
        loaded(tmp_path, count, sensor)
    (line,) = error.value.lines
    assert line.removeprefix(str(tmp_path / "swarm.yaml")).startswith(said)


def test_a_distribution_over_several_lines_is_wrong_on_its_own_line(tmp_path: Path) -> None:
    text = "\n    distribution: uniform\n    min: 2\n    max: 400"
    with pytest.raises(model.ConfigError) as error:
        loaded(tmp_path, text)
    (line,) = error.value.lines
    assert line.removeprefix(str(tmp_path / "swarm.yaml")).startswith(":6: threats.count.max: 400 hostiles")


def test_editors_are_told_of_every_distribution() -> None:
    schema = json.dumps(model.Config.model_json_schema())
    for name in ("poisson", "binomial", "uniform", "weights", "p_false_alarm"):
        assert name in schema
