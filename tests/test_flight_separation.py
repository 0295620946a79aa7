"""Keeping apart, in whole flights on the virtual clock."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
from flights import Ui, fly, small

from swarmctl.app import Manner
from swarmctl.flight_report import together
from swarmctl.preflight.waivers import Waiver

pytestmark = pytest.mark.virtual


def test_the_least_distance_flown_is_in_the_summary(tmp_path: Path) -> None:
    scenario = small()
    report = fly(scenario, tmp_path)
    separation = json.loads((tmp_path / "summary.json").read_text())["separation"]
    least = separation["least_distance"]
    one, other = (report.ledger.vehicles[int(name[3:])] for name in least["vehicles"])
    # As far apart as the flown tracks, which are points every quarter of a second, and no farther.
    frame = scenario.grid.frame
    here, there = ([frame.to_local(*p) for p in v.flown] for v in (one, other))
    assert least["horizontal_m"] >= min(abs(a[1] - b[1]) for a in here for b in there) - 1.0
    assert least["distance_m"] == pytest.approx(math.hypot(least["horizontal_m"], least["vertical_m"]))
    assert 4.0 < least["distance_m"] < 120.0
    assert separation["too_close"] == []
    (line,) = together(report.summary)
    assert line.startswith(f"least distance flown: {least['distance_m']:.1f} m, ")


def meeting(folder: Path, action: str) -> tuple[dict[str, Any], list[str]]:
    """Two copters, 1.5 m apart in height, come to one goal at one time; the summary and what was said."""
    scenario = small(
        simulate={"count": 2, "goal": [4, 7], "ready_s": 3.0},
        flight={"altitude_m": 15.0, "altitude_step_m": 1.5},
        separation={"action": action},
        threats={"count": 0},
    )
    ui = Ui()
    # Before the flight this is found out, and an operator has to say that he wants it.
    report = fly(scenario, folder, ui=ui, manner=Manner(waivers=(Waiver("separation"),)))
    assert [state.outcome for state in report.states.values()] == ["arrived", "arrived"]
    return report.summary["separation"], ui.said


def test_without_an_action_both_are_warned_and_come_too_close(tmp_path: Path) -> None:
    separation, said = meeting(tmp_path, "none")
    least = separation["least_distance"]
    assert least["horizontal_m"] < 10.0
    assert least["vertical_m"] < 3.0
    assert separation["too_close"][0]["seconds"] > 1.0
    assert {line.partition(" in ")[0] for line in said if "too close" in line} == {
        "uav1: too close to vehicle 2",
        "uav2: too close to vehicle 1",
    }
    assert separation["held"] == separation["climbed"] == 0


def test_the_higher_system_id_holds_until_the_other_is_past_and_flies_on(tmp_path: Path) -> None:
    separation, said = meeting(tmp_path, "hold")
    assert separation["too_close"] == []
    assert separation["least_distance"]["distance_m"] > 10.0
    assert separation["held"] >= 1
    gave = [i for i, line in enumerate(said) if line.startswith("uav2: too close") and "it gives way" in line]
    went_on = said.index("uav2: clear of the others: it flies on")
    assert gave[0] < went_on


def test_or_it_climbs_and_both_fly_on(tmp_path: Path) -> None:
    separation, _ = meeting(tmp_path, "climb")
    assert separation["too_close"] == []
    assert separation["least_distance"]["vertical_m"] > 3.0
    assert (separation["held"], separation["climbed"]) == (0, 1)
