"""The rules of flight, as stories: whole flights in which something goes wrong."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from failsafe_faults import outage, sagging
from flights import Ui, fly, small
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from trouble import Trouble, chooses, play, suffer

from swarmctl.config.scenario import Scenario
from swarmctl.flight import virtual_simulator
from swarmctl.report import record

pytestmark = pytest.mark.virtual


def pair(**sections: object) -> Scenario:
    return small(simulate={"count": 2, "ready_s": 3.0}, **sections)


def test_the_battery_runs_low_and_it_flies_home_while_the_other_flies_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trouble = sagging(0.2)
    report, ui = suffer(trouble, tmp_path, monkeypatch, scenario=pair())
    assert trouble.modes[2] == ["AUTO", "RTL"]
    assert "uav2: battery at 20 %, less than the 25 % of rules.low_battery: it returns" in ui.said
    assert report.states[1].outcome == "arrived"
    assert (report.states[2].phase, report.states[2].vehicle.armed) == ("failed", False)
    assert report.states[2].outcome == "battery at 20 %, less than the 25 % of rules.low_battery; landed"
    assert record.replay(tmp_path / "run.mcap").difference == ""


def test_the_battery_is_all_but_empty_and_it_lands_where_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trouble = sagging(0.05)
    report, ui = suffer(trouble, tmp_path, monkeypatch, scenario=pair())
    assert trouble.modes[2] == ["AUTO", "LAND"]
    assert "uav2: battery at 5 %, less than the 10 % of rules.low_battery: it lands where it is" in ui.said
    assert report.states[2].cell is not None


def test_a_rule_that_is_turned_off_leaves_the_vehicle_to_its_own_failsafe(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trouble = sagging(0.05)
    report, ui = suffer(trouble, tmp_path, monkeypatch, scenario=pair(rules={"low_battery": None}))
    assert trouble.modes[2] == ["AUTO", "RTL"]
    assert not any("rules.low_battery" in text for text in ui.said)
    assert report.states[2].phase == "released"
    assert report.states[2].outcome.startswith("in mode RTL, which nobody here has ordered (it says: ")


@pytest.mark.parametrize("mode", ["LOITER", "RTL", "GUIDED"])
def test_a_pilot_or_another_station_takes_over_and_is_not_fought(
    mode: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A switch of the radio control changes the mode just as a station's command does, and no heartbeat
    tells which it was."""
    trouble = Trouble(deeds=[(30.0, chooses(2, mode)), (120.0, chooses(2, "LAND"))])
    report, ui = suffer(trouble, tmp_path, monkeypatch, scenario=pair())
    assert trouble.modes[2] == ["AUTO", mode, *["LAND"] * (mode == "GUIDED")]  # the others come down before
    assert f"uav2: flying → released (in mode {mode}, which nobody here has ordered; let go)" in ui.said
    assert report.states[2].phase == "released"
    assert report.states[1].outcome == "arrived"


