"""Released and lost vehicles: their heartbeats, and the final state of each."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import pytest
from flights import Ui, coded, fly, small
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from recorded import events
from rich.console import Console
from trouble import Trouble, another_station_sends, interrupting, outage, select_mode

from sim_vehicle.fleet import Fleet
from swarmctl.agent.phases import Phase
from swarmctl.config.scenario import Scenario
from swarmctl.flight.run import FlightOptions
from swarmctl.report.flight_table import flight_table
from swarmctl.report.live_rows import live_table, plain_line
from swarmctl.report.pictures import sheet
from swarmctl.report.pictures.scene import MapPicture

pytestmark = pytest.mark.virtual

HEARD_FOR_S = 10
GUARDED: dict[str, Any] = {"policy": {"lost_link": "return", "lost_link_after_s": HEARD_FOR_S}}
"""a vehicle without a station's heartbeat returns by itself after this time"""
LANDS_AT_S = 200.0
"""long after the others have landed"""


def pair(**sections: object) -> Scenario:
    return small(simulate={"count": 2, "ready_s": 3.0}, preflight=GUARDED, **sections)


def taken(*then: tuple[float, str]) -> Trouble:
    """Return a takeover of the second vehicle by a pilot after 30 s, who then selects these modes."""
    return Trouble(actions=[(at_s, select_mode(2, mode)) for at_s, mode in ((30.0, "GUIDED"), *then)])


def test_a_released_vehicle_keeps_its_heartbeats_until_it_lands(tmp_path: Path) -> None:
    trouble = taken((LANDS_AT_S, "LAND"))
    ui = Ui()
    report = fly(pair(), tmp_path, trouble=trouble, ui=ui)
    assert trouble.modes[2] == ["AUTO", "GUIDED", "LAND"]  # not RTL, as without heartbeats
    assert report.ended == "ended"
    assert not report.states[2].vehicle.armed
    assert coded(ui.said, "uav2", "waiting-for-released")
    (final_state,) = (text for text in report.final_states if text.startswith("uav2"))
    assert "in mode LAND" in final_state
    telemetry = events(tmp_path, "TelemetryReceived", "uav2")
    assert max(row["now_s"] for row in telemetry if row["event"]["state"]["armed"]) > LANDS_AT_S


@pytest.mark.full
def test_ctrl_c_sends_no_order_to_a_released_vehicle(tmp_path: Path) -> None:
    trouble = taken((LANDS_AT_S, "LAND"))
    trouble.actions += interrupting(150.0).actions
    ui = Ui()
    report = fly(pair(), tmp_path, trouble=trouble, ui=ui)
    assert report.ended == "stopped"
    assert trouble.modes[2] == ["AUTO", "GUIDED"]
    (final_state,) = (text for text in report.final_states if text.startswith("uav2"))
    assert final_state.endswith("[in-air]")
    assert any("uav2" in text and text.endswith("[released-in-air]") for text in ui.said)
    assert not any("uav2" in text and text.endswith("[stopping]") for text in ui.said)


@pytest.mark.full
def test_the_header_states_the_effect_of_ctrl_c(tmp_path: Path) -> None:
    ui = Ui()
    trouble, scenario = taken((LANDS_AT_S, "LAND")), pair(flight={"altitude_m": 15.0, "on_exit": "land"})
    fly(scenario, tmp_path, trouble=trouble, ui=ui)
    on_ground, in_flight, with_released = dict.fromkeys(view.on_ctrl_c for view in ui.views)
    assert "hold" in in_flight
    assert "land" in in_flight
    assert "released" in with_released
    assert on_ground not in with_released or on_ground == "end"


@pytest.mark.full
def test_a_silent_vehicle_is_shown_as_lost_and_its_loss_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ui, drawn = Ui(), list[MapPicture]()
    monkeypatch.setattr(sheet, "draw_map", lambda path, picture: drawn.append(picture))
    scenario = small(flight={"altitude_m": 15.0, "lost_timeout_s": 40.0})
    report = fly(scenario, tmp_path, trouble=outage(at_s=25.0), ui=ui)
    assert not report.all_arrived
    assert [(track.outcome, track.is_lost) for track in drawn[0].tracks] == [
        ("arrived", False), ("lost", True), ("arrived", False),
    ]  # fmt: skip
    (line,) = coded(ui.said, "uav2", "given-up")
    assert "40 s" in line
    (outcome,) = (v["outcome"] for v in report.summary["vehicles"] if v["name"] == "uav2")
    assert outcome.startswith("lost")
    assert "flying" not in str(list(flight_table(report.summary).at().columns[-1].cells)[1])
    (final_state,) = (text for text in report.final_states if text.startswith("uav2"))
    assert final_state.endswith("[lost-in-air]")
    (phase,) = (v["phase"] for v in report.summary["vehicles"] if v["name"] == "uav2")
    assert phase == "lost"
    rows = [row for view in ui.views for row in view.rows if row.name == "uav2"]
    (at_first, *_), (*_, at_last) = (row for row in rows if row.silence), rows
    for row, silence in ((at_first, "lost"), (at_last, "given up")):
        assert (row.silence, row.phase, row.mode) == (silence, Phase.FLYING, "AUTO")
        assert all(text in plain_line(row) for text in (silence, row.phase, row.mode))
    console = Console(width=120, file=(page := io.StringIO()))
    console.print(live_table(ui.views[-1], 120, 40))
    (shown,) = (text for text in page.getvalue().splitlines() if text.split()[:1] == ["uav2"])
    assert "given up" in shown
    assert "flying" not in shown


def arm_second(fleet: Fleet) -> None:
    """Let another station arm the second vehicle without its pre-arm checks."""
    arm = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
    message = mavlink.MAVLink_command_long_message(2, 1, arm, 0, 1, 21196, 0, 0, 0, 0, 0)
    another_station_sends(fleet, message)


def armed_early() -> Trouble:
    """Return the arming of the second vehicle by another station before the first vehicle is ready."""
    unfit = {"fault": "sensor_unhealthy", "params": {"sensor": "mag"}, "vehicles": [1], "for_s": 15.0}
    return Trouble(faults=[unfit], actions=[(10.0, arm_second)])


@pytest.mark.full
def test_a_vehicle_armed_by_another_station_does_not_keep_the_others_on_the_ground(tmp_path: Path) -> None:
    ui = Ui()
    report = fly(pair(), tmp_path, trouble=armed_early(), ui=ui)
    assert report.ended == "ended"
    assert report.states[1].outcome == "arrived"
    assert (report.states[2].phase, report.states[2].launch.armed_seen) == ("released", False)
    released = f"uav2: {Phase.STANDBY} → {Phase.RELEASED} "
    assert any(line.startswith(released) and "GUIDED" in line for line in ui.said)
    assert any("uav2" in line and line.endswith("[ready]") for line in ui.said)


def test_preflight_fails_for_a_vehicle_that_another_station_has_armed(tmp_path: Path) -> None:
    report = fly(pair(), tmp_path, trouble=armed_early(), options=FlightOptions(launch="never"))
    assert report.ended == "failed"
    assert any(line.startswith("uav2") and "armed" in line for line in report.trouble)
