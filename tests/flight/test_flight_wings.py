"""Whole flights of fixed wings among copters, on the virtual clock."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from flights import Ui, away_m, fly, winged
from profiles import full_only
from recorded import first_heartbeats
from trouble import Trouble, interrupting

from swarmctl.agent.replan.landing_pattern import ROLL_OUT_M
from swarmctl.config import model
from swarmctl.config.checks import check_config
from swarmctl.config.scenario import build
from swarmctl.core.records import replace

pytestmark = pytest.mark.virtual

WINGS = Path(__file__).parents[2] / "configs" / "wings.yaml"
PLANE, COPTER = 1, 2


@pytest.mark.full
def test_the_shipped_fixed_wings_and_copters_arrive_by_changed_missions(tmp_path: Path) -> None:
    scenario = build(model.load(WINGS, check_config))
    report = fly(scenario, tmp_path)
    assert report.trouble == ()
    assert [s.outcome for s in report.states.values()] == ["arrived"] * 5
    kinds = [heartbeat.type for heartbeat in first_heartbeats(tmp_path, scenario)]
    assert kinds == [PLANE, COPTER, COPTER, PLANE, COPTER]
    for uav in (1, 4):
        state = report.states[uav]
        assert state.plans.replans > 0
        assert state.plans.mission is not None
        assert state.plans.mission.plan.approach is not None
        assert away_m(report, uav, state.plans.mission.plan.approach.touchdown) < ROLL_OUT_M
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["separation"]["too_close"] == []
    plan = json.loads((tmp_path / "uav1.plan").read_text())["mission"]
    assert plan["vehicleType"] == PLANE
    assert [item["command"] for item in plan["items"]][-5:] == [16, 189, 31, 16, 21]


@pytest.mark.full
@pytest.mark.parametrize(
    ("autopilot", "on_exit", "mode"),
    [
        ("arduplane", "return", "AUTO"),
        ("arduplane", "land", "AUTO"),
        ("px4plane", "return", "AUTO.LOITER"),  # disarmed it waits there
        ("px4plane", "land", "AUTO.MISSION"),
    ],
)
def test_a_recalled_fixed_wing_lands_at_home(autopilot: str, on_exit: str, mode: str, tmp_path: Path) -> None:
    scenario = winged(flight={"on_exit": on_exit}, simulate={"autopilot": [autopilot, "ardupilot"]})
    report = fly(scenario, tmp_path, trouble=interrupting(25.0))
    wing = report.states[1]
    assert report.ended == "stopped"
    assert (wing.vehicle.mode, wing.vehicle.armed) == (mode, False)
    assert away_m(report, 1, scenario.specs[0].start) < ROLL_OUT_M


@pytest.mark.parametrize(("autopilot", "mode"), [("arduplane", "GUIDED"), ("px4plane", "AUTO.LOITER")])
def test_a_holding_fixed_wing_circles(autopilot: str, mode: str, tmp_path: Path) -> None:
    scenario = winged(flight={"on_exit": "hold"}, simulate={"autopilot": [autopilot, "ardupilot"]})
    report = fly(scenario, tmp_path, trouble=interrupting(30.0))
    wing = report.states[1]
    assert (wing.vehicle.mode, wing.vehicle.armed) == (mode, True)
    assert wing.vehicle.ground_speed_m_s > 10.0
    assert wing.vehicle.alt_rel_m == pytest.approx(30.0, abs=3.0)


@pytest.mark.parametrize("seed", [18, *full_only(19, 20)])
def test_fixed_wings_of_px4_arrive_by_changed_missions_and_land_at_their_goals(
    seed: int, tmp_path: Path
) -> None:
    scenario = winged(
        seed=seed,
        threats={"count": 12},
        simulate={"autopilot": "px4plane"},
        flight={"altitude_step_m": 8.0},
    )
    report = fly(scenario, tmp_path)
    assert report.trouble == ()
    assert [s.outcome for s in report.states.values()] == ["arrived"] * 2
    assert sum(s.plans.replans for s in report.states.values()) > 0
    for uav, state in report.states.items():
        assert state.plans.mission is not None
        assert state.plans.mission.plan.approach is not None
        assert away_m(report, uav, state.plans.mission.plan.approach.touchdown) < ROLL_OUT_M
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["separation"]["too_close"] == []
    assert {heartbeat.type for heartbeat in first_heartbeats(tmp_path, scenario)} == {PLANE}


def test_a_px4_whose_return_does_not_end_at_its_landing_stays_on_the_ground(tmp_path: Path) -> None:
    trouble = Trouble(params_of={1: {"RTL_TYPE": 0.0}})
    scenario = winged(simulate={"autopilot": ["px4plane", "ardupilot"]})
    report = fly(scenario, tmp_path, trouble=trouble)
    assert not any(state.launch.armed_seen for state in report.states.values())
    (text,) = report.trouble
    assert re.match(r"uav1: parameters: .*RTL_TYPE 0, .*\b1 ", text)


@pytest.mark.parametrize("autopilot", ["arduplane", "px4plane"])
def test_a_fixed_wing_configured_as_a_copter_stays_on_the_ground(autopilot: str, tmp_path: Path) -> None:
    scenario = winged(simulate={"autopilot": [autopilot, "ardupilot"]})
    wing = replace(scenario.specs[0], airframe="copter")
    copter = replace(scenario.tasks[0], wings=None, turn_radius_m=0.0)
    mistaken = replace(
        scenario,
        specs=(wing, scenario.specs[1]),
        swarm=(wing, scenario.specs[1]),
        tasks=(copter, scenario.tasks[1]),
    )
    ui = Ui()
    report = fly(mistaken, tmp_path, ui=ui)
    assert not any(state.launch.armed_seen for state in report.states.values())
    assert "airframe: plane" in report.states[1].outcome


@pytest.mark.parametrize("autopilot", ["arduplane", pytest.param("px4plane", marks=pytest.mark.full)])
def test_fixed_wings_arrive_together_above_their_minimum_speed(autopilot: str, tmp_path: Path) -> None:
    scenario = winged(
        simulate={"autopilot": autopilot, "count": 3},
        arrival={"mode": "simultaneous", "tolerance_s": 3.0},
        flight={"altitude_m": 30.0, "altitude_step_m": 10.0},
        wings={"min_speed_m_s": 14.0},
    )
    report = fly(scenario, tmp_path)
    assert [s.outcome for s in report.states.values()] == ["arrived"] * 3
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["arrival"]["kept"]
    lines = (tmp_path / "evidence.jsonl").read_text().splitlines()
    commands = [entry["what"] for entry in map(json.loads, lines) if entry["kind"] == "command"]
    speeds = [what["param2"] for what in commands if what.get("command") == "DO_CHANGE_SPEED"]
    assert min(speeds) == 14.0, "without the limit the speed would be 13.6 m/s"
