"""Failsafe rules in whole flights with faults."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from flights import Ui, coded, fly, small
from profiles import full_only
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from trouble import Trouble, outage, sagging, select_mode

from sim_vehicle.fleet import Fleet
from swarmctl.agent.failsafes.base import DemandKind
from swarmctl.agent.phases import Phase
from swarmctl.config.scenario import Scenario
from swarmctl.report import record

pytestmark = pytest.mark.virtual


def pair(**sections: object) -> Scenario:
    return small(simulate={"count": 2, "ready_s": 3.0}, **sections)


def test_a_vehicle_with_a_low_battery_returns_while_the_other_flies_on(tmp_path: Path) -> None:
    trouble = sagging(0.2)
    ui = Ui()
    report = fly(pair(), tmp_path, trouble=trouble, ui=ui)
    assert trouble.modes[2] == ["AUTO", "RTL"]
    assert ["20 %" in line for line in coded(ui.said, "uav2", "low-battery")] == [True]
    assert report.states[1].outcome == "arrived"
    assert (report.states[2].phase, report.states[2].vehicle.armed) == ("failed", False)
    assert report.states[2].outcome.startswith("battery at 20 %")
    assert report.states[2].outcome.endswith("; disarmed")
    assert record.replay(tmp_path / "run.mcap").difference == ""


@pytest.mark.full
def test_a_vehicle_with_a_critical_battery_lands_where_it_is(tmp_path: Path) -> None:
    trouble = sagging(0.05)
    ui = Ui()
    report = fly(pair(), tmp_path, trouble=trouble, ui=ui)
    assert trouble.modes[2] == ["AUTO", "LAND"]
    assert any("5 %" in line for line in coded(ui.said, "uav2", "low-battery"))
    assert report.states[2].cell is not None


@pytest.mark.full
def test_a_disabled_rule_leaves_the_vehicle_to_its_own_failsafe(tmp_path: Path) -> None:
    trouble = sagging(0.05)
    ui = Ui()
    report = fly(pair(rules={"low_battery": None}), tmp_path, trouble=trouble, ui=ui)
    assert trouble.modes[2] == ["AUTO", "RTL"]
    assert not any("rules.low_battery" in text for text in ui.said)
    assert report.states[2].phase == "released"
    assert "in mode RTL" in report.states[2].outcome


@pytest.mark.parametrize("mode", ["GUIDED", *full_only("LOITER", "RTL")])
def test_a_pilot_or_another_station_takes_over_and_is_not_fought(mode: str, tmp_path: Path) -> None:
    """A switch of the radio control changes the mode as a station's command does.

    A heartbeat does not show the source of the change.
    """
    trouble = Trouble(actions=[(30.0, select_mode(2, mode)), (120.0, select_mode(2, "LAND"))])
    ui = Ui()
    report = fly(pair(), tmp_path, trouble=trouble, ui=ui)
    assert trouble.modes[2] == [
        "AUTO",
        mode,
        *["LAND"] * (mode == "GUIDED"),
    ]  # the other vehicles land earlier
    released = f"uav2: {Phase.FLYING} → {Phase.RELEASED} "
    assert any(line.startswith(released) and mode in line for line in ui.said)
    assert report.states[2].phase == "released"
    assert report.states[1].outcome == "arrived"


@pytest.mark.full
def test_a_pilot_takes_over_from_a_vehicle_that_is_on_its_way_home(tmp_path: Path) -> None:
    trouble = sagging(0.2)
    trouble.actions.append((40.0, select_mode(2, "LOITER")))
    ui = Ui()
    report = fly(pair(), tmp_path, trouble=trouble, ui=ui)
    assert trouble.modes[2] == ["AUTO", "RTL", "LOITER"]
    released = f"uav2: {Phase.LEAVING} → {Phase.RELEASED} "
    assert any(line.startswith(released) and "LOITER" in line for line in ui.said)
    assert report.states[2].phase == "released"


@pytest.mark.full
def test_vehicles_blown_off_their_routes_return(tmp_path: Path) -> None:
    trouble = Trouble(wind={"speed_m_s": 26.0, "from_deg": 0.0, "gust_m_s": 0.0})
    ui = Ui()
    report = fly(pair(), tmp_path, trouble=trouble, ui=ui)
    assert [modes[:2] for modes in trouble.modes.values()] == [["AUTO", "RTL"]] * 2
    for name in ("uav1", "uav2"):
        (line,) = coded(ui.said, name, "not-following")
        assert "60 m" in line
        assert "15 s" in line
    assert not any(state.vehicle.armed for state in report.states.values())


@pytest.mark.full
@pytest.mark.autopilots("1.20")
def test_the_autopilots_failsafe_after_a_lost_gps_is_not_fought(tmp_path: Path) -> None:
    trouble = Trouble(faults=[{"fault": "gps_loss", "vehicles": [2], "at_s": 30.0}])
    ui = Ui()
    report = fly(pair(), tmp_path, trouble=trouble, ui=ui)
    assert trouble.modes[2] == ["AUTO", "LAND"]
    assert coded(ui.said, "uav2", "gps-loss")
    assert "in mode LAND" in report.states[2].outcome
    assert "EKF Failsafe" in report.states[2].outcome
    assert report.states[1].outcome == "arrived"


@pytest.mark.full
def test_a_vehicle_whose_gps_comes_back_flies_on(tmp_path: Path) -> None:
    trouble = Trouble(faults=[{"fault": "gps_loss", "vehicles": [2], "at_s": 30.0, "for_s": 4.0}])
    ui = Ui()
    report = fly(pair(), tmp_path, trouble=trouble, ui=ui)
    assert report.all_arrived
    assert len(coded(ui.said, "uav2", "gps-loss")) == 2, "begin and end"


RETURNS = {"policy": {"lost_link": "return", "lost_link_after_s": 10}}


@pytest.mark.autopilots("1.20")
def test_the_configured_lost_link_action_is_not_fought_after_the_link_is_restored(tmp_path: Path) -> None:
    trouble = outage(20.0)
    ui = Ui()
    report = fly(pair(preflight=RETURNS), tmp_path, trouble=trouble, ui=ui)
    assert trouble.modes[2] == ["AUTO", "RTL"]
    assert any(" 10 s" in line for line in coded(ui.said, "uav2", "lost-link"))
    assert report.states[2].phase == "released"
    assert "in mode RTL" in report.states[2].outcome
    assert report.states[1].outcome == "arrived"


@pytest.mark.full
def test_a_vehicle_flies_on_after_a_short_loss_of_its_link(tmp_path: Path) -> None:
    trouble = outage(8.0)
    ui = Ui()
    report = fly(pair(preflight=RETURNS), tmp_path, trouble=trouble, ui=ui)
    assert set(trouble.modes[2]) <= {"AUTO", "GUIDED"}
    assert len(coded(ui.said, "uav2", "lost-link")) == 2, "begin and end"
    assert report.all_arrived


@pytest.mark.full
def test_the_lost_link_action_may_be_to_fly_on(tmp_path: Path) -> None:
    ui = Ui()
    report = fly(pair(), tmp_path, trouble=outage(25.0), ui=ui)
    assert any("mission" in line for line in coded(ui.said, "uav2", "lost-link"))
    assert report.states[2].outcome == "arrived"


def test_a_vehicle_holds_before_the_fence_and_returns_from_beyond_the_fence(tmp_path: Path) -> None:
    trouble = Trouble(wind={"speed_m_s": 25.0, "from_deg": 0.0, "gust_m_s": 0.0})
    scenario = pair(rules={"not_following": None})
    ui = Ui()
    fly(scenario, tmp_path, trouble=trouble, ui=ui)
    holds, returns, *_ = coded(ui.said, "uav1", "fence-ahead")
    assert DemandKind.HOLD in holds
    assert DemandKind.RETURN in returns


@pytest.mark.full
@pytest.mark.parametrize(
    ("sag", "code"),
    [
        ([], "gps-loss"),
        ([0.2], "low-battery"),
    ],
    ids=["nothing else", "its battery"],
)
def test_rules_act_on_a_vehicle_without_position_messages(
    sag: list[float], code: str, tmp_path: Path
) -> None:
    trouble = sagging(sag[0]) if sag else Trouble()
    position = mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT.to_bytes(3, "little")

    def loses(_fleet: Fleet, frame: bytes) -> bool:
        """Lose the second vehicle's positions after 30 s, as of a PX4 without a position."""
        is_late = asyncio.get_running_loop().time() > 30.0
        return is_late and frame[5:6] == b"\x02" and frame[7:10] == position

    trouble.loses = loses
    ui = Ui()
    report = fly(pair(), tmp_path, trouble=trouble, ui=ui)
    assert trouble.modes[2] == ["AUTO", "RTL"]
    assert any(DemandKind.RETURN in line for line in coded(ui.said, "uav2", code))
    assert report.states[2].outcome.endswith("; disarmed")
    assert report.states[1].outcome == "arrived"
