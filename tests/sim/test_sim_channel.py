"""The impaired link alone: frames in, frames out, and their times."""

import math
from collections import Counter
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scipy import stats

from sim_vehicle.faults.base import VehicleAccess
from sim_vehicle.faults.schedule import Schedule
from sim_vehicle.faults.spec import parse_fault
from sim_vehicle.vehicle.injected_faults import InjectedFaults
from sim_vehicle.wire.channel import Channel, Direction

UP, DOWN = Direction.TO_VEHICLE, Direction.FROM_VEHICLE
WIRE = (
    "packet_loss", "burst_loss", "delay", "duplication", "reordering", "corruption", "bandwidth", "sik_radio",
    "link_outage", "one_way",
)  # fmt: skip


class Wire:
    """A channel with faults; each fault has the form of the command line."""

    def __init__(self, *texts: str, seed: int = 1) -> None:
        self.channel = Channel()
        injected_faults = InjectedFaults(np.random.default_rng(0))
        access = VehicleAccess(lambda: self.channel, injected_faults, lambda _now, _silence_s: None)
        self.schedule = Schedule([parse_fault(text) for text in texts], [1], lambda _: access, seed)
        self.schedule.tick(0.0)

    def carry(
        self, frames: list[bytes], direction: Direction = DOWN, gap_s: float = 0.1
    ) -> list[tuple[bytes, float]]:
        for i, frame in enumerate(frames):
            self.channel.put(direction, frame, i * gap_s)
        return self.channel.take(direction, math.inf)


def numbered(count: int, length: int = 20) -> list[bytes]:
    return [i.to_bytes(4, "big") + bytes(length - 4) for i in range(count)]


def frame_of(message: mavlink.MAVLink_message, seq: int = 0) -> bytes:
    codec = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    codec.seq = seq
    return bytes(message.pack(codec))


def heartbeat() -> bytes:
    return frame_of(mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 0, 3))


def binomial_bounds(count: int, rate: float) -> tuple[float, float]:
    """Return the least and greatest number of losses, with a probability of 1e-6 outside."""
    low, high = stats.binom.interval(1 - 1e-6, count, rate)
    return float(low), float(high)


@pytest.mark.parametrize("rate", [0.02, 0.2, 0.7])
def test_random_loss_has_its_rate_within_binomial_bounds(rate: float) -> None:
    frames = numbered(4000)
    lost = len(frames) - len(Wire(f"packet_loss:rate={rate}").carry(frames))
    low, high = binomial_bounds(len(frames), rate)
    assert low <= lost <= high


def losses_in_a_row(sent: list[bytes], arrived: list[tuple[bytes, float]]) -> list[int]:
    got = {int.from_bytes(frame[:4], "big") for frame, _ in arrived}
    runs, run = [], 0
    for i in range(len(sent)):
        if i in got:
            runs += [run] if run else []
            run = 0
        else:
            run += 1
    return runs


def test_burst_loss_has_its_rate_and_burst_length() -> None:
    frames = numbered(30_000)
    runs = losses_in_a_row(frames, Wire("burst_loss:rate=0.15,burst_frames=6").carry(frames))
    # Lengths are geometric with mean 6 and standard deviation sqrt(30): five standard errors of the mean.
    assert np.mean(runs) == pytest.approx(6.0, abs=5 * math.sqrt(30 / len(runs)))
    # The variance of the share is that of a two-state chain: its frames are correlated over 1 / (p + r).
    correlation = 1 - (1 / 6) / 0.85
    error = math.sqrt(0.15 * 0.85 / len(frames) * (1 + correlation) / (1 - correlation))
    assert sum(runs) / len(frames) == pytest.approx(0.15, abs=5 * error)


