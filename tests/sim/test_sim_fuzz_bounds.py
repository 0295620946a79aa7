"""The cost of a message: answers, memory and work stay in proportion to its size."""

from collections.abc import Iterator
from typing import Any

import pytest
from fuzz_bench import CRAFT, Bench
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import LAT_DEG, LON_DEG

from sim_vehicle.station.messages import command_long

STORM = 300
# Limits of long answers on a link, at once and per second, in frames of PARAM_VALUE (the shortest).
AT_ONCE, A_SECOND = 40_000 // 37, 200_000 // 37
PLACE = (round(LAT_DEG * 1e7), round((LON_DEG + 1e-3) * 1e7))


def storm(kind: str) -> Iterator[Any]:
    """Return many messages with a long answer."""
    for i in range(STORM):
        if kind == "parameters":
            yield mavlink.MAVLink_param_request_list_message(1, 1)
        elif kind == "log list":
            yield mavlink.MAVLink_log_request_list_message(1, 1, 0, 65_535)
        elif kind == "log data":
            yield mavlink.MAVLink_log_request_list_message(1, 1, 0, 65_535)
            yield mavlink.MAVLink_log_request_data_message(1, 1, i % 2, 0, 2**32 - 1)
        elif kind == "burst":
            payload = bytes([i % 256, 0, 0, (4, 15)[i % 2], 15, 0, 0, 0]) + bytes(4) + b"@PARAM/param.pck"
            yield mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, payload.ljust(251, b"\0"))
        elif kind == "mission":
            yield mavlink.MAVLink_mission_count_message(1, 1, 65_535, i % 3)


@pytest.mark.parametrize("kind", ["parameters", "log list", "log data", "burst", "mission"])
@pytest.mark.parametrize(("name", "craft"), CRAFT[::2])
def test_repeated_long_answers_are_paced(name: str, craft: str, kind: str) -> None:
    bench = Bench(name, craft)
    for message in [command_long((1, 1), 400, 1), command_long((1, 1), 400, 0)]:  # so that a log exists
        bench.send(message)
        bench.wait(1.0)
    before = len(bench.raw)
    bench.put(b"".join(bench.frame(message) for message in storm(kind)))
    assert len(bench.raw) - before <= AT_ONCE + 4 * STORM
    before = len(bench.raw)
    bench.wait(2.0)
    assert len(bench.raw) - before <= 2.2 * A_SECOND
    bench.wait(8.0)
    before = len(bench.raw)
    bench.wait(2.0)  # the answers end
    assert len(bench.raw) - before <= 2 * 2 * 80
    bench.check()


def test_a_parameter_list_is_complete_during_a_flood() -> None:
    bench = Bench("ardupilot", "copter")
    bench.put(b"".join(bench.frame(message) for message in storm("parameters")))
    bench.wait(2.0)
    values = [m for _, m in bench.received if m.get_type() == "PARAM_VALUE"]
    last = values[-values[0].param_count :]
    assert [m.param_index for m in last] == list(range(values[0].param_count))


@pytest.mark.parametrize(("name", "craft"), CRAFT[::2])
def test_each_message_request_brings_one_message(name: str, craft: str) -> None:
    """Each REQUEST_MESSAGE brings an acknowledgement and its message, at most all modes."""
    bench = Bench(name, craft)
    for number in (*mavlink.mavlink_map, 300, 380, 396, 397, 410, 411, 435, 436):
        before = len(bench.raw)
        bench.send(command_long((1, 1), mavlink.MAV_CMD_REQUEST_MESSAGE, number))
        assert len(bench.raw) - before <= 1 + len(bench.fleet.vehicles[0].personality.modes.by_number)


def test_no_stream_is_faster_than_the_clock() -> None:
    bench = Bench("ardupilot", "copter")
    for number in mavlink.mavlink_map:
        bench.send(command_long((1, 1), mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, 1e-30))
    before = len(bench.raw)
    bench.wait(1.0)
    assert len(bench.raw) - before <= 2 + 20 * 43


def endless(name: str) -> list[tuple[int, int, float, float]]:
    """Return items of hundreds of DO commands with endless jumps back: frame, command, parameters 1 and 2."""
    home = [(3, 16, 0.0, 0.0)] if name == "ardupilot" else []
    frame = 3 if name == "ardupilot" else 2
    speed = [(frame, 178, 1.0, 5.0)] * 500
    start = len(home) + 1
    jumps = [(frame, 177, float(start), 63.0), (frame, 177, float(start), -1.0)]
    return [*home, (3, 22, 0.0, 0.0), *speed, *jumps, (3, 16, 0.0, 0.0)]


@pytest.mark.parametrize(("name", "craft"), [("ardupilot", "plane"), ("px4", "copter")])
def test_a_mission_of_instant_commands_takes_time(name: str, craft: str) -> None:
    bench = Bench(name, craft)
    bench.fly()
    items = endless(name)
    bench.send(mavlink.MAVLink_mission_count_message(1, 1, len(items), 0))
    for seq, (frame, number, param1, param2) in enumerate(items):
        bench.send(
            mavlink.MAVLink_mission_item_int_message(
                1, 1, seq, frame, number, 0, 1, param1, param2, 0, 0, *PLACE, 30.0, 0
            )
        )
    bench.wait(1.0)
    mode = {"ardupilotcopter": (3,), "ardupilotplane": (10,)}.get(name + craft, (4, 4))
    assert bench.command(mavlink.MAV_CMD_DO_SET_MODE, 1, *mode) == 0
    bench.most_frames = 0
    for _ in range(20):
        bench.send(command_long((1, 1), mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, 1, 1))
        bench.send(mavlink.MAVLink_mission_set_current_message(1, 1, 2))
        before = len(bench.raw)
        bench.wait(0.5)
        assert len(bench.raw) - before <= 5 * 4 * 50 + 100
    assert bench.most_frames <= 8
    bench.check()


# -- memory ----------------------------------------------------------------------------------------------


def test_a_stream_without_frame_ends_is_not_stored() -> None:
    bench = Bench("ardupilot", "copter")
    beat = bench.frame(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
    bench.fleet.receive(beat[:5], 0.5, peer="cut")
    for _ in range(200):
        bench.fleet.receive((beat * 30)[5:] + beat[:5], 0.5, peer="cut")
    assert bench.fleet.counters.messages_in == 200 * 30
    assert bench.fleet.waiting_bytes <= 300


def test_ended_peers_are_forgotten() -> None:
    bench = Bench("ardupilot", "copter")
    for peer in range(1000):
        bench.fleet.receive(b"\xfd\xff", 0.5, peer=peer)
        bench.fleet.forget_peer(peer)
    assert bench.fleet.waiting_bytes == 0
