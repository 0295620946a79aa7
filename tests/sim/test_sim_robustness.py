"""Any input: the fleet survives, answers the next valid message, and counts unreadable bytes."""

from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import scenario

from sim_vehicle.fleet import Fleet

MODEST = settings(max_examples=examples(40), derandomize=True, deadline=None)
FLUSH = b"\0" * 300  # more than the longest frame: a length byte in garbage may claim what follows


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
@given(st.integers(1, 44), st.binary(min_size=1, max_size=30))
def test_a_truncated_frame_costs_no_more_than_its_announced_length(cut: int, noise: bytes) -> None:
    fleet = Fleet(scenario(), ready_s=0)
    codec = mavlink.MAVLink(None, srcSystem=255)
    frame = mavlink.MAVLink_command_long_message(1, 0, 400, 0, 1, 0, 0, 0, 0, 0, 1).pack(codec)
    fleet.receive(frame[: min(cut, len(frame) - 1)] + noise, 0.5)
    fleet.receive(FLUSH, 1.0)
    assert answers(fleet, 1.0)


def test_unreadable_bytes_are_counted() -> None:
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
