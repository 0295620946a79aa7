"""Flights over radios of one or two kilobytes a second: the requests to a vehicle and their cost."""

from __future__ import annotations

from itertools import count, pairwise

import pytest
from low_bandwidth_bench import FRAME, LowBandwidthBench, route
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.mavlink.telemetry.instruments import read_instruments
from swarmctl.mavlink.telemetry.streams import UNUSED_IDS, Streaming
from swarmctl.preflight.checks.telemetry import MAX_PERIOD_S

BOTH = pytest.mark.parametrize("personality", ["ardupilot", "px4"])
SPARING = Streaming(position_hz=2.0, stops_others=True)
POSITION = 33
INTERVAL = int(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL)


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
def test_a_mission_is_changed_in_flight_over_a_radio_of_one_kilobyte_a_second(personality: str) -> None:
    bench = LowBandwidthBench(personality, 1000.0, SPARING)
    bench.flying(route((0.0, 60.0), (0.0, 120.0), (0.0, 600.0)))
    north_m = FRAME.to_local(*bench.vehicle.body.lat_lon_deg)[1]
    begun_s = bench.now
    new = [(0.0, north_m + 150.0), *((20.0 * i, north_m + 150.0) for i in range(1, 8))]
    done = bench.swap(route(*new, leaves_ahead=True))
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
