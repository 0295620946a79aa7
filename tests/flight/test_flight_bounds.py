"""Whole flights on the virtual clock under a time bound, and by planners beyond the paper."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
from flights import Ui, coded, fly, small
from typer.testing import CliRunner

from swarmctl.agent.replan.decide import first_route
from swarmctl.agent.replan.time_bound import arrives_s
from swarmctl.cli import main
from swarmctl.config.scenario import Scenario
from swarmctl.core.route import ends_and_turns
from swarmctl.planners import BoundTooTight
from swarmctl.report import record

pytestmark = pytest.mark.virtual

AREA = {"origin_lat_deg": 46.0, "origin_lon_deg": 14.4, "rows": 14, "cols": 14, "cell_size_m": 50.0}
WITHIN_S = 108.0


def swarm(planner: dict[str, Any], **bounds: float) -> Scenario:
    """Return two copters over 14 × 14 cells with 14 hostiles; they need at least 89.5 s and 91.5 s."""
    simulate = {"count": 2, "ready_s": 3.0, **bounds}
    flight = {"altitude_m": 40.0}  # the climb is part of these times
    return small(area=AREA, threats={"count": 14}, planner=planner, simulate=simulate, flight=flight)


def flown(scenario: Scenario, folder: Path, ui: Ui | None = None) -> list[dict[str, Any]]:
    """Fly, check arrivals and replay, and return the vehicles of the summary."""
    report = fly(scenario, folder, ui=ui)
    assert [s.outcome for s in report.states.values()] == ["arrived"] * len(scenario.specs)
    verdict = record.replay(folder / "run.mcap")
    assert verdict.difference == ""
    assert verdict.effects > 50
    vehicles: list[dict[str, Any]] = json.loads((folder / "summary.json").read_text())["vehicles"]
    return vehicles


@pytest.mark.full
def test_without_a_bound_the_least_exposed_routes_take_longer(tmp_path: Path) -> None:
    for vehicle in flown(swarm({"name": "dijkstra", "w": 1.0}), tmp_path):
        assert vehicle["arrived_s"] > WITHIN_S
        assert vehicle["arrival_bound_kept"] is None
        assert vehicle["last_plan"]["searched"] == []


@pytest.mark.parametrize("planner", [pytest.param("time_bound", marks=pytest.mark.full), "constrained"])
def test_with_a_bound_the_swarm_arrives_in_time(planner: str, tmp_path: Path) -> None:
    for vehicle in flown(swarm({"name": planner}, arrive_within_s=WITHIN_S), tmp_path):
        assert vehicle["arrive_within_s"] == WITHIN_S
        assert vehicle["arrived_s"] <= WITHIN_S
        assert vehicle["arrival_bound_kept"] is True
        plan = vehicle["last_plan"]
        assert set(plan["searched"][0]) == {"w", "length_cells", "exposure_sum"}
        assert (plan["lower_bound"] is not None) is (planner == "constrained")


@pytest.mark.full
def test_an_arrival_window_is_kept_at_both_ends(tmp_path: Path) -> None:
    scenario = swarm(
        {"name": "time_bound", "options": {"minimise": "distance"}},
        arrive_after_s=104.0,
        arrive_within_s=150.0,
    )
    for vehicle in flown(scenario, tmp_path):
        assert 104.0 <= vehicle["arrived_s"] <= 150.0
        assert vehicle["arrival_bound_kept"] is True


@pytest.mark.full
def test_the_survival_planner_flies(tmp_path: Path) -> None:
    for vehicle in flown(swarm({"name": "survival"}), tmp_path):
        assert vehicle["arrived_s"] > 90.0
        assert vehicle["arrive_within_s"] is None


@pytest.mark.full
def test_a_bound_that_cannot_be_met_is_reported_once_and_stops_no_vehicle(tmp_path: Path) -> None:
    """The configuration's checks would refuse this bound; the vehicle misses it by as little as possible."""
    ui = Ui()
    vehicles = flown(swarm({"name": "constrained"}, arrive_within_s=84.0), tmp_path, ui)
    late = [vehicle for vehicle in vehicles if not vehicle["arrival_bound_kept"]]
    assert late
    assert all(vehicle["arrived_s"] < 103.0 for vehicle in late)
    for vehicle in late:
        (line,) = coded(ui.said, vehicle["name"], "no-timely-route")
        assert " 84 s" in line


@pytest.mark.full
@pytest.mark.parametrize("speed_m_s", [6.0, 10.0])
def test_the_tightest_accepted_bound_is_kept_around_many_corners(speed_m_s: float, tmp_path: Path) -> None:
    gaps = {2: 5, 5: 8, 8: 5, 11: 8}  # column: row
    walls = [[row, col] for col, gap in gaps.items() for row in range(14) if row != gap]
    sections = {"area": {**AREA, "no_fly": walls}, "threats": {"count": 0}, "planner": {"name": "time_bound"}}

    def bounded(within_s: float) -> Scenario:
        return small(**sections, simulate={"count": 1, "speed_m_s": speed_m_s, "arrive_within_s": within_s})

    free = bounded(1000.0)
    (task,) = free.tasks
    with pytest.raises(BoundTooTight) as refused:
        first_route(bounded(30.0).tasks[0], free.prior)
    nearest = refused.value.nearest
    tightest_s = math.ceil(10.0 * arrives_s(task, nearest.length_cells, nearest.cells)) / 10.0
    assert len(ends_and_turns(nearest.cells)) >= 7  # the route has corners
    ui = Ui()
    (vehicle,) = flown(bounded(tightest_s), tmp_path, ui)
    assert vehicle["arrival_bound_kept"] is True
    assert tightest_s - 25.0 < vehicle["arrived_s"] <= tightest_s
    assert not [text for text in ui.said if text.endswith("[no-timely-route]")]


@pytest.mark.full
def test_a_missed_bound_changes_the_exit_code_and_is_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "swarmctl.config.checks.check_config", lambda config: ()
    )  # the checks would refuse the bound
    file = tmp_path / "late.yaml"
    sections = "threats: {count: 0}\nplanner: {name: time_bound}\ncommunication: {bus: memory}\n"
    area = "area: {origin_lat_deg: 46.0, origin_lon_deg: 14.4, rows: 4, cols: 4, cell_size_m: 50}\n"
    for within_s, code in ((30, 1), (90, 0)):
        file.write_text(f"{area}{sections}simulate: {{count: 1, ready_s: 3, arrive_within_s: {within_s}}}\n")
        words = ["fly", "--clock", "virtual", "--config", str(file), "--out", str(tmp_path / "runs")]
        result = CliRunner().invoke(main.cli, words, env={"COLUMNS": "200"})
        assert result.exit_code == code, result.output
        assert f"/ {within_s}" in result.output
        assert ("uav1 [time-bound-missed]" in result.output) is (code == 1)
