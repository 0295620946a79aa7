"""Whole flights with erring sensors and an unknown number of hostiles, and their reports."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from flights import fly
from typer.testing import CliRunner

from swarmctl.cli.main import cli
from swarmctl.config import model
from swarmctl.config.checks import check_config
from swarmctl.config.scenario import Scenario, build
from swarmctl.report import record
from swarmctl.report.outcome import FlightReport

pytestmark = pytest.mark.virtual

DOUBT = Path(__file__).parents[2] / "configs" / "doubt.yaml"
Flight = tuple[Scenario, FlightReport, Path]


@pytest.fixture(scope="module")
def doubtful(tmp_path_factory: pytest.TempPathFactory) -> Flight:
    shipped = model.load(DOUBT, check_config)
    assert shipped.simulate is not None
    three = shipped.simulate.model_copy(update={"count": 3})
    blinder = shipped.sensor.model_copy(update={"p_miss": 0.25})
    scenario = build(shipped.model_copy(update={"simulate": three, "sensor": blinder}))
    folder = tmp_path_factory.mktemp("doubt")
    return scenario, fly(scenario, folder), folder


def test_a_swarm_with_erring_sensors_arrives(doubtful: Flight) -> None:
    _, report, _ = doubtful
    assert report.trouble == ()
    assert [s.outcome for s in report.states.values()] == ["arrived"] * 3
    assert sum(s.plans.replans for s in report.states.values()) > 0


def test_sensors_err_and_look_again_and_all_beliefs_agree(doubtful: Flight) -> None:
    scenario, report, _ = doubtful
    belief = report.states[1].belief
    hostile = np.zeros(belief.looks.shape, dtype=bool)
    for cell in scenario.hostiles:
        hostile[cell] = True
    assert belief.looks.max() > 2
    assert ((belief.hits < belief.looks) & hostile).any()
    assert (belief.hits > 0)[~hostile].any()
    assert len({s.belief.occupancy().tobytes() for s in report.states.values()}) == 1


def test_after_the_flight_hostile_cells_have_higher_probabilities(doubtful: Flight) -> None:
    scenario, report, _ = doubtful
    belief = report.states[1].belief
    p, seen = belief.occupancy(), belief.looks > 0
    hostile = np.zeros(p.shape, dtype=bool)
    for cell in scenario.hostiles:
        hostile[cell] = True
    assert p[hostile & seen].mean() > 0.5
    assert p[~hostile & seen].mean() < 0.06


def test_a_replay_with_erring_sensors_makes_the_same_decisions(doubtful: Flight) -> None:
    _, _, folder = doubtful
    verdict = record.replay(folder / "run.mcap")
    assert verdict.difference == ""
    assert verdict.effects > 0


def test_the_summary_has_three_different_chances(doubtful: Flight) -> None:
    scenario, report, folder = doubtful
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["hostiles"]["announced"] == {"distribution": "poisson", "mean": 24.0}
    assert summary["hostiles"]["true"] == len(scenario.hostiles)
    assert 10.0 < summary["hostiles"]["expected"] < 40.0
    assert summary["hostiles"]["announced_count_was_too_low"] is False
    by_steps = {0: 0.6, 1: 0.3, 2: 0.1}
    for row, state in zip(report.summary["vehicles"], report.states.values(), strict=True):
        start = row["at_takeoff"]
        chance = start["chance_by_simulation"]
        assert 0.0 <= chance["low_95"] < chance["estimate"] < chance["high_95"] <= 1.0
        assert start["safety_factor"] < chance["estimate"]  # as the model says of unknown threats
        assert start["exposure_sum"] > 1.0  # no chance at all
        exact = math.prod(
            1.0 - by_steps[abs(r - hr) + abs(c - hc)]
            for r, c in state.flown.cells[1:]
            for hr, hc in scenario.hostiles
            if max(abs(r - hr), abs(c - hc)) <= 1
        )
        assert row["chance_among_true_hostiles"] == pytest.approx(exact, rel=1e-12)


@pytest.mark.full
def test_the_tables_show_exposure_product_and_chance_side_by_side(tmp_path: Path) -> None:
    run = CliRunner()
    planned = run.invoke(cli, ["plan", "--config", str(DOUBT), "--out", str(tmp_path)])
    assert planned.exit_code == 0, planned.output
    assert re.search(r"ΣP_s +∏\(1 − P_s\) +simulation", planned.output)
    assert re.search(r"uav1 +0 +950 +2\.\d{3} +0\.0\d+ +0\.\d{3} +0\.\d{3}–0\.\d{3}", planned.output)
    file = tmp_path / "small.yaml"
    file.write_text(
        "area: {origin_lat_deg: 46.0, origin_lon_deg: 14.4, rows: 8, cols: 8, cell_size_m: 50}\n"
        "threats: {count: 5}\nsimulate: {count: 2}\n"
    )
    flown = run.invoke(cli, ["fly", "--config", str(file), "--clock", "virtual", "--out", str(tmp_path)])
    assert flown.exit_code == 0, flown.output
    row = next(line for line in flown.output.splitlines() if re.match(" uav1 ", line))
    assert re.search(r"uav1 .* 0\.\d{3} +0\.\d{3}–0\.\d{3} +[01]\.\d{3} .*arrived", row)