@settings(max_examples=examples(40))
@given(
    lengths=st.lists(st.integers(1, 280), max_size=40), seed=st.integers(0, 2**32), gap_s=st.floats(0, 0.5)
)
def test_a_fault_without_losses_passes_every_frame_in_order(
    lengths: list[int], seed: int, gap_s: float
) -> None:
    wire = Wire(
        "packet_loss:rate=0", "burst_loss:rate=0", "duplication:rate=0", "corruption:rate=0",
        "reordering:rate=0", "delay:delay_s=0.4,jitter_s=0.4",
        "bandwidth:rate_bytes_s=1000,buffer_bytes=1000000",
        seed=seed,
    )  # fmt: skip
    frames = [bytes([i]) * length for i, length in enumerate(lengths)]
    arrived = wire.carry(frames, gap_s=gap_s)
    assert [frame for frame, _ in arrived] == frames
    assert all(due_s >= i * gap_s for i, (_, due_s) in enumerate(arrived))


@settings(max_examples=examples(60))
@given(name=st.sampled_from(WIRE), seed=st.integers(0, 2**32), gap_s=st.floats(0, 0.3))
def test_every_link_fault_passes_only_its_input_and_ends_every_delay(
    name: str, seed: int, gap_s: float
) -> None:
    frames = numbered(60, length=40)
    wire = Wire(name, seed=seed)
    arrived = wire.carry(frames, gap_s=gap_s)
    last_s = 60 * gap_s + 60.0
    assert all(due_s <= last_s for _, due_s in arrived)
    assert wire.channel.next_due_s() == math.inf
    if name in ("corruption", "sik_radio"):
        assert all(len(frame) == 40 for frame, _ in arrived)
    else:
        assert not Counter(frame for frame, _ in arrived) - Counter(frames + frames)
    if name not in ("duplication", "reordering", "corruption", "sik_radio"):
        assert [frame for frame, _ in arrived] == sorted(frame for frame, _ in arrived)


@pytest.mark.parametrize("name", WIRE)
def test_equal_seeds_give_equal_bytes_and_times_and_other_seeds_do_not(name: str) -> None:
    frames = numbered(300)
    first, again, other = (Wire(name, seed=seed).carry(frames) for seed in (5, 5, 6))
    assert first == again
    if name not in ("bandwidth", "link_outage", "one_way", "delay"):
        assert first != other


def test_delay_and_jitter_stay_within_their_bounds() -> None:
    arrived = Wire("delay:delay_s=0.5,jitter_s=0.2").carry(numbered(500), gap_s=1.0)
    held = np.array([due_s - i for i, (_, due_s) in enumerate(arrived)])
    assert held.min() >= 0.3
    assert held.max() <= 0.7
    assert np.ptp(held) > 0.35  # it varies over nearly all of that


def test_duplication_has_its_rate() -> None:
    frames = numbered(3000)
    counts = Counter(frame for frame, _ in Wire("duplication:rate=0.3").carry(frames))
    low, high = binomial_bounds(len(frames), 0.3)
    assert set(counts.values()) == {1, 2}
    assert low <= sum(n - 1 for n in counts.values()) <= high


def test_reordering_lets_frames_overtake_and_loses_none() -> None:
    frames = numbered(500)
    arrived = [frame for frame, _ in Wire("reordering:rate=0.2,hold_s=0.5").carry(frames)]
    assert sorted(arrived) == frames
    assert sum(a > b for a, b in pairwise(arrived)) > 30


def test_flipped_bits_are_noticed_by_the_receivers_checksum() -> None:
    sent = [frame_of(mavlink.MAVLink_attitude_message(i, 0.1, 0.2, 0.3, 0, 0, 0)) for i in range(400)]
    arrived = Wire("corruption:rate=1").carry(sent)
    assert all(
        1 <= sum((a ^ b).bit_count() for a, b in zip(frame, good, strict=True)) <= 3
        for (frame, _), good in zip(arrived, sent, strict=True)
    )
    parsed = []
    for frame, _ in arrived:
        receiver = mavlink.MAVLink(None)
        receiver.robust_parsing = True
        parsed += [m for m in receiver.parse_buffer(frame + bytes(300)) or [] if m.get_type() != "BAD_DATA"]
    assert [m for m in parsed if not m.get_type().startswith("UNKNOWN")] == []


def test_a_slow_line_delays_frames_by_their_length_and_drops_those_above_its_buffer() -> None:
    frames = numbered(50, 100)
    arrived = Wire("bandwidth:rate_bytes_s=1000,buffer_bytes=1000").carry(frames, gap_s=0.0)
    assert [frame for frame, _ in arrived] == frames[:10]
    assert [due_s for _, due_s in arrived] == pytest.approx([0.1 * (i + 1) for i in range(10)])


