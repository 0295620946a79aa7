"""Flights over radios of one or two kilobytes a second: the requests to a vehicle and their cost."""

from __future__ import annotations

import heapq
from itertools import count, pairwise

import pytest
from flying_bench import BOTH, FlyingBench
from metric_plans import place, plan
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.mavlink.procedures import basic
from swarmctl.mavlink.protocol.conversation import MavlinkPeer
from swarmctl.mavlink.session import Session
from swarmctl.mavlink.telemetry.instruments import read_instruments
from swarmctl.mavlink.telemetry.streams import UNUSED_IDS, Streaming
from swarmctl.preflight.checks.telemetry import MAX_PERIOD_S

SPARING = Streaming(position_hz=2.0, stops_others=True)
POSITION = 33
INTERVAL = int(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL)


class LowBandwidthBench(FlyingBench):
    """A radio with `rate_bytes_s` each way; a datagram that would wait longer than `BUFFER_S` is lost."""

    BUFFER_S = 1.0
    AIR_S = 0.02
    UNUSED_EVERY_S = None

    def __init__(self, personality: str, rate_bytes_s: float, streaming: Streaming | None = None) -> None:
        super().__init__(personality)
        self.session = Session(MavlinkPeer(1), streaming=streaming)
        self.down: list[tuple[float, bytes]] = []
        """time of arrival [s], and the datagram"""
        self.n_lost = 0
        self.rate_bytes_s = rate_bytes_s
        self._free_s = {True: 0.0, False: 0.0}
        self._numbers = count()

    def _post(self, data: bytes, up: bool) -> None:
        begin_s = max(self._free_s[up], self.now)
        if begin_s - self.now > self.BUFFER_S:
            self.n_lost += 1
            return
        self._free_s[up] = begin_s + len(data) / self.rate_bytes_s
        there_s = self._free_s[up] + self.AIR_S
        if not up:
            self.down.append((there_s, data))
        heapq.heappush(self._queue, (there_s, next(self._numbers), up, data))

    def another_streams(self, *ids: int, every_s: float = 0.25) -> None:
        """Request streams for another station, over the same radio."""
        for msgid in ids:
            self.another_commands(INTERVAL, msgid, 1e6 * every_s)

    def bytes_s(self, over_s: float) -> float:
        """Return the vehicle's average data rate over the last `over_s` seconds [bytes/s]."""
        return sum(len(data) for at_s, data in self.down if at_s > self.now - over_s) / over_s


@BOTH
def test_a_low_position_rate_keeps_the_whole_telemetry_small(personality: str) -> None:
    bench = LowBandwidthBench(personality, 1500.0, SPARING).connected()
    bench.run(30.0)
    bench.n_lost = 0
    bench.run(20.0)
    assert bench.bytes_s(20.0) < 300.0
    assert bench.n_lost == 0
    positions = [data for at_s, data in bench.down if at_s > bench.now - 20.0 and data[7] == POSITION]
    assert len(positions) == pytest.approx(40, abs=2)


@BOTH
def test_positions_come_once_a_second_after_a_flight_and_at_full_rate_in_the_next(personality: str) -> None:
    bench = LowBandwidthBench(personality, 20_000.0).uploaded(plan((0.0, 60.0)))
    positions: list[float] = []
    bench.on_datagram = lambda data: positions.append(bench.now) if data[7] == POSITION else None

    def n_in_10_s() -> int:
        bench.run(10.0)
        return sum(at_s > bench.now - 10.0 for at_s in positions)

    n_before = n_in_10_s()
    assert bench.do("launch", basic.launch).failure is None
    assert n_in_10_s() == pytest.approx(n_before, abs=2)
    assert bench.do("land", basic.land).failure is None
    assert bench.run(60.0, lambda: not bench.session.state.armed)
    bench.run(3.0)
    assert n_in_10_s() == pytest.approx(10, abs=1)
    assert bench.do("prepare", basic.prepare).failure is None
    numbers = count()
    bench.block = lambda m: getattr(m, "command", None) == INTERVAL and next(numbers) < 2
    assert bench.do("launch", basic.launch).failure is None
    bench.run(10.0)
    assert next(numbers) > 2
    assert n_in_10_s() == pytest.approx(n_before, abs=2), "the lost requests are not repeated"


