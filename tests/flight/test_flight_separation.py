"""Separation in whole flights on the virtual clock."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any

import pytest
from flights import AREA, SEPARATION_WAIVED, Ui, coded, fly, small

from swarmctl.agent import step
from swarmctl.agent.replan import mission_changes
from swarmctl.report.flight_table import swarm_lines

pytestmark = pytest.mark.virtual

GAP = ([0, 3], [1, 3], [2, 3], [6, 3], [7, 3], [8, 3])
"""unknown hostiles with a gap half-way between the first routes of two copters"""


@pytest.mark.full
def test_the_least_distance_flown_is_in_the_summary(tmp_path: Path) -> None:
    scenario = small()
    report = fly(scenario, tmp_path)
    separation = json.loads((tmp_path / "summary.json").read_text())["separation"]
    least, lines = separation["least_distance"], swarm_lines(report.summary)
    one, other = (report.statistics.vehicles[int(name[3:])] for name in least["vehicles"])
    # The distance equals that of the flown tracks, which have a point every quarter of a second.
    frame = scenario.grid.frame
    here, there = ([frame.to_local(*p) for p in v.flown] for v in (one, other))
    assert least["horizontal_m"] >= min(abs(a[1] - b[1]) for a in here for b in there) - 1.0
    assert least["distance_m"] == pytest.approx(math.hypot(least["horizontal_m"], least["vertical_m"]))
    assert 4.0 < least["distance_m"] < 120.0
    assert separation["too_close"] == []
    (line,) = (line for line in lines if f" {least['distance_m']:.1f} m" in line)
    assert " and ".join(least["vehicles"]) in line


def meeting(folder: Path, action: str) -> tuple[dict[str, Any], list[str]]:
    """Fly two copters, 1.5 m apart in height, to one goal at one time; return summary and messages."""
    scenario = small(
        simulate={"count": 2, "goal": [4, 7], "ready_s": 3.0},
        flight={"altitude_m": 15.0, "altitude_step_m": 1.5},
        separation={"action": action},
        threats={"count": 0},
    )
    ui = Ui()
    # Preflight finds this conflict, so the operator has to waive the check.
    report = fly(scenario, folder, ui=ui, options=SEPARATION_WAIVED)
    assert [state.outcome for state in report.states.values()] == ["arrived", "arrived"]
    return report.summary["separation"], ui.said


@pytest.mark.full
def test_without_an_action_both_vehicles_alarm_and_come_too_close(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The comparison of plans between vehicles is switched off; alarms remain.
    monkeypatch.setattr(mission_changes, "deconflict", lambda _before, decided, _now: decided)
    monkeypatch.setattr(step, "check_own_route", lambda state: (state, []))
    separation, shown = meeting(tmp_path, "none")
    least = separation["least_distance"]
    assert least["horizontal_m"] < 10.0
    assert least["vertical_m"] < 3.0
    assert separation["too_close"][0]["seconds"] > 1.0
    assert all("uav2" in line for line in coded(shown, "uav1", "alarm"))
    assert all("uav1" in line for line in coded(shown, "uav2", "alarm"))
    assert coded(shown, "uav1", "alarm")
    assert coded(shown, "uav2", "alarm")
    assert separation["held"] == separation["climbed"] == 0


def test_first_routes_that_would_meet_are_separated_before_any_alarm(tmp_path: Path) -> None:
    separation, shown = meeting(tmp_path, "hold")
    assert separation["too_close"] == []
    assert separation["held"] == len(coded(shown, "uav2", "landing-queue")) == 1
    assert separation["climbed"] == 0
    assert separation["first_routes"] == {"predicted": 1, "by_height": 0}
    assert separation["plans_in_flight"]["by_height"] >= 1
    assert separation["plans_in_flight"]["unresolved"] == 0
    assert not any("uav2 in " in line for line in shown if line.startswith("uav1: "))
    assert any("uav1 in " in line for line in shown if line.startswith("uav2: "))


def test_one_of_two_meeting_routes_is_flown_at_another_height(tmp_path: Path) -> None:
    """Two copters at one height, 200 m apart, see the hostiles at one time and head for the gap."""
    scenario = small(
        area={**AREA, "rows": 9},
        simulate={"count": 2, "ready_s": 3.0, "start_distance_m": 40.0},
        flight={"altitude_m": 15.0, "altitude_step_m": 0.0},
        threats={"count": len(GAP), "hostiles": GAP},
        planner={"w": 0.9},
        separation={"action": "none"},
    )
    ui = Ui()
    report = fly(scenario, tmp_path, ui=ui)
    assert [state.outcome for state in report.states.values()] == ["arrived", "arrived"]
    separation = report.summary["separation"]
    assert separation["too_close"] == []
    assert separation["least_distance"]["vertical_m"] > 3.0
    plans = separation["plans_in_flight"]
    assert plans["predicted"] >= 1
    assert plans["by_height"] >= 1
    assert plans["unresolved"] == 0
    assert any(f": {plans['predicted']}; " in line for line in swarm_lines(report.summary))
    # A later plan is fitted to the earlier one. Of two at the same time the higher system id gives way.
    changes = [coded(ui.said, uav, "height-change") for uav in ("uav1", "uav2")]
    assert any(changes) or coded(ui.said, "uav2", "route-conflict")
    assert not coded(ui.said, "uav1", "route-conflict")


@pytest.mark.full
def test_crossings_of_first_routes_are_counted_with_their_separation(tmp_path: Path) -> None:
    scenario = small(simulate={"count": 2, "goal": [4, 7], "ready_s": 3.0}, threats={"count": 0})
    report = fly(scenario, tmp_path)
    assert report.summary["separation"]["first_routes"] == {"predicted": 1, "by_height": 1}
    assert ["1", "1"] in [re.findall(r"\d+", line) for line in swarm_lines(report.summary)]
