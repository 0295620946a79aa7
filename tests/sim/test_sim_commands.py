"""Readiness, arming, modes, commands and parameters."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import Station, home_item, takeoff, waypoint

PREARM = mavlink.MAV_SYS_STATUS_PREARM_CHECK
FAILED, DENIED, UNSUPPORTED = (
    mavlink.MAV_RESULT_FAILED,
    mavlink.MAV_RESULT_DENIED,
    mavlink.MAV_RESULT_UNSUPPORTED,
)


def prearm_ok(station: Station) -> bool:
    return bool(station.ask(mavlink.MAVLINK_MSG_ID_SYS_STATUS).onboard_control_sensors_health & PREARM)


@pytest.mark.autopilots("1.3", "1.7")
@pytest.mark.parametrize(
    ("age_s", "mode", "text"),
    [
        pytest.param(5, 4, "Arm: Need Position Estimate", id="GUIDED before the GPS fix"),
        pytest.param(40, 4, "Arm: Need Position Estimate", id="GUIDED just before the position estimate"),
        pytest.param(5, 0, "Arm: AHRS: waiting for home", id="STABILIZE before home"),
        pytest.param(42, 3, "Arm: AUTO mode not armable", id="AUTO"),
        pytest.param(42, 17, "Arm: BRAKE mode not armable", id="BRAKE"),
        pytest.param(42, 6, "Arm: RTL mode not armable", id="RTL"),
        pytest.param(42, 9, "Arm: LAND mode not armable", id="LAND"),
    ],
)
def test_arming_is_refused_with_the_reason_in_a_text(age_s: float, mode: int, text: str) -> None:
    station = Station(ready_s=41.0)
    station.wait(age_s)
    assert station.set_mode(mode) == 0
    assert station.arm() == FAILED
    assert station.texts()[-1] == text
    assert not station.armed


@pytest.mark.autopilots("1.3")
def test_readiness_grows_with_the_time_from_boot() -> None:
    station = Station(ready_s=41.0)
    station.wait(3)
    assert station.set_mode(4) == 0
    assert station.ask(mavlink.MAVLINK_MSG_ID_GPS_RAW_INT).fix_type < 3
    assert station.command(mavlink.MAV_CMD_GET_HOME_POSITION) == FAILED
    station.wait(8)
    assert station.ask(mavlink.MAVLINK_MSG_ID_GPS_RAW_INT).fix_type >= 3
    assert station.of("HOME_POSITION") == []
    station.wait(10)
    assert len(station.of("HOME_POSITION")) == 1
    assert not prearm_ok(station)
    assert not station.ask(mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT).flags & mavlink.EKF_POS_HORIZ_ABS
    assert station.set_mode(0) == 0
    assert prearm_ok(station)  # in STABILIZE the bit is independent of a position
    assert station.set_mode(4) == 0
    station.wait(21)
    assert prearm_ok(station)
    assert station.ask(mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT).flags & mavlink.EKF_POS_HORIZ_ABS
    assert station.arm() == 0


@pytest.mark.autopilots("1.4")
def test_a_mode_set_right_after_boot_is_acknowledged_and_silently_undone() -> None:
    station = Station(ready_s=41.0)
    station.wait(0.5)
    assert station.set_mode(4) == 0
    assert station.mode == "GUIDED"
    station.wait(2)
    assert station.mode == "STABILIZE"
    assert station.set_mode(4) == 0
    station.wait(2)
    assert station.mode == "GUIDED"


@pytest.mark.autopilots("1.5")
def test_the_set_mode_message_works_and_is_not_acknowledged() -> None:
    station = Station()
    assert station.send(mavlink.MAVLink_set_mode_message(1, 1, 4)) == []
    assert station.heartbeat().custom_mode == 4


@pytest.mark.autopilots("1.5")
@pytest.mark.parametrize("number", [0, 2, 3, 4, 5, 6, 7, 9, 16, 17])
def test_every_mode_shows_its_number(number: int) -> None:
    station = Station()
    assert station.set_mode(number) == 0
    beat = station.heartbeat()
    assert beat.custom_mode == number
    assert (beat.type, beat.autopilot) == (mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA)
    assert beat.base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED


def test_an_unknown_mode_fails() -> None:
    station = Station()
    assert station.set_mode(99) == FAILED


@pytest.mark.autopilots("1.7", "1.13")
def test_armed_on_the_ground_is_standby_and_idling_disarms() -> None:
    station = Station()
    assert station.set_mode(4) == 0
    assert station.arm() == 0
    beat = station.heartbeat()
    assert beat.system_status == mavlink.MAV_STATE_STANDBY
    assert beat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
    assert station.until(lambda: not station.armed, 20) == pytest.approx(10, abs=0.5)


@pytest.mark.autopilots("1.14")
def test_disarming_in_flight_needs_force_and_then_it_falls() -> None:
    station = Station()
    station.fly()
    assert station.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0) == FAILED
    assert station.armed
    assert station.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 21196) == 0
    assert station.until(lambda: station.height_m == 0, 10) < 4


@pytest.mark.autopilots("1.14")
def test_force_arms_without_a_position() -> None:
    station = Station(ready_s=41.0)
    station.wait(3)
    assert station.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1, 21196) == 0
    assert station.armed


@pytest.mark.autopilots("1.15")
def test_the_target_component_does_not_matter_but_the_system_does() -> None:
    station = Station()
    for component in (0, 77, 190):
        replies = station.send(
            mavlink.MAVLink_command_long_message(1, component, 176, 0, 1, 4, 0, 0, 0, 0, 0)
        )
        assert [m.result for m in replies] == [0]
    assert station.send(mavlink.MAVLink_command_long_message(2, 0, 176, 0, 1, 0, 0, 0, 0, 0, 0)) == []
    replies = station.send(mavlink.MAVLink_command_long_message(0, 0, 176, 0, 1, 0, 0, 0, 0, 0, 0))
    assert [(m.result, m.target_system) for m in replies] == [(0, 255)]


@pytest.mark.autopilots("1.17", "MAVSDK 5 goto_location")
def test_reposition_comes_as_command_int_only() -> None:
    station = Station()
    station.fly()
    assert station.command(mavlink.MAV_CMD_DO_REPOSITION, -1, 1, 0, 0, 46.05, 14.506, 20) == UNSUPPORTED
    assert station.command_int(mavlink.MAV_CMD_DO_REPOSITION, 6, 460500000, 145060000, 20, -1, 1) == 0
    station.until(lambda: station.fleet.truth().lat_deg[0] > 46.0499, 60)
    assert station.set_mode(17) == 0
    assert station.command_int(mavlink.MAV_CMD_DO_REPOSITION, 6, 460490000, 145060000, 20) == DENIED


@pytest.mark.parametrize(
    ("command", "result"),
    [
        pytest.param((31000,), UNSUPPORTED, id="an unknown command"),
        pytest.param((mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 10), FAILED, id="take-off unarmed"),
        pytest.param((mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0), FAILED, id="pause in STABILIZE"),
        pytest.param(
            (mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 141, 1e6), DENIED, id="a stream that is not there"
        ),
        pytest.param((mavlink.MAV_CMD_REQUEST_MESSAGE, 141), FAILED, id="a message that is not there"),
        pytest.param((mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, -1), FAILED, id="no speed"),
        pytest.param((mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, 5), DENIED, id="current item out of range"),
        pytest.param((mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 0), UNSUPPORTED, id="a reboot of nothing"),
    ],
)
def test_commands_that_are_refused(command: tuple[float, ...], result: int) -> None:
    station = Station()
    assert station.command(int(command[0]), *command[1:]) == result


@pytest.mark.autopilots("1.1", "1.2", "1.18")
def test_a_reboot_is_silent_then_boots_again_and_loses_the_streams() -> None:
    station = Station(ready_s=5)
    station.wait(6)
    station.stream(mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT)
    assert station.wait(2) != []
    assert station.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1) == 0
    assert station.wait(1) == []
    station.raw = b""
    kinds = {m.get_type() for m in station.wait(5)}
    assert b"Init ArduCopter V4.6.2" in station.raw
    assert "HEARTBEAT" in kinds
    assert "GLOBAL_POSITION_INT" not in kinds
    assert station.ask(mavlink.MAVLINK_MSG_ID_SYSTEM_TIME).time_boot_ms < 6000
    assert station.set_mode(4) == 0
    assert station.arm() == FAILED


def test_it_does_not_reboot_when_armed() -> None:
    station = Station()
    station.fly()
    assert station.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1) == FAILED


def test_home_can_be_set_and_then_stays_when_arming() -> None:
    station = Station()
    assert station.command_int(mavlink.MAV_CMD_DO_SET_HOME, 0, 460600000, 145070000, 250) == 0
    assert station.set_mode(4) == 0
    assert station.arm() == 0
    assert station.command(mavlink.MAV_CMD_GET_HOME_POSITION) == 0
    home = station.of("HOME_POSITION")[-1]
    assert (home.latitude, home.longitude, home.altitude) == (460600000, 145070000, 250000)


def test_a_position_target_moves_it_in_guided_only() -> None:
    station = Station()
    station.fly()
    target = mavlink.MAVLink_set_position_target_global_int_message(
        0, 1, 0, 6, 0x0FF8, 460493000, 145060000, 25, 0, 0, 0, 0, 0, 0, 0, 0
    )
    assert station.set_mode(17) == 0  # BRAKE
    station.send(target)
    station.wait(15)
    assert station.height_m == pytest.approx(20, abs=0.5)
    assert station.set_mode(4) == 0
    station.send(target)
    station.until(lambda: station.height_m > 24.5, 30)
    station.until(lambda: abs(station.fleet.truth().lat_deg[0] - 46.0493) < 2e-5, 30)


def test_the_identity_marks_a_simulated_vehicle() -> None:
    station = Station()
    version = station.ask(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
    assert bytes(version.uid2) == b"sim_vehicle" + bytes(6) + b"\x01"
    assert version.flight_sw_version >> 8 == 0x040602
    assert version.capabilities & mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    assert station.command(mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, 1) == 0


@pytest.mark.autopilots("1.16")
def test_parameters_are_listed_read_and_set() -> None:
    station = Station()
    listed = station.send(mavlink.MAVLink_param_request_list_message(1, 0))
    assert [m.param_index for m in listed] == list(range(listed[0].param_count))
    values = {m.param_id: m.param_value for m in listed}
    assert (values["WPNAV_SPEED"], values["SYSID_THISMAV"], values["DISARM_DELAY"]) == (1000, 1, 10)
    (got,) = station.send(mavlink.MAVLink_param_request_read_message(1, 0, b"RTL_ALT", -1))
    assert got.param_value == 1500
    (index,) = [m.param_index for m in listed if m.param_id == "RTL_ALT"]
    (by_index,) = station.send(mavlink.MAVLink_param_request_read_message(1, 0, b"", index))
    assert (by_index.param_id, by_index.param_index) == ("RTL_ALT", index)
    (set_to,) = station.send(mavlink.MAVLink_param_set_message(1, 0, b"RTL_ALT", 2500, 9))
    assert set_to.param_value == 2500
    assert got.param_index == set_to.param_index == 65_535  # a request by name gets no index
    assert station.send(mavlink.MAVLink_param_set_message(1, 0, b"NO_SUCH_NAME", 1, 9)) == []
    (kept,) = station.send(mavlink.MAVLink_param_set_message(1, 0, b"SYSID_THISMAV", 9, 9))
    assert kept.param_value == 1


def test_a_speed_parameter_acts() -> None:
    station = Station()
    station.send(mavlink.MAVLink_param_set_message(1, 0, b"WPNAV_SPEED", 300, 9))
    station.fly_mission([takeoff(10), waypoint(300, 0, 10)])
    station.wait(30)
    assert station.fleet.truth().speed_m_s[0] == pytest.approx(3, abs=0.1)


@pytest.mark.autopilots("1.10")
def test_a_mission_moves_on_in_auto_while_disarmed() -> None:
    # A waypoint where the vehicle stands is "reached" on the ground.
    station = Station()
    assert station.upload([home_item(), waypoint(0, 0, 0.5), waypoint(100, 0)]) == 0
    assert station.set_mode(3) == 0
    station.wait(1)
    assert [m.seq for m in station.of("MISSION_ITEM_REACHED")] == [1]
    assert "Reached command #1" in station.texts()
    assert not station.armed