@BOTH
def test_a_mission_is_changed_in_flight_over_a_radio_of_one_kilobyte_a_second(personality: str) -> None:
    bench = LowBandwidthBench(personality, 1000.0, SPARING)
    bench.flying(plan((0.0, 60.0), (0.0, 120.0), (0.0, 600.0)))
    north_m = place(bench)[1]
    begun_s = bench.now
    new = [(0.0, north_m + 150.0), *((20.0 * i, north_m + 150.0) for i in range(1, 8))]
    done = bench.swap(plan(*new, leaves_ahead=True))
    assert (done.failure, done.flying, done.stood_still_s) == (None, "new", 0.0)
    assert bench.now - begun_s < 5.0


@BOTH
def test_too_few_positions_before_a_flight_are_reported_with_their_rate(personality: str) -> None:
    """PX4 reduces its rates to a twentieth when its radio is full (`Mavlink::update_rate_mult`)."""
    bench = LowBandwidthBench(personality, 6000.0).connected()
    bench.run(10.0)
    usual_s = bench.do("instruments", read_instruments).position_every_s
    assert usual_s == pytest.approx({"ardupilot": 0.25, "px4": 0.2}[personality], abs=0.06)
    numbers = count()
    bench.block_down = lambda m: m.get_type() == "GLOBAL_POSITION_INT" and next(numbers) % 20 != 0
    bench.run(60.0)
    slow_s = bench.do("instruments", read_instruments).position_every_s
    assert slow_s == pytest.approx(20.0 * usual_s, rel=0.2)
    assert slow_s > MAX_PERIOD_S


def test_a_vehicle_that_reports_no_time_still_reports_its_satellites() -> None:
    bench = LowBandwidthBench("ardupilot", 20_000.0).connected()
    bench.block_down = lambda m: m.get_type() == "SYSTEM_TIME"
    found = bench.do("instruments", read_instruments)
    assert found.unix_s is None
    assert found.gps is not None


@BOTH
def test_every_fast_unneeded_stream_is_stopped_once(personality: str) -> None:
    bench = LowBandwidthBench(personality, 20_000.0, Streaming(stops_others=True)).connected()
    bench.another_streams(mavlink.MAVLINK_MSG_ID_ATTITUDE, mavlink.MAVLINK_MSG_ID_VFR_HUD)
    bench.run(30.0)
    assert bench.do("instruments", read_instruments).gps is not None
    bench.run(30.0)
    stopped = [int(m.param1) for m in bench.of("COMMAND_LONG") if m.command == INTERVAL and m.param2 < 0]
    assert {mavlink.MAVLINK_MSG_ID_ATTITUDE, mavlink.MAVLINK_MSG_ID_VFR_HUD} <= set(stopped) <= UNUSED_IDS
    assert len(stopped) == len(set(stopped))
    times = [now for now, m in bench.sent if m.get_type() == "COMMAND_LONG" and m.param2 < 0]
    assert min(b - a for a, b in pairwise(times)) > 0.15, "the commands fill the radio"


def test_pauses_grow_between_attempts_to_stop_another_stations_stream() -> None:
    bench = LowBandwidthBench("ardupilot", 20_000.0, Streaming(stops_others=True)).connected()
    for _ in range(300):
        bench.another_streams(mavlink.MAVLINK_MSG_ID_ATTITUDE)
        bench.run(1.0)
    times = [now for now, m in bench.sent if m.get_type() == "COMMAND_LONG" and m.param2 < 0]
    assert 3 <= len(times) <= 8
    pauses = [b - a for a, b in pairwise(times)]
    assert pauses == sorted(pauses)


def test_after_a_boot_streams_are_stopped_again() -> None:
    bench = LowBandwidthBench("px4", 20_000.0, Streaming(stops_others=True)).connected()
    bench.run(20.0)
    n_stopped = len(bench.sent)
    bench.inject("reboot:silence_s=1.5")
    bench.run(30.0)
    again = {int(m.param1) for _, m in bench.sent[n_stopped:] if getattr(m, "param2", 0.0) < 0}
    assert mavlink.MAVLINK_MSG_ID_ATTITUDE in again
    assert bench.bytes_s(10.0) < 600.0
