"""A package that a link needs is missing: that is said, by whatever needs it first."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import pytest
from flights import Ui, small
from typer.testing import CliRunner

from swarmctl.cli.main import cli
from swarmctl.flight import app
from swarmctl.flight.virtual_clock import run_virtual

pytestmark = pytest.mark.virtual

ONE_OF_TWO = """\
name: two
area: {origin_lat_deg: 46.0, origin_lon_deg: 14.4, rows: 6, cols: 6, cell_size_m: 50}
threats: {count: 3}
preflight: {endurance_s: 900}
vehicles:
  - {name: alpha, url: "udpin:127.0.0.1:0", sysid: 1, start: {lat_deg: 46.001, lon_deg: 14.399}, goal: [4, 5]}
  - {name: beta, url: "udpin:127.0.0.1:0", sysid: 2, start: {lat_deg: 46.002, lon_deg: 14.399}, goal: [3, 5],
     link: mavsdk}
"""


@pytest.fixture(autouse=True)
def without_mavsdk(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mavsdk", None)


def test_one_of_two_vehicles_needs_what_is_not_there_and_nothing_else_breaks(tmp_path: Path) -> None:
    scenario = small(simulate={"count": 2, "ready_s": 3.0})
    first, second = scenario.specs
    scenario = replace(scenario, specs=(first, replace(second, link="mavsdk")))
    report = run_virtual(app.fly(scenario, tmp_path, Ui(), clock="virtual", permission=lambda foreign: None))
    assert report.ended == "failed"
    (trouble,) = report.trouble
    assert trouble.startswith("uav2: `link: mavsdk` needs the package mavsdk")
    assert "pip install 'mavlink-swarmctl[mavsdk]'" in trouble


def test_check_tells_of_it(tmp_path: Path) -> None:
    file = tmp_path / "two.yaml"
    file.write_text(ONE_OF_TWO)
    result = CliRunner().invoke(cli, ["check", "--config", str(file)])
    assert result.exit_code == 1, result.output
    assert "beta: `link: mavsdk` needs the package mavsdk" in result.stderr
    assert "alpha" not in result.stderr
