"""Findings of fuzzing, one row each."""

import struct
from typing import Any

import pytest
from fuzz_attacks import cancellation
from fuzz_bench import CRAFT, Bench
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import LAT_DEG, LON_DEG

from sim_vehicle.files.ftp import HEADER

PLACE = (round(LAT_DEG * 1e7), round((LON_DEG + 1e-3) * 1e7))
ATTITUDE = mavlink.MAVLINK_MSG_ID_ATTITUDE
CALIBRATION = mavlink.MAV_CMD_PREFLIGHT_CALIBRATION
ACCEPTED, UNSUPPORTED, IN_PROGRESS, CANCELLED = 0, 3, 5, 6


def upload(bench: Bench, *items: tuple[Any, ...]) -> list[int]:
    """Upload items of (frame, command, parameters 1 to 4, z); return the acknowledgements."""
    replies = bench.send(mavlink.MAVLink_mission_count_message(1, 1, len(items), 0))
    for seq, (frame, command, *parameters, z) in enumerate(items):
        head = (1, 1, seq, frame, command, 0, 1, *parameters)
        replies += bench.send(mavlink.MAVLink_mission_item_int_message(*head, *PLACE, z, 0))
    return [m.type for m in replies if m.get_type() == "MISSION_ACK"]


@pytest.mark.parametrize(("name", "kind"), CRAFT)
def test_a_landing_without_a_landing_mode(name: str, kind: str) -> None:
    bench = Bench(name, kind)
    bench.fly()
    wanted = UNSUPPORTED if (name, kind) == ("ardupilot", "plane") else ACCEPTED
    assert bench.command(mavlink.MAV_CMD_NAV_LAND) == wanted
    bench.check()


@pytest.mark.parametrize(("name", "kind"), CRAFT)
def test_an_interval_beyond_the_range_of_its_message(name: str, kind: str) -> None:
    bench = Bench(name, kind)
    assert bench.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, ATTITUDE, 3.4e38) == ACCEPTED
    bench.command(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, ATTITUDE)
    bench.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_MESSAGE_INTERVAL, ATTITUDE)
    reported = [m.interval_us for _, m in bench.received if m.get_type() == "MESSAGE_INTERVAL"]
    assert reported
    assert set(reported) == {2**31 - 1}


def test_a_negative_count_of_flights() -> None:
    bench = Bench("px4", "copter")
    (value,) = struct.unpack("<f", struct.pack("<i", -(2**31)))
    bench.send(mavlink.MAVLink_param_set_message(1, 1, b"COM_FLIGHT_UUID", value, 6))
    bench.check()


@pytest.mark.parametrize("kind", ["copter", "plane"])
def test_an_extreme_wind(kind: str) -> None:
    bench = Bench("ardupilot", kind)
    bench.fly()
    bench.send(mavlink.MAVLink_param_set_message(1, 1, b"SIM_WIND_SPD", 3.4e38, 9))
    bench.wait(20.0)
    assert bench.fleet.truth().speed_m_s[0] < 250
    bench.check()


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
@pytest.mark.parametrize("parameter", ["RTL_ALT", "WPNAV_SPEED", "SIM_GPS_GLITCH_Z"])
def test_an_uploaded_file_with_nan_parameters(parameter: str, value: float) -> None:
    bench = Bench("ardupilot", "copter")
    body = bytes([4, (len(parameter) - 1) << 4]) + parameter.encode() + struct.pack("<f", value)
    content = struct.pack("<HHH", 0x671B, 1, 6 + len(body)) + body
    for seq, (opcode, data) in enumerate(((6, b"@PARAM/param.pck"), (7, content), (1, b""))):
        payload = HEADER.pack(seq, 0, opcode, len(data), 0, 0, 0) + data
        bench.send(mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, payload.ljust(251, b"\0")))
    replies = bench.send(mavlink.MAVLink_param_request_read_message(1, 1, parameter.encode(), -1))
    usual = bench.fleet.vehicles[0].personality.parameters.defaults[parameter]
    assert [m.param_value for m in replies if m.get_type() == "PARAM_VALUE"] == [usual]
    bench.check()


def test_a_home_at_an_extreme_altitude() -> None:
    bench = Bench("px4", "copter")
    bench.fly()
    items = [(3, 22, 0, 0, 0, 0, 30.0), (2, 179, 0, 0, 0, 0, 3.4e38), (3, 16, 0, 0, 0, 0, 40.0)]
    assert upload(bench, *items) == [ACCEPTED]
    bench.wait(1.0)
    assert bench.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 4) == ACCEPTED
    for _ in range(3):  # each time above the previous one
        bench.send(mavlink.MAVLink_mission_set_current_message(1, 1, 1))
        bench.wait(5.0)
    bench.check()


@pytest.mark.parametrize("at", [3.4e38, -3.4e38, float("nan"), float("inf"), 214.8])
@pytest.mark.parametrize(("name", "kind"), CRAFT)
def test_a_position_outside_the_earth_in_a_legacy_item(name: str, kind: str, at: float) -> None:
    bench = Bench(name, kind)
    bench.send(mavlink.MAVLink_mission_count_message(1, 1, 2, 0))
    for seq in range(2):
        bench.send(mavlink.MAVLink_mission_item_message(1, 1, seq, 3, 22, 0, 1, 0, 0, 0, 0, at, at, 20, 0))
    assert any(m.get_type() == "MISSION_ACK" and m.type != ACCEPTED for _, m in bench.received)
    bench.check()


@pytest.mark.parametrize(("name", "kind"), CRAFT)
def test_a_request_for_the_protocol_version(name: str, kind: str) -> None:
    bench = Bench(name, kind)
    assert bench.command(mavlink.MAV_CMD_REQUEST_PROTOCOL_VERSION, 1) is not None
    bench.check()


# -- COMMAND_CANCEL, which the dialect does not know -------------------------------------------------------


def calibration_results(
    bench: Bench, sysid: int = 1, *, mavlink1: bool = False, spoilt: int = 0
) -> list[int]:
    """Return the results of a calibration with a cancellation after its start."""
    assert bench.command(CALIBRATION, 1) == IN_PROGRESS
    cancel = bytearray(bench.frame(cancellation(sysid, 1, CALIBRATION), mavlink1=mavlink1))
    cancel[-1] ^= spoilt
    messages = [*bench.put(bytes(cancel)), *bench.wait(5.0)]
    acks = [m for m in messages if m.get_type() == "COMMAND_ACK" and m.command == CALIBRATION]
    return [m.result for m in acks if m.result != IN_PROGRESS]


@pytest.mark.parametrize("mavlink1", [False, True])
@pytest.mark.parametrize("is_signing", [False, True])
def test_a_cancelled_command_ends(is_signing: bool, mavlink1: bool) -> None:
    bench = Bench("ardupilot", "copter")
    if is_signing:
        bench.sign()
    # Unsigned messages are not obeyed if signatures are required.
    wanted = ACCEPTED if is_signing and mavlink1 else CANCELLED
    assert calibration_results(bench, mavlink1=mavlink1) == [wanted]


@pytest.mark.parametrize("wrong", [{"spoilt": 1}, {"sysid": 2}], ids=["corrupted", "of another vehicle"])
def test_another_cancellation_is_ignored(wrong: dict[str, int]) -> None:
    assert calibration_results(Bench("ardupilot", "copter"), **wrong) == [ACCEPTED]