def test_a_pilot_takes_over_from_a_vehicle_that_is_on_its_way_home(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trouble = sagging(0.2)
    trouble.deeds.append((40.0, chooses(2, "LOITER")))
    report, ui = suffer(trouble, tmp_path, monkeypatch, scenario=pair())
    assert trouble.modes[2] == ["AUTO", "RTL", "LOITER"]
    assert "uav2: leaving → released (in mode LOITER, which nobody here has ordered; let go)" in ui.said
    assert report.states[2].phase == "released"


def test_a_storm_blows_them_off_their_routes_and_they_are_called_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trouble = Trouble(wind={"speed_m_s": 25.0, "from_deg": 0.0, "gust_m_s": 0.0})
    report, ui = suffer(trouble, tmp_path, monkeypatch, scenario=pair())
    assert [modes[:2] for modes in trouble.modes.values()] == [["AUTO", "RTL"]] * 2
    for name in ("uav1", "uav2"):
        (told,) = (text for text in ui.said if text.startswith(f"{name}:") and "off its route" in text)
        assert told.endswith("m off its route, expected at most 60 m, for 15 s: it returns")
    assert not any(state.vehicle.armed for state in report.states.values())


@pytest.mark.autopilots("1.20")
def test_it_loses_its_gps_and_its_own_failsafe_is_not_fought(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trouble = Trouble(faults=[{"fault": "gps_loss", "vehicles": [2], "at_s": 30.0}])
    report, ui = suffer(trouble, tmp_path, monkeypatch, scenario=pair())
    assert trouble.modes[2] == ["AUTO", "LAND"]
    assert "uav2: no GPS fix; what it does now is its autopilot's to decide" in ui.said
    assert report.states[2].outcome == (
        "in mode LAND, which nobody here has ordered (it says: EKF Failsafe); let go"
    )
    assert report.states[1].outcome == "arrived"


def test_its_gps_comes_back_before_anything_happens_and_it_flies_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trouble = Trouble(faults=[{"fault": "gps_loss", "vehicles": [2], "at_s": 30.0, "for_s": 4.0}])
    report, ui = suffer(trouble, tmp_path, monkeypatch, scenario=pair())
    assert report.all_arrived
    assert "uav2: gps loss is over" in ui.said


RETURNS = {"policy": {"lost_link": "return", "lost_link_after_s": 10}}


@pytest.mark.autopilots("1.20")
def test_its_link_is_lost_and_it_does_what_was_agreed_and_is_not_fought_when_it_is_heard_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trouble = outage(20.0)
    report, ui = suffer(trouble, tmp_path, monkeypatch, scenario=pair(preflight=RETURNS))
    assert trouble.modes[2] == ["AUTO", "RTL"]
    said = "nothing is heard of it, and no order reaches it; by preflight.policy.lost_link"
    assert f"uav2: {said} after 10 s it returns" in ui.said
    assert report.states[2].phase == "released"
    assert report.states[2].outcome.startswith("in mode RTL, which nobody here has ordered")
    assert report.states[1].outcome == "arrived"


def test_its_link_is_lost_for_a_moment_and_it_flies_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trouble = outage(8.0)
    report, ui = suffer(trouble, tmp_path, monkeypatch, scenario=pair(preflight=RETURNS))
    assert set(trouble.modes[2]) <= {"AUTO", "GUIDED"}
    assert "uav2: lost link is over" in ui.said
    assert report.all_arrived


def test_what_was_agreed_may_be_to_fly_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    report, ui = suffer(outage(25.0), tmp_path, monkeypatch, scenario=pair())
    assert any(
        text.endswith("preflight.policy.lost_link it flies its mission to the end") for text in ui.said
    )
    assert report.states[2].outcome == "arrived"


def test_a_storm_blows_it_towards_the_fence_and_it_holds_before_it_and_returns_from_beyond(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trouble = Trouble(wind={"speed_m_s": 25.0, "from_deg": 0.0, "gust_m_s": 0.0})
    scenario = pair(rules={"not_following": None})
    _, ui = suffer(trouble, tmp_path, monkeypatch, scenario=scenario)
    holds = ui.said.index("uav1: off its route, and about to leave the fence: it holds")
    assert ui.said.index("uav1: outside the fence: it returns") > holds


def silent_of_position(frames: list[tuple[int, bytes]], sysid: int) -> list[tuple[int, bytes]]:
    """Without that vehicle's GLOBAL_POSITION_INT, as from a PX4 that has lost its place."""
    position = mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT
    return [
        (index, frame)
        for index, frame in frames
        if not (frame[5] == sysid and int.from_bytes(frame[7:10], "little") == position)
    ]


@pytest.mark.parametrize(
    ("sag", "said"),
    [
        ([], "no position for 20 s, though its GPS has a fix: where it flies is not known here: it returns"),
        ([0.2], "battery at 20 %, less than the 25 % of rules.low_battery: it returns"),
    ],
    ids=["nothing else", "its battery"],
)
def test_a_vehicle_that_tells_no_position_any_more_is_judged_all_the_same(
    sag: list[float], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trouble = sagging(sag[0]) if sag else Trouble()
    play(trouble, monkeypatch)

    class Blind(virtual_simulator.Fleet):  # type: ignore[misc, name-defined]
        def step(self, now: float) -> Any:
            frames = super().step(now)
            return silent_of_position(frames, 2) if now > 30.0 else frames

    monkeypatch.setattr(virtual_simulator, "Fleet", Blind)
    ui = Ui()
    report = fly(pair(), tmp_path, ui=ui)
    assert trouble.modes[2] == ["AUTO", "RTL"]
    assert f"uav2: {said}" in ui.said
    assert "uav2: it tells no position any more" in ui.said or sag
    assert report.states[2].outcome.endswith("; landed")
    assert report.states[1].outcome == "arrived"
