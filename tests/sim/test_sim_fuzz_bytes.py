"""Broken frames, and good frames over impaired links."""

import random
from collections.abc import Iterator

import pytest
from fuzz_bench import CRAFT, Bench
from fuzz_values import odd_length, random_message, spoilt_frame
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import scenario

from sim_vehicle.fleet import Fleet

MODEST = settings(max_examples=examples(25))


@pytest.mark.full
@MODEST
@given(seed=st.integers(0, 2**32), cuts=st.lists(st.integers(1, 400), max_size=20))
def test_a_stream_may_be_split_anywhere(seed: int, cuts: list[int]) -> None:
    """Every split of the bytes gives the same answers."""
    whole, dealt = Bench("ardupilot", "copter"), Bench("ardupilot", "copter")
    stream = b"".join(frames(whole, random.Random(seed)))
    whole.put(stream)
    for cut in cuts:
        piece, stream = stream[:cut], stream[cut:]
        dealt.put(piece)
    dealt.put(stream)
    assert dealt.sent() == whole.sent()


def frames(bench: Bench, source: random.Random, count: int = 60) -> Iterator[bytes]:
    """Return frames of all kinds, most of them broken."""
    kinds = list(mavlink.mavlink_map.values())
    for _ in range(count):
        kind = source.choice(kinds)
        while kind.msgname == "SETUP_SIGNING":
            kind = source.choice(kinds)
        if source.random() < 0.2:
            yield odd_length(source.choice((kind.id, 80, 12_345, source.randrange(2**24))), source)
            continue
        frame = bench.frame(random_message(kind, source), mavlink1=kind.id < 256 and source.random() < 0.2)
        yield frame if source.random() < 0.3 else spoilt_frame(frame, source)


@pytest.mark.full
@pytest.mark.parametrize("is_signing", [False, True], ids=["open", "signing"])
@pytest.mark.parametrize(("name", "kind"), CRAFT)
def test_broken_frames(name: str, kind: str, is_signing: bool) -> None:
    source = random.Random(f"{name} {kind}")
    bench = Bench(name, kind)
    bench.fly()
    if is_signing:
        bench.sign()
    for frame in frames(bench, source, 400):
        bench.put(frame, peer=source.choice((0, 1, "noise")))
        if source.random() < 0.2:
            bench.wait(0.1)
    bench.check()


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