def test_the_other_direction_of_a_fault_is_unimpaired() -> None:
    wire = Wire("packet_loss:rate=1,direction=to_vehicle")
    frames = numbered(20)
    assert [frame for frame, _ in wire.carry(frames, DOWN)] == frames
    assert wire.carry(frames, UP) == []


def test_frames_after_a_delay_fault_do_not_overtake_and_the_channel_is_idle_after_them() -> None:
    wire = Wire("delay:delay_s=2,for=1")
    assert not wire.channel.idle
    wire.channel.put(DOWN, b"held", 0.9)
    wire.schedule.tick(1.0)
    wire.channel.put(DOWN, b"later", 1.1)
    assert wire.channel.take(DOWN, 2.89) == []
    assert not wire.channel.idle
    assert [frame for frame, _ in wire.channel.take(DOWN, 2.9)] == [b"held", b"later"]
    assert wire.channel.idle


# -- the bad SiK radio ------------------------------------------------------------------------------------


def mixed(seconds: int, rate_hz: int = 20) -> list[tuple[bytes, float]]:
    """Return a vehicle's stream: a heartbeat each second, attitudes between."""
    attitude = mavlink.MAVLink_attitude_message(1, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
    out = []
    for i in range(seconds * rate_hz):
        frame = heartbeat() if i % rate_hz == 0 else frame_of(attitude, i % 256)
        out.append((frame, i / rate_hz))
    return out


def test_sik_radio_loses_in_bursts_and_is_late() -> None:
    wire = Wire("sik_radio")
    sent = mixed(300)
    for frame, at_s in sent:
        wire.channel.put(DOWN, frame, at_s)
    arrived = wire.channel.take(DOWN, math.inf)
    assert 0.05 < 1 - len(arrived) / len(sent) < 0.20
    assert [due_s for _, due_s in arrived] == sorted(due_s for _, due_s in arrived)
    sent_at = dict(sent[-256:])
    late = [due_s - sent_at[frame] for frame, due_s in arrived[-200:] if frame in sent_at]
    assert 0.01 < np.median(late) < 0.15


def test_sik_radio_shares_the_air_between_both_directions() -> None:
    alone, shared = Wire("sik_radio:rate=0,spoilt=0,turn_s=0"), Wire("sik_radio:rate=0,spoilt=0,turn_s=0")
    frames = numbered(10, 200)
    shared.carry(numbered(10, 200), UP, gap_s=0.0)
    lone_s = alone.carry(frames, gap_s=0.0)[-1][1]
    shared_s = shared.carry(frames, gap_s=0.0)[-1][1]
    assert lone_s == pytest.approx(10 * 216 * 8 / 57_600)
    assert shared_s == pytest.approx(2 * lone_s)


def test_sik_radio_sends_its_status_to_the_receiver_of_the_heartbeats() -> None:
    wire = Wire("sik_radio:rssi=80,noise=40")
    for second in range(20):
        wire.channel.put(UP, heartbeat(), float(second))
    receiver = mavlink.MAVLink(None)
    reports = [m for frame, _ in wire.channel.take(DOWN, math.inf) for m in receiver.parse_buffer(frame)]
    assert len(reports) == 20
    assert {m.get_type() for m in reports} == {"RADIO_STATUS"}
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in reports} == {(ord("3"), ord("D"))}
    assert [m.get_seq() for m in reports] == list(range(20))
    assert np.mean([m.rssi for m in reports]) == pytest.approx(80, abs=5)
    assert all(m.txbuf == 100 for m in reports)


def test_sik_radio_reports_a_full_buffer() -> None:
    wire = Wire("sik_radio:air_rate_bit_s=2000")
    for i in range(200):
        wire.channel.put(UP, heartbeat() if i % 20 == 0 else numbered(1, 100)[0], i * 0.05)
    receiver = mavlink.MAVLink(None)
    reports = [m for frame, _ in wire.channel.take(DOWN, math.inf) for m in receiver.parse_buffer(frame)]
    assert reports[0].txbuf == 100
    assert reports[-1].txbuf < 10
