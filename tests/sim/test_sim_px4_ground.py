"""PX4 on the ground: modes, arming and its refusals, parameters, streams, answers to commands."""

import struct
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from px4_station import ACCEPTED, DENIED, FAILED, NAN, TEMPORARILY_REJECTED, Px4Station
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import takeoff, waypoint

from sim_vehicle.station.messages import command_long

# -- boot and readiness ----------------------------------------------------------------------------------


def test_px4_boots_into_hold_without_non_mavlink_bytes() -> None:
    station = Px4Station()
    station.wait(1.0)
    assert station.raw[0] == 0xFD
    assert station.mode == "Hold"
    beat = station.heartbeat()
    assert (beat.autopilot, beat.type) == (mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_TYPE_QUADROTOR)
    assert beat.base_mode == 29  # auto, stabilized, guided, custom
    assert beat.system_status == mavlink.MAV_STATE_STANDBY
    voltage_mv = station.of("SYS_STATUS")[-1].voltage_battery
    assert voltage_mv == pytest.approx(16_200, abs=200)  # four cells


@pytest.mark.autopilots("2 PX4 otherwise", of="px4")
def test_arming_is_temporarily_rejected_for_36_to_38_seconds() -> None:
    station = Px4Station(ready_s=None)
    station.wait(36.0)
    assert not station.prearm_ok
    assert station.of("HOME_POSITION") == []
    assert station.arm() == TEMPORARILY_REJECTED
    assert "Preflight Fail: No valid global position estimate" in station.texts()
    assert any(text.startswith("Arming denied: Resolve") for text in station.texts())
    station.wait(2.0)
    assert station.prearm_ok
    assert station.of("HOME_POSITION") != []
    assert station.arm() == ACCEPTED
    assert "Armed by external command" in station.texts()


@pytest.mark.autopilots("2 PX4 otherwise", "MAVSDK 5 telemetry", of="px4")
def test_streams_flow_without_a_request() -> None:
    station = Px4Station()
    station.wait(2.0)
    before = len(station.received)
    station.wait(10.0)
    names = [m.get_type() for m in station.received[before:]]
    for name, expected in {
        "HEARTBEAT": 10,
        "GLOBAL_POSITION_INT": 50,
        "ATTITUDE": 150,
        "ATTITUDE_QUATERNION": 100,
        "VFR_HUD": 40,
        "SYS_STATUS": 10,
        "GPS_RAW_INT": 10,
        "LOCAL_POSITION_NED": 10,
        "EXTENDED_SYS_STATE": 10,
        "HOME_POSITION": 5,
        "BATTERY_STATUS": 5,
        "ESTIMATOR_STATUS": 5,
        "MISSION_CURRENT": 10,
        "ALTITUDE": 10,
    }.items():
        assert names.count(name) == pytest.approx(expected, abs=1), name


@pytest.mark.autopilots("1.19", of="px4")
def test_messages_that_the_dialect_lacks_are_decoded_with_their_system_id() -> None:
    station = Px4Station()
    station.wait(10.0)
    codec = mavlink.MAVLink(None)
    codec.robust_parsing = True
    phantoms = [m for m in codec.parse_buffer(station.raw) or () if m.get_type().startswith("UNKNOWN_")]
    assert {m.get_type() for m in phantoms} == {"UNKNOWN_380", "UNKNOWN_411", "UNKNOWN_436"}
    assert {(m.get_srcSystem(), m.get_seq()) for m in phantoms} == {(0, 0)}
    own = ("TIME_ESTIMATE_TO_TARGET", "CURRENT_EVENT_SEQUENCE", "CURRENT_MODE")
    assert {m.get_srcSystem() for name in own for m in station.of(name)} == {1}
    assert len([m for m in station.received if m.get_type() in own]) == len(phantoms)


def test_the_answer_to_a_ping_is_not_answered() -> None:
    replies = Px4Station().send(mavlink.MAVLink_ping_message(123_456, 7, 1, 1))
    assert [m for m in replies if m.get_type() == "PING"] == []


