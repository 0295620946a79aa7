"""Broken frames, and good frames over impaired links."""

import random
from collections.abc import Iterator

import pytest
from fuzz_attacks import ATTACKS, launch
from fuzz_bench import CRAFT, Bench
from fuzz_frames import odd_length, spoilt_frame
from fuzz_values import random_message
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from pymavlink.dialects.v20 import ardupilotmega as mavlink

pytestmark = pytest.mark.full

MODEST = settings(max_examples=examples(25), derandomize=True, deadline=None)
WIRES = (
    "packet_loss:rate=0.3", "burst_loss:rate=0.3", "delay:delay_s=0.5,jitter_s=0.4", "duplication:rate=0.5",
    "reordering:rate=0.5", "corruption:rate=0.5", "bandwidth:rate_bytes_s=2000", "sik_radio",
    "link_outage:at=2,for=1", "one_way:dead=to_vehicle,at=2,for=1", "slow_ack:delay_s=1", "absent_ack",
    "clock_drift:drift_ppm=1000",
)  # fmt: skip


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


@pytest.mark.parametrize("wire", WIRES)
@pytest.mark.parametrize("name", ["ardupilot", "px4"])
def test_broken_frames_and_messages_over_impaired_links(name: str, wire: str) -> None:
    source = random.Random(f"{name} {wire}")
    for_s = "" if "for=" in wire else ("," if ":" in wire else ":") + "for=30"
    bench = Bench(name, "copter", faults=[wire + for_s])
    bench.spoilt = True
    for frame in frames(bench, source, 200):
        bench.put(frame, peer=source.choice((0, 1, "noise")))
        bench.wait(source.choice((0.0, 0.1)))
    launch(bench, ATTACKS["flown_missions"], source)
    launch(bench, ATTACKS["written_files"], source)
    bench.wait(max(0.0, 31.0 - bench.now) + 10.0)
    bench.spoilt = False
    bench.check()
