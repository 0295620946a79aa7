"""Separation in whole flights on the virtual clock."""

from __future__ import annotations

import asyncio
import json
import math
import re
from pathlib import Path
from typing import Any

import pytest
from flights import SEPARATION_WAIVED, Ui, coded, fly, small
from gap_scenario import compare_no_plans, through_the_gap

from swarmctl.flight.runner import Runner
from swarmctl.report import record
from swarmctl.report.flight_table import swarm_lines

pytestmark = pytest.mark.virtual


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


@pytest.fixture
def uncompared(monkeypatch: pytest.MonkeyPatch) -> None:
    compare_no_plans(monkeypatch)


def meeting(folder: Path, action: str, **sections: Any) -> tuple[dict[str, Any], list[str]]:
    """Fly two copters, 1.5 m apart in height, to one goal at one time; return summary and messages."""
    scenario = small(
        simulate={"count": 2, "goal": [4, 7], "ready_s": 3.0},
        flight={"altitude_m": 15.0, "altitude_step_m": 1.5},
        separation={"action": action},
        threats={"count": 0},
        **sections,
    )
    ui = Ui()
    # Preflight finds this conflict, so the operator has to waive the check.
    report = fly(scenario, folder, ui=ui, options=SEPARATION_WAIVED)
    assert [state.outcome for state in report.states.values()] == ["arrived", "arrived"]
    return report.summary["separation"], ui.said


@pytest.mark.full
@pytest.mark.usefixtures("uncompared")
def test_without_an_action_both_vehicles_alarm_and_come_too_close(tmp_path: Path) -> None:
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


@pytest.mark.full
@pytest.mark.usefixtures("uncompared")
def test_the_higher_system_id_holds_until_the_other_has_passed(tmp_path: Path) -> None:
    separation, shown = meeting(tmp_path, "hold")
    assert separation["too_close"] == []
    assert separation["held"] >= 1
    (yields, *_), (resumes, *_) = coded(shown, "uav2", "alarm-yields"), coded(shown, "uav2", "resumes")
    assert shown.index(yields) < shown.index(resumes)
    assert coded(shown, "uav2", "stops-in-time")


@pytest.mark.full
@pytest.mark.usefixtures("uncompared")
def test_the_lower_system_id_holds_if_the_higher_one_does_not_receive_its_states(tmp_path: Path) -> None:
    mute = {"bus": "memory", "quiet": [{"from_s": 0.0, "uavs": [1]}]}
    separation, shown = meeting(tmp_path, "hold", communication=mute)
    assert separation["too_close"] == []
    assert separation["held"] >= 1
    assert not any("[alarm" in line for line in shown if line.startswith("uav2: "))
    assert coded(shown, "uav1", "alarm-not-heard")
    assert coded(shown, "uav1", "stops-in-time")


@pytest.mark.full
@pytest.mark.usefixtures("uncompared")
def test_a_vehicle_that_gives_way_may_climb_instead(tmp_path: Path) -> None:
    separation, _ = meeting(tmp_path, "climb")
    assert separation["too_close"] == []
    assert separation["least_distance"]["vertical_m"] > 3.0
    assert (separation["held"], separation["climbed"]) == (0, 1)


def test_first_routes_that_would_meet_are_separated_before_any_alarm(
    tmp_path: Path,
) -> None:
    separation, shown = meeting(tmp_path, "hold")
    assert separation["too_close"] == []
    assert separation["held"] == len(coded(shown, "uav2", "landing-queue")) == 1
    assert separation["climbed"] == 0
    assert separation["first_routes"] == {"predicted": 1, "by_height": 0}
    assert separation["plans_in_flight"]["by_height"] >= 1
    assert separation["plans_in_flight"]["unresolved"] == 0
    assert not any("uav2 in " in line for line in shown if line.startswith("uav1: "))
    assert any("uav1 in " in line for line in shown if line.startswith("uav2: "))


def flown_after_waiting(folder: Path, **simulate: float) -> None:
    """Fly two vehicles to one goal, hardly apart in height; check that both arrive.

    The second waits on the ground until the first is out of its way.
    """
    scenario = small(
        simulate={"count": 2, "goal": [4, 7], "ready_s": 3.0, **simulate},
        flight={"altitude_m": 15.0, "altitude_step_m": 1.5},
        threats={"count": 0},
    )
    ui = Ui()
    report = fly(scenario, folder, ui=ui, options=SEPARATION_WAIVED)
    assert report.all_arrived
    (waits,), (launches,) = coded(ui.said, "uav2", "launch-waits"), coded(ui.said, "uav2", "launch-clear")
    assert "uav1 in " in waits
    assert ui.said.index(waits) < ui.said.index(launches)
    separation = report.summary["separation"]
    assert separation["plans_in_flight"]["unresolved"] == 0
    assert separation["too_close"] == []


@pytest.mark.full
def test_a_later_launch_waits_on_the_ground_until_its_route_is_clear(tmp_path: Path) -> None:
    flown_after_waiting(tmp_path, delay_step_s=3.0)


@pytest.mark.full
def test_a_launch_after_long_checks_compares_its_route_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    check = Runner._check_launch

    async def at_length(runner: Runner) -> None:
        await asyncio.sleep(4.0 if runner.state.task.uav == 2 else 0.0)
        await check(runner)

    monkeypatch.setattr(Runner, "_check_launch", at_length)
    flown_after_waiting(tmp_path)
    assert record.replay(tmp_path / "run.mcap").difference == ""


def drawn_together(folder: Path, **separation: Any) -> tuple[dict[str, Any], list[str]]:
    """Return the summary and the messages of a flight without action on vehicles that come near."""
    scenario = through_the_gap(separation={"action": "none", **separation})
    ui = Ui()
    report = fly(scenario, folder, ui=ui)
    assert [state.outcome for state in report.states.values()] == ["arrived", "arrived"]
    lines = swarm_lines(report.summary)
    return report.summary["separation"] | {"lines": lines}, ui.said


def test_one_of_two_meeting_routes_is_flown_at_another_height(tmp_path: Path) -> None:
    separation, shown = drawn_together(tmp_path)
    assert separation["too_close"] == []
    assert separation["least_distance"]["vertical_m"] > 3.0
    plans = separation["plans_in_flight"]
    assert plans["predicted"] >= 1
    assert plans["by_height"] >= 1
    assert plans["unresolved"] == 0
    assert any(f": {plans['predicted']}; " in line for line in separation["lines"])
    # A later plan is fitted to the earlier one. Of two at the same time the higher system id gives way.
    changes = [coded(shown, uav, "height-change") for uav in ("uav1", "uav2")]
    assert any(changes) or coded(shown, "uav2", "route-conflict")
    assert not coded(shown, "uav1", "route-conflict")


@pytest.mark.full
def test_crossings_of_first_routes_are_counted_with_their_separation(tmp_path: Path) -> None:
    scenario = small(simulate={"count": 2, "goal": [4, 7], "ready_s": 3.0}, threats={"count": 0})
    report = fly(scenario, tmp_path)
    assert report.summary["separation"]["first_routes"] == {"predicted": 1, "by_height": 1}
    assert ["1", "1"] in [re.findall(r"\d+", line) for line in swarm_lines(report.summary)]