def test_data_streams_are_unsupported() -> None:
    station = Px4Station()
    station.wait(2.0)
    station.send(mavlink.MAVLink_request_data_stream_message(1, 1, mavlink.MAV_DATA_STREAM_ALL, 10, 1))
    station.wait(1.0)
    assert station.of("SCALED_IMU2") == []


# -- modes -----------------------------------------------------------------------------------------------


def test_acro_may_be_chosen_on_the_ground() -> None:
    station = Px4Station()
    assert station.set_mode("Acro") == ACCEPTED
    assert station.mode == "Acro"


def test_auto_without_a_sub_mode_is_mission_and_an_unknown_sub_mode_is_rejected() -> None:
    station = Px4Station()
    assert station.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4) == ACCEPTED
    assert station.mode == "Mission"
    assert station.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 7) == TEMPORARILY_REJECTED
    assert "Unsupported auto mode" in station.texts()


def test_standard_modes() -> None:
    station = Px4Station()
    assert (
        station.command(mavlink.MAV_CMD_DO_SET_STANDARD_MODE, mavlink.MAV_STANDARD_MODE_MISSION) == ACCEPTED
    )
    assert station.mode == "Mission"
    assert station.command(mavlink.MAV_CMD_DO_SET_STANDARD_MODE, mavlink.MAV_STANDARD_MODE_CRUISE) == FAILED


# -- arming ----------------------------------------------------------------------------------------------


def test_a_negative_com_disarm_prflt_prevents_disarming() -> None:
    station = Px4Station(params={"COM_DISARM_PRFLT": -1.0})
    assert station.arm() == ACCEPTED
    station.wait(60.0)
    assert station.armed


@pytest.mark.parametrize(
    ("mode", "reason"),
    [
        ("Return", "Mode not suitable for takeoff"),
        ("Land", "Mode not suitable for takeoff"),
        ("Follow Target", "Mode not suitable for takeoff"),
        ("Position", "No manual control input"),
        ("Offboard", "No offboard signal"),
        ("Mission", "No valid mission available"),
    ],
)
def test_arming_is_refused_in_some_modes(mode: str, reason: str) -> None:
    station = Px4Station()
    assert station.set_mode(mode) == ACCEPTED
    assert station.arm() == TEMPORARILY_REJECTED
    assert f"Preflight Fail: {reason}" in station.texts()
    assert not station.prearm_ok


def test_a_watched_ground_station_is_required_for_arming() -> None:
    station = Px4Station(params={"NAV_DLL_ACT": 2})
    assert station.arm() == TEMPORARILY_REJECTED
    station.beat()
    assert station.arm() == ACCEPTED


# -- answers to commands ---------------------------------------------------------------------------------


