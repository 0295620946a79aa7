"""Readiness, arming, modes, commands and parameters."""

from collections.abc import Callable

import pytest
from px4_station import DENIED, FAILED, TEMPORARILY_REJECTED, UNSUPPORTED, QuietPx4Station
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import VEHICLE, Station, home_item, scenario, waypoint

from sim_vehicle.fleet import Fleet


@pytest.mark.autopilots("1.3", "1.7")
@pytest.mark.parametrize(
    ("age_s", "mode", "text"),
    [
        (5, "GUIDED", "Arm: Need Position Estimate"),
        pytest.param(
            40, "GUIDED", "Arm: Need Position Estimate", id="GUIDED just before the position estimate"
        ),
        (5, "STABILIZE", "Arm: AHRS: waiting for home"),
        (42, "BRAKE", "Arm: BRAKE mode not armable"),
        (42, "RTL", "Arm: RTL mode not armable"),
        (42, "LAND", "Arm: LAND mode not armable"),
    ],
)
def test_arming_is_refused_with_the_reason_in_a_text(age_s: float, mode: str, text: str) -> None:
    station = Station(ready_s=41.0)
    station.wait(age_s)
    assert station.set_mode(mode) == 0
    assert station.arm() == FAILED
    assert station.texts()[-1] == text
    assert not station.armed


@pytest.mark.autopilots("1.4")
def test_a_mode_set_right_after_boot_is_acknowledged_and_silently_undone() -> None:
    station = Station(ready_s=41.0)
    station.wait(0.5)
    assert station.set_mode("GUIDED") == 0
    assert station.mode == "GUIDED"
    station.wait(2)
    assert station.mode == "STABILIZE"
    assert station.set_mode("GUIDED") == 0
    station.wait(2)
    assert station.mode == "GUIDED"


def test_an_arducopter_is_a_quadrotor_with_three_cells() -> None:
    station = Station()
    beat = station.heartbeat()
    assert (beat.type, beat.autopilot) == (mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA)
    voltage_mv = station.ask(mavlink.MAVLINK_MSG_ID_SYS_STATUS).voltage_battery
    assert voltage_mv == pytest.approx(12_600, abs=100)


@pytest.mark.autopilots("1.14")
@pytest.mark.autopilots("1.14", of="px4")
@pytest.mark.parametrize("make", [Station, QuietPx4Station])
def test_a_copter_disarmed_by_force_in_flight_falls(make: Callable[[], Station]) -> None:
    station = make()
    station.fly()
    assert station.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 21196) == 0
    assert station.until(lambda: station.height_m == 0, 10) < 4


def test_a_take_off_of_an_armed_copter_needs_guided() -> None:
    station = Station()
    assert station.arm() == 0
    assert station.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 15) == FAILED


def test_a_reposition_outside_of_guided_needs_its_flag() -> None:
    station = Station()
    station.fly()
    assert station.set_mode("BRAKE") == 0
    assert station.command_int(mavlink.MAV_CMD_DO_REPOSITION, 6, 460490000, 145060000, 20) == DENIED


@pytest.mark.parametrize(
    ("make", "command", "params", "result"),
    [
        (Station, mavlink.MAV_CMD_NAV_TAKEOFF, (0, 0, 0, 0, 0, 0, 10), FAILED),  # unarmed
        (Station, mavlink.MAV_CMD_DO_PAUSE_CONTINUE, (0,), FAILED),  # in STABILIZE
        (Station, mavlink.MAV_CMD_DO_CHANGE_SPEED, (1, -1), FAILED),
        (Station, mavlink.MAV_CMD_DO_FENCE_ENABLE, (5,), FAILED),  # neither on nor off
        (Station, mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, (0,), UNSUPPORTED),
        (Station, mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, (2,), UNSUPPORTED),
        (Station, mavlink.MAV_CMD_DO_ORBIT, (10, 2), UNSUPPORTED),
        (Station, mavlink.MAV_CMD_DO_SET_RELAY, (0, 1), UNSUPPORTED),
        (QuietPx4Station, mavlink.MAV_CMD_CONDITION_YAW, (1,), UNSUPPORTED),
        (QuietPx4Station, mavlink.MAV_CMD_DO_MOTOR_TEST, (1,), UNSUPPORTED),
        (QuietPx4Station, mavlink.MAV_CMD_DO_SET_RELAY, (1,), UNSUPPORTED),
        (QuietPx4Station, mavlink.MAV_CMD_DO_ORBIT, (10,), TEMPORARILY_REJECTED),
        (QuietPx4Station, mavlink.MAV_CMD_DO_FLIGHTTERMINATION, (1,), DENIED),
        (QuietPx4Station, mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, (0,), 0),  # no component reboots
        (QuietPx4Station, mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, (2,), DENIED),
        (QuietPx4Station, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, (132, 1e5), 0),  # DISTANCE_SENSOR
        (QuietPx4Station, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, (140, 1e5), FAILED),  # until 1.13
    ],
)
def test_the_answers_to_commands_on_the_ground(
    make: Callable[[], Station], command: int, params: tuple[float, ...], result: int
) -> None:
    assert make().command(command, *params) == result


def test_a_reboot_begins_with_silence() -> None:
    station = Station()
    station.stream(mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT)
    assert station.wait(2) != []
    assert station.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1) == 0
    assert station.wait(1) == []


def test_a_home_set_by_command_stays_when_arming() -> None:
    station = Station()
    assert station.command_int(mavlink.MAV_CMD_DO_SET_HOME, 0, 460600000, 145070000, 250) == 0
    assert station.set_mode("GUIDED") == 0
    assert station.arm() == 0
    assert station.command(mavlink.MAV_CMD_GET_HOME_POSITION) == 0
    home = station.of("HOME_POSITION")[-1]
    assert (home.latitude, home.longitude, home.altitude) == (460600000, 145070000, 250000)


def test_the_identity_marks_a_simulated_vehicle() -> None:
    station = Station(Fleet(scenario(vehicles=[VEHICLE | {"sysid": 7}]), ready_s=0.0), target=7)
    version = station.ask(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
    assert bytes(version.uid2) == b"sim_vehicle" + bytes(6) + b"\x07"
    assert version.flight_sw_version >> 8 == 0x040602
    assert version.capabilities & mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    assert station.command(mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, 1) == 0


@pytest.mark.autopilots("1.16")
def test_the_list_has_every_index_and_a_parameter_by_name_has_none() -> None:
    station = Station()
    listed = station.send(mavlink.MAVLink_param_request_list_message(1, 0))
    assert [m.param_index for m in listed] == list(range(listed[0].param_count))
    (got,) = station.send(mavlink.MAVLink_param_request_read_message(1, 0, b"WPNAV_SPEED", -1))
    assert got.param_value == 1000
    set_to = station.set_parameter("RTL_ALT", 2500)
    assert got.param_index == set_to.param_index == 65_535


@pytest.mark.autopilots("1.10")
def test_a_mission_moves_on_in_auto_while_disarmed() -> None:
    # A waypoint where the vehicle stands is "reached" on the ground.
    station = Station()
    assert station.upload([home_item(), waypoint(0, 0, 0.5), waypoint(100, 0)]) == 0
    assert station.set_mode("AUTO") == 0
    station.wait(1)
    assert [m.seq for m in station.of("MISSION_ITEM_REACHED")] == [1]
    assert "Reached command #1" in station.texts()
    assert not station.armed
