"""State of a vehicle that its parameters do not show: a fence switched off, and rally points."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import pytest
from flights import Ui, coded, fly, small
from profiles import full_only
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from trouble import Trouble, another_station_sends

from sim_vehicle.fleet import Fleet
from sim_vehicle.vehicle.mission import Item
from swarmctl.core.records import replace
from swarmctl.flight.run import DEFAULT_OPTIONS
from swarmctl.preflight.waivers import Waiver
from swarmctl.report.outcome import FlightReport

pytestmark = pytest.mark.virtual

NEVER = replace(DEFAULT_OPTIONS, launch="never")
FleetAction = Callable[[Fleet], None]


def failing(report: FlightReport) -> dict[tuple[str, str], str]:
    """Return the found values of failed checks, by vehicle and check."""
    return {
        (found.vehicle, found.check): found.finding.found
        for findings in report.checked.values()
        for found in findings
        if not found.finding.ok
    }


def sets_fence_type(fleet: Fleet) -> None:
    real = mavlink.MAV_PARAM_TYPE_REAL32
    another_station_sends(fleet, mavlink.MAVLink_param_set_message(1, 1, b"FENCE_TYPE", 5.0, real))


def switches_off(fleet: Fleet) -> None:
    off = (mavlink.MAV_CMD_DO_FENCE_ENABLE, 0, 0.0, *(0.0,) * 6)
    another_station_sends(fleet, mavlink.MAVLink_command_long_message(1, 1, *off))


def puts_rally_points(fleet: Fleet) -> None:
    here = [round(degrees * 1e7) for degrees in fleet.vehicles[1].body.lat_lon_deg]
    fleet.vehicles[1].home_and_rally.rally.replace(
        [
            Item(mavlink.MAV_CMD_NAV_RALLY_POINT, frame=3, x=here[0] + offset, y=here[1], z=30.0)
            for offset in (900, -900)
        ]
    )


FAR_ABOVE_M = 1000.0


@pytest.mark.parametrize(
    ("at_boot", "action"),
    [({"FENCE_TYPE": 4.0}, sets_fence_type), ({}, switches_off)],
    ids=["FENCE_TYPE", "DO_FENCE_ENABLE 0"],
)
@pytest.mark.autopilots("2 fence use")
def test_a_fence_with_correct_parameters_is_enforced_before_arming(
    at_boot: dict[str, float], action: FleetAction, tmp_path: Path
) -> None:
    seen: list[Fleet] = []
    trouble = Trouble(params=at_boot, actions=[(0.3, action), (0.4, seen.append)])
    report = fly(small(simulate={"count": 1, "ready_s": 1.0}), tmp_path, trouble=trouble, options=NEVER)
    assert failing(report) == {}
    vehicle = seen[0].vehicles[0]
    assert vehicle.params["FENCE_TYPE"] == 5.0
    assert vehicle.fence_watch.enabled
    assert "altitude_max" in vehicle.fence_watch.find(*vehicle.body.lat_lon_deg, FAR_ABOVE_M)


def test_a_fence_that_may_not_be_enforced_keeps_the_vehicle_on_the_ground(tmp_path: Path) -> None:
    command = struct.pack("<H", mavlink.MAV_CMD_DO_FENCE_ENABLE)
    acks = Trouble(loses=lambda _fleet, frame: frame[7:10] == b"\x4d\0\0" and frame[10:12] == command)
    report = fly(small(simulate={"count": 1, "ready_s": 1.0}), tmp_path, trouble=acks)
    assert report.ended == "failed"
    ((which, found),) = failing(report).items()
    assert which == ("uav1", "fence")
    assert "DO_FENCE_ENABLE: no answer" in found
    assert not any(state.launch.armed_seen for state in report.states.values())


def test_a_waived_fence_is_not_changed(tmp_path: Path) -> None:
    seen: list[Fleet] = []
    trouble = Trouble(params={"FENCE_ENABLE": 0.0}, actions=[(0.4, seen.append)])
    scenario = small(simulate={"count": 1, "ready_s": 1.0})
    options = replace(NEVER, waivers=(Waiver("parameters"),))
    report = fly(scenario, tmp_path, trouble=trouble, options=options)
    assert set(failing(report)) == {("uav1", "parameters")}
    assert not seen[0].vehicles[0].fence_watch.enabled


AUTOPILOTS = pytest.mark.parametrize("autopilot", ["ardupilot", *full_only("px4")])


@AUTOPILOTS
def test_rally_points_keep_the_vehicle_on_the_ground(autopilot: str, tmp_path: Path) -> None:
    trouble = Trouble(actions=[(0.3, puts_rally_points)])
    swarm = {"count": 2, "ready_s": 1.0, "autopilot": autopilot}
    report = fly(small(simulate=swarm), tmp_path, trouble=trouble)
    assert failing(report) == {("uav2", "rally"): "2 rally points"}
    (text,) = report.trouble
    assert text.startswith("uav2: rally: ")
    assert "--waive rally:uav2" in text
    assert not any(state.launch.armed_seen for state in report.states.values())


def test_rally_points_may_be_waived(tmp_path: Path) -> None:
    trouble = Trouble(actions=[(0.3, puts_rally_points)])
    scenario = small(simulate={"count": 2, "ready_s": 1.0})
    options, ui = replace(NEVER, waivers=(Waiver("rally", "uav2"),)), Ui()
    report = fly(scenario, tmp_path, trouble=trouble, options=options, ui=ui)
    assert report.trouble == ()
    (line,) = coded(ui.said, "uav2", "waived")
    assert line.startswith("uav2: rally: ")


@AUTOPILOTS
def test_a_vehicle_that_does_not_report_its_rally_points_fails(autopilot: str, tmp_path: Path) -> None:
    """The other facts are still collected."""
    counts = Trouble(loses=lambda _fleet, frame: frame[7:10] == b"\x2c\0\0" and frame[14:15] == b"\x02")
    swarm = {"count": 1, "ready_s": 1.0, "autopilot": autopilot}
    ui = Ui()
    report = fly(small(simulate=swarm), tmp_path, trouble=counts, options=NEVER, ui=ui)
    assert set(failing(report)) == {("uav1", "rally")}
    assert any(line.startswith("uav1") and "rally points" in line for line in ui.said)