def test_messages_on_request() -> None:
    station = Px4Station(ready_s=None)
    assert station.command(mavlink.MAV_CMD_GET_HOME_POSITION) == DENIED
    assert station.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_HOME_POSITION) == DENIED
    assert station.command(mavlink.MAV_CMD_REQUEST_MESSAGE, 60_000) == DENIED
    assert station.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 60_000, 1e5) == FAILED
    version = station.ask(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
    assert version.flight_sw_version == 0x010F02FF
    assert version.capabilities & mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
    assert bytes(version.uid2).startswith(b"sim_vehicle")
    assert station.ask(mavlink.MAVLINK_MSG_ID_FLIGHT_INFORMATION).flight_uuid == 0


def test_home_is_set_by_command() -> None:
    station = Px4Station(ready_s=None)
    set_home = mavlink.MAV_CMD_DO_SET_HOME
    assert station.command(set_home, 1) == TEMPORARILY_REJECTED
    station.wait(40.0)
    assert station.command(set_home, 1) == ACCEPTED
    assert station.command(set_home, 0, 0, 0, 0, NAN, NAN, NAN) == DENIED
    assert station.command(set_home, 0, 0, 0, 0, 46.05, 14.51, 312.0) == ACCEPTED
    home = station.ask(mavlink.MAVLINK_MSG_ID_HOME_POSITION)
    assert (home.latitude, home.altitude) == (pytest.approx(460_500_000, abs=50), 312_000)
    station.set_parameter("COM_HOME_EN", 0)
    assert station.command(set_home, 1) == DENIED


def test_calibration_progress_is_reported_in_texts() -> None:
    station = Px4Station()
    assert station.command(mavlink.MAV_CMD_PREFLIGHT_CALIBRATION, 1) == ACCEPTED
    assert station.texts()[-2:] == ["[cal] calibration started: 2 gyro", "[cal] calibration done: gyro"]
    assert station.arm() == ACCEPTED
    assert station.command(mavlink.MAV_CMD_PREFLIGHT_CALIBRATION, 1) == TEMPORARILY_REJECTED


# -- parameters ------------------------------------------------------------------------------------------


@settings(max_examples=examples(30))
@given(st.integers(-(2**31), 2**31 - 1))
def test_every_integer_is_stored_exactly(number: int) -> None:
    station = Px4Station()
    before = len(station.raw)
    wire = struct.pack("<i", number)
    message = mavlink.MAVLink_param_set_message(1, 1, b"COM_FLTMODE1", 0.0, mavlink.MAV_PARAM_TYPE_INT32)
    # The value is the first field of the payload; a float variable would not keep every pattern.
    payload = wire + bytes(message.pack(station.codec)[14:-2])
    station.send_bytes(message._pack(station.codec, message.crc_extra, payload))
    assert wire.rstrip(b"\0") in station.raw[before:]


def test_the_list_begins_with_a_hash_that_changes_with_the_values() -> None:
    station = Px4Station()
    replies = station.send(mavlink.MAVLink_param_request_list_message(1, 1))
    values = [m for m in replies if m.get_type() == "PARAM_VALUE"]
    assert (values[0].param_id, values[0].param_type) == ("_HASH_CHECK", mavlink.MAV_PARAM_TYPE_UINT32)
    assert [m.param_index for m in values[1:]] == list(range(values[0].param_count))
    station.set_parameter("MIS_TAKEOFF_ALT", 7.5)
    replies = station.send(mavlink.MAVLink_param_request_read_message(1, 1, b"_HASH_CHECK", -1))
    assert replies[0].param_value != values[0].param_value


def test_mission_start_arms_and_needs_a_mission() -> None:
    station = Px4Station()
    assert station.command(mavlink.MAV_CMD_MISSION_START) == DENIED
    assert "Mission start denied! No valid mission" in station.texts()
    station.upload_and_wait([takeoff(), waypoint(30, 0)])
    assert station.command(mavlink.MAV_CMD_MISSION_START) == ACCEPTED
    assert station.armed
    assert "Armed by mission start" in station.texts()
    station.until(lambda: station.height_m > 15, 60)


@pytest.mark.autopilots("MAVSDK 3 replace mid-flight", of="px4")
def test_right_after_an_upload_the_mission_is_not_available() -> None:
    station = Px4Station()
    station.fly(15)
    assert station.upload([waypoint(30, 0), waypoint(0, 0)]) == 0
    assert station.set_mode("Mission") == TEMPORARILY_REJECTED
    assert "Switching to Mission is currently not available" in station.texts()
    assert station.command(mavlink.MAV_CMD_MISSION_START) == DENIED
    station.wait(0.8)
    assert station.set_mode("Mission") == ACCEPTED


def test_a_mission_without_the_required_landing_is_kept_and_not_flown() -> None:
    station = Px4Station(params={"MIS_TKO_LAND_REQ": 2})
    station.upload_and_wait([takeoff(), waypoint(30, 0)])
    assert "Mission rejected: Landing waypoint/pattern required." in station.texts()
    assert station.command(mavlink.MAV_CMD_MISSION_START) == DENIED
    assert len(station.download()) == 2


def test_a_mission_with_a_distant_start_is_kept_and_not_flown() -> None:
    station = Px4Station()
    without_position = {**takeoff(), "x": 0, "y": 0}  # latitude 0 and longitude 0, not the current position
    station.upload_and_wait([without_position, waypoint(30, 0)])
    assert any(text.startswith("First waypoint too far away: ") for text in station.texts())
    assert station.command(mavlink.MAV_CMD_MISSION_START) == DENIED
    station.set_parameter("MIS_DIST_1WP", 0.0)
    station.upload_and_wait([without_position, waypoint(40, 0)])
    assert station.command(mavlink.MAV_CMD_MISSION_START) == ACCEPTED


def _listed(station: Px4Station) -> list[Any]:
    """Request the parameter list; return the PARAM_VALUE messages that come at once."""
    before = len(station.of("PARAM_VALUE"))
    station.send(mavlink.MAVLink_param_request_list_message(1, 1))
    return station.of("PARAM_VALUE")[before:]


def _with_a_full_link() -> tuple[Px4Station, int]:
    """Return a station whose last list has not ended, as its link is full, and the length of a whole list."""
    station = Px4Station()
    whole = len(_listed(station))
    assert any(len(_listed(station)) < whole for _ in range(100))
    return station, whole


def test_the_list_ends_when_a_ground_station_sends_the_hash() -> None:
    station, whole = _with_a_full_link()
    hash_value = struct.unpack("<f", struct.pack("<I", 0x1234))[0]
    station.send(
        mavlink.MAVLink_param_set_message(1, 1, b"_HASH_CHECK", hash_value, mavlink.MAV_PARAM_TYPE_UINT32)
    )
    before = len(station.of("PARAM_VALUE"))
    station.wait(2.0)
    assert len(station.of("PARAM_VALUE")) == before
    assert len(_listed(station)) == whole  # the next list is a new one


def test_a_repeated_list_has_no_hash() -> None:
    station, _ = _with_a_full_link()
    before = len(station.of("PARAM_VALUE"))
    station.send(mavlink.MAVLink_param_request_list_message(1, 1))
    station.wait(2.0)
    again = station.of("PARAM_VALUE")[before:]
    assert [m.param_index for m in again] == list(range(again[0].param_count))


def _to(target: tuple[int, int], name: str) -> Any:
    """Return a message with a visible effect, to a system and component."""
    here = (mavlink.MAV_FRAME_LOCAL_NED, 0x0DF8, 0, 0, -5, *[0.0] * 8)
    messages = {
        "set": lambda: mavlink.MAVLink_param_set_message(*target, b"MIS_TAKEOFF_ALT", 9.0, 9),
        "read": lambda: mavlink.MAVLink_param_request_read_message(*target, b"MIS_TAKEOFF_ALT", -1),
        "list": lambda: mavlink.MAVLink_param_request_list_message(*target),
        "origin": lambda: mavlink.MAVLink_set_gps_global_origin_message(
            target[0], 460_000_000, 140_000_000, 0
        ),
        "setpoint": lambda: mavlink.MAVLink_set_position_target_local_ned_message(0, *target, *here),
    }
    return messages[name]()


def _obeys(target: tuple[int, int], name: str) -> bool:
    """Return True if PX4 obeys a message to this system and component."""
    station = Px4Station()
    station.wait(1.0)
    origin = station.ask(mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN)
    replies = station.send(_to(target, name))
    if name == "origin":
        return bool(station.of("GPS_GLOBAL_ORIGIN")[-1].latitude != origin.latitude)
    if name == "setpoint":
        return station.set_mode("Offboard") == ACCEPTED and station.arm() == ACCEPTED
    return bool([m for m in replies if m.get_type() == "PARAM_VALUE"])


@pytest.mark.parametrize(
    ("name", "systems"),
    [("set", (1,)), ("read", (1,)), ("list", (1,)), ("origin", (1,)), ("setpoint", (0, 1))],
)
def test_px4_obeys_only_setpoints_among_messages_to_all_systems(name: str, systems: tuple[int, ...]) -> None:
    for system in (0, 1, 9):
        assert _obeys((system, 0), name) == _obeys((system, 1), name) == (system in systems)
        if name != "origin":  # the message has no target component
            assert not _obeys((system, 77), name)


@pytest.mark.parametrize("target", [(0, 77), (1, 0), (1, 77)])
def test_px4_answers_a_capability_request_to_any_target(target: tuple[int, int]) -> None:
    station = Px4Station()
    replies = station.send(command_long(target, mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, 1))
    assert [m.get_type() for m in replies if m.get_type() == "AUTOPILOT_VERSION"] == ["AUTOPILOT_VERSION"]
