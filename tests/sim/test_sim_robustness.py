"""Whatever comes in, the fleet survives, answers the next good message, and counts what it could not read."""

import math
import random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import Station, scenario

from sim_vehicle.fleet import Fleet

MODEST = settings(max_examples=40, derandomize=True, deadline=None)
FLUSH = b"\0" * 300  # more than the longest frame: a length byte in garbage may claim what follows
TAKEN = (
    "COMMAND_LONG",
    "COMMAND_INT",
    "SET_MODE",
    "PARAM_REQUEST_LIST",
    "PARAM_REQUEST_READ",
    "PARAM_SET",
    "REQUEST_DATA_STREAM",
    "TIMESYNC",
    "HEARTBEAT",
    "MISSION_SET_CURRENT",
    "SET_POSITION_TARGET_GLOBAL_INT",
    "MISSION_COUNT",
    "MISSION_ITEM_INT",
    "MISSION_ITEM",
    "MISSION_WRITE_PARTIAL_LIST",
    "MISSION_REQUEST_LIST",
    "MISSION_REQUEST_PARTIAL_LIST",
    "MISSION_REQUEST_INT",
    "MISSION_REQUEST",
    "MISSION_CLEAR_ALL",
)
COMMANDS = (
    16,
    17,
    19,
    20,
    21,
    22,
    112,
    176,
    177,
    178,
    179,
    192,
    193,
    224,
    300,
    400,
    410,
    511,
    512,
    520,
    31000,
)
NASTY = (0.0, 1.0, -1.0, 2.0, 4.0, 21196.0, 1e9, -1e9, 3e38, -3e38, math.nan, math.inf, -math.inf)


def answers(fleet: Fleet, now: float) -> bool:
    codec = mavlink.MAVLink(None, srcSystem=255)
    ping = mavlink.MAVLink_timesync_message(0, 4711).pack(codec)
    decoder = mavlink.MAVLink(None)
    decoder.robust_parsing = True
    frames = b"".join(frame for _, frame in fleet.receive(ping, now))
    return any(
        m.get_type() == "TIMESYNC" and m.ts1 == 4711 for m in decoder.parse_buffer(frames) or ()
    )  # fmt: skip


@MODEST
@given(st.lists(st.binary(max_size=80), max_size=20))
def test_random_bytes_are_survived(chunks: list[bytes]) -> None:
    fleet = Fleet(scenario(), ready_s=0)
    for i, chunk in enumerate(chunks):
        fleet.receive(chunk, 0.1 * i)
    fleet.receive(FLUSH, 5.0)
    assert answers(fleet, 5.0)
    assert fleet.counters.bytes_in >= sum(map(len, chunks))


@MODEST
@given(st.integers(1, 44), st.binary(min_size=1, max_size=30))
def test_a_truncated_frame_costs_no_more_than_what_it_claims(cut: int, noise: bytes) -> None:
    fleet = Fleet(scenario(), ready_s=0)
    codec = mavlink.MAVLink(None, srcSystem=255)
    frame = mavlink.MAVLink_command_long_message(1, 0, 400, 0, 1, 0, 0, 0, 0, 0, 1).pack(codec)
    fleet.receive(frame[: min(cut, len(frame) - 1)] + noise, 0.5)
    fleet.receive(FLUSH, 1.0)
    assert answers(fleet, 1.0)


def message_values(kind: str, source: random.Random) -> list[Any]:
    """Random values for every field of a message, often on the edge of the type."""
    message_class = next(c for c in mavlink.mavlink_map.values() if c.msgname == kind)
    values: list[Any] = []
    for name, of_type in zip(message_class.fieldnames, message_class.fieldtypes, strict=True):
        if name == "target_system":
            values.append(source.choice((0, 1)))
        elif name == "command":
            values.append(source.choice(COMMANDS))
        elif name == "mission_type":
            values.append(source.choice((0, 0, 0, 1, 255)))
        elif name == "custom_mode":
            values.append(source.choice((0, 3, 4, 5, 6, 9, 17, 2**32 - 1)))
        elif name in ("seq", "count", "start_index", "end_index"):
            values.append(source.choice((0, 1, 2, 3)))
        elif of_type == "float":
            values.append(source.choice(NASTY))
        elif of_type == "char":
            values.append(source.choice((b"WPNAV_SPEED", b"SIM_BATT_VOLTAGE", b"LAND_SPEED", b"\xff\xfe")))
        else:
            bits = int(of_type.removesuffix("_t").lstrip("uint"))
            low, high = (
                (0, 2**bits - 1) if of_type.startswith("u") else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
            )
            values.append(source.choice((low, high, 0, 1, 3, 6, source.randint(low, high))))
    return values


@pytest.mark.parametrize("seed", range(12))
def test_well_formed_nonsense_is_survived_on_the_ground_and_in_the_air(seed: int) -> None:
    source = random.Random(seed)
    station = Station()
    if seed % 2:
        station.fly(5)
    station.send(mavlink.MAVLink_request_data_stream_message(1, 0, 0, 4, 1))
    for _ in range(120):
        kind = source.choice(TAKEN)
        constructor = getattr(mavlink, f"MAVLink_{kind.lower()}_message")
        station.send(constructor(*message_values(kind, source)))
        station.wait(source.choice((0.0, 0.1, 2.0)))
    truth = station.fleet.truth()
    assert math.isfinite(truth.lat_deg[0])
    assert math.isfinite(truth.height_m[0])


def test_what_cannot_be_read_is_counted() -> None:
    fleet = Fleet(scenario(), ready_s=0)
    codec = mavlink.MAVLink(None, srcSystem=255)
    good = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3).pack(codec)
    bad_crc = good[:-1] + bytes([good[-1] ^ 0xFF])
    unknown = b"\xfd\x01\x00\x00\x00\xff\xbe\x34\x30\x00\x07\x00\x00"
    fleet.receive(b"hello" + good, 0.0)
    fleet.receive(bad_crc, 0.0)
    fleet.receive(unknown + good, 0.0)
    assert fleet.counters.messages_in == 2
    assert fleet.counters.unknown_messages == 1
    assert fleet.counters.bad_data >= 2


def test_streams_of_two_peers_do_not_mix() -> None:
    fleet = Fleet(scenario(), ready_s=0)
    codec = mavlink.MAVLink(None, srcSystem=255)
    frame = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3).pack(codec)
    fleet.receive(frame[:9], 0.0, peer="a")
    fleet.receive(frame, 0.0, peer="b")
    fleet.receive(frame[9:], 0.0, peer="a")
    assert fleet.counters.messages_in == 2
    assert fleet.counters.bad_data == 0


def test_a_legacy_mavlink_1_command_is_obeyed() -> None:
    fleet = Fleet(scenario(), ready_s=0)
    codec = mavlink.MAVLink(None, srcSystem=255)
    frame = mavlink.MAVLink_command_long_message(1, 0, 176, 0, 1, 4, 0, 0, 0, 0, 0).pack(
        codec, force_mavlink1=True
    )
    fleet.receive(frame, 0.0)
    assert fleet.truth().mode == ("GUIDED",)
