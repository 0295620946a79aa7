"""Any input: the fleet survives, answers the next valid message, and counts unreadable bytes."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import scenario

from sim_vehicle.fleet import Fleet


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
