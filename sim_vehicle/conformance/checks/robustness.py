"""Robustness against garbage, malformed frames and floods."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import frames, parameters, plans
from sim_vehicle.conformance.assertions import equal, holds, result_name
from sim_vehicle.conformance.guard import SIMULATOR
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.traffic import SECOND_STATION
from sim_vehicle.conformance.vehicle import VehicleUnderTest
from sim_vehicle.station.frames import STATION

REQUEST = mavlink.MAV_CMD_REQUEST_MESSAGE
VERSION = mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION
UNKNOWN_ID = 60_000
N_REQUESTS = 200
ANSWER_S = 10.0  # longest time to the first answer after a flood


def _require_answer(vehicle: VehicleUnderTest) -> None:
    equal(result_name(vehicle.command(REQUEST, VERSION)), "ACCEPTED", "a command afterwards")


def _request(vehicle: VehicleUnderTest) -> bytes:
    return vehicle.sender.pack(vehicle.command_long(REQUEST, VERSION))


def _random_bytes(length: int, seed: int) -> bytes:
    return np.random.default_rng(seed).bytes(length)


def _survives(build: Callable[[VehicleUnderTest], bytes]) -> Callable[[VehicleUnderTest], str]:
    """Return a check: the vehicle receives the built bytes and must still answer."""

    def run(vehicle: VehicleUnderTest) -> str:
        sent = build(vehicle)
        vehicle.send_raw(sent)
        vehicle.wait(0.3)
        _require_answer(vehicle)
        return f"{len(sent)} bytes"

    return run


_GARBAGE: tuple[tuple[str, str, Callable[[VehicleUnderTest], bytes]], ...] = (
    ("random_bytes", "random bytes", lambda _: _random_bytes(1000, 1)),
    ("zeros", "zero bytes", lambda _: bytes(400)),
    ("start_bytes", "a row of start bytes", lambda _: b"\xfd" * 500),
    ("text", "text on the link", lambda _: b"\r\n\r\nnsh> help\r\n" * 20),
    ("bad_checksum", "a frame with a wrong checksum",
     lambda vehicle: frames.with_bad_crc(vehicle, vehicle.command_long(REQUEST, VERSION))),
    ("unknown_message", "a message with an unknown id",
     lambda vehicle: frames.frame(vehicle, UNKNOWN_ID, bytes(range(30)), 0)),
    ("longest_frame", "an unknown message with 255 bytes of payload",
     lambda vehicle: frames.frame(vehicle, UNKNOWN_ID, bytes(255), 0)),
)  # fmt: skip
for _name, _description, _build in _GARBAGE:
    _function = _survives(_build)
    _function.__doc__ = f"The vehicle still answers after {_description}."
    check(f"robustness.garbage.{_name}")(_function)


@check("robustness.garbage.half_a_frame")
def half_a_frame(vehicle: VehicleUnderTest) -> str:
    """The vehicle still answers after a truncated frame; the next frames may be lost."""
    vehicle.send_raw(_request(vehicle)[:20])
    vehicle.wait(0.3)
    for attempt in range(4):
        mark = vehicle.mark()
        vehicle.send_raw(_request(vehicle))
        if vehicle.wait_for("COMMAND_ACK", within_s=1.0, mark=mark) is not None:
            return f"answered frame {attempt + 1}"
    _require_answer(vehicle)
    return "answered later"


@check("robustness.garbage.around_a_frame")
def around_a_frame(vehicle: VehicleUnderTest) -> str:
    """A frame between other bytes is processed."""
    mark = vehicle.mark()
    vehicle.send_raw(b"hello" + _request(vehicle) + b"\r\nworld")
    vehicle.expect("COMMAND_ACK", mark=mark)
    return "answered"


@check("robustness.garbage.twenty_kilobytes", limit_s=60)
def twenty_kilobytes(vehicle: VehicleUnderTest) -> str:
    """The vehicle sends heartbeats and answers after twenty kilobytes of random bytes."""
    for seed in range(20):
        vehicle.send_raw(_random_bytes(1000, 100 + seed))
        vehicle.wait(0.05)
    mark = vehicle.wait(3.0)
    holds(len(vehicle.since(mark, "HEARTBEAT")) >= 2, "heartbeats stopped")
    _require_answer(vehicle)
    return "20 kB"


@check("robustness.frame.bad_checksum_is_not_obeyed")
def bad_checksum(vehicle: VehicleUnderTest) -> str:
    """A command with a wrong checksum is not acknowledged."""
    mark = vehicle.mark()
    vehicle.send_raw(frames.with_bad_crc(vehicle, vehicle.command_long(REQUEST, VERSION)))
    vehicle.expect_none("COMMAND_ACK", during_s=1.5, mark=mark)
    return "ignored"


@check("robustness.frame.two_at_once")
def two_at_once(vehicle: VehicleUnderTest) -> str:
    """Two frames sent at once are both processed."""
    mark = vehicle.mark()
    vehicle.send_raw(_request(vehicle) + _request(vehicle))
    vehicle.wait(1.0)
    equal(len(vehicle.since(mark, "COMMAND_ACK")), 2, "acknowledgements")
    return "2"


@check("robustness.frame.in_pieces")
def in_pieces(vehicle: VehicleUnderTest) -> str:
    """A frame in three pieces is reassembled."""
    vehicle.heartbeats_off = True  # a heartbeat between the pieces would break the frame
    data, mark = _request(vehicle), vehicle.mark()
    for piece in (data[:5], data[5:17], data[17:]):
        vehicle.send_raw(piece)
        vehicle.wait(0.1)
    vehicle.expect("COMMAND_ACK", mark=mark)
    return "reassembled"


@check("robustness.frame.mavlink1")
def mavlink1(vehicle: VehicleUnderTest) -> str:
    """A MAVLink 1 frame is processed."""
    codec = vehicle.sender.codec()
    data = bytes(vehicle.command_long(REQUEST, VERSION).pack(codec, force_mavlink1=True))
    codec.seq = (codec.seq + 1) % 256
    mark = vehicle.mark()
    vehicle.send_raw(data)
    vehicle.expect("COMMAND_ACK", mark=mark)
    vehicle.wait(0.5)
    _require_answer(vehicle)
    return "answered"


@check("robustness.frame.untrimmed")
def untrimmed(vehicle: VehicleUnderTest) -> str:
    """A payload with its trailing zeros is processed."""
    message = vehicle.command_long(REQUEST, VERSION)
    mark = vehicle.mark()
    vehicle.send_raw(frames.untrimmed(vehicle, message, message.crc_extra))
    vehicle.expect("COMMAND_ACK", mark=mark)
    return "answered"


@check("robustness.frame.later_version")
def later_version(vehicle: VehicleUnderTest) -> str:
    """A message with the additional fields of a later version is processed."""
    message = vehicle.command_long(REQUEST, VERSION)
    payload = vehicle.sender.pack(message)[10:-2].ljust(message.unpacker.size, b"\0") + b"\x07\x08"
    mark = vehicle.mark()
    vehicle.send_raw(frames.frame(vehicle, message.id, payload, message.crc_extra))
    vehicle.expect("COMMAND_ACK", mark=mark)
    return "answered"


@check("robustness.frame.incompatible_flag")
def incompatible_flag(vehicle: VehicleUnderTest) -> str:
    """A frame with an unknown incompatibility flag is not answered, as the specification demands."""
    message = vehicle.command_long(REQUEST, VERSION)
    payload = vehicle.sender.pack(message)[10:-2]
    mark = vehicle.mark()
    vehicle.send_raw(frames.frame(vehicle, message.id, payload, message.crc_extra, incompatible=0x40))
    vehicle.expect_none("COMMAND_ACK", during_s=1.5, mark=mark)
    _require_answer(vehicle)
    return "dropped"


@check("robustness.frame.compatible_flag")
def compatible_flag(vehicle: VehicleUnderTest) -> str:
    """A frame with an unknown compatibility flag is processed."""
    message = vehicle.command_long(REQUEST, VERSION)
    payload = vehicle.sender.pack(message)[10:-2]
    mark = vehicle.mark()
    vehicle.send_raw(frames.frame(vehicle, message.id, payload, message.crc_extra, compatible=0x40))
    vehicle.expect("COMMAND_ACK", mark=mark)
    return "answered"


@check("robustness.frame.sequence_gap")
def sequence_gap(vehicle: VehicleUnderTest) -> str:
    """The vehicle still answers after a gap in the station's sequence numbers, as after losses."""
    codec = vehicle.sender.codec()
    codec.seq = (codec.seq + 100) % 256
    _require_answer(vehicle)
    return "answered"


@check("robustness.names.without_end")
def names_without_end(vehicle: VehicleUnderTest) -> str:
    """The vehicle still answers after a parameter name of 16 unreadable bytes."""
    message = mavlink.MAVLink_param_request_read_message(*vehicle.target, b"\xff\xfe\x01" * 5 + b"\x80", -1)
    vehicle.send(message)
    vehicle.wait(0.3)
    _require_answer(vehicle)
    return "answered"


# -- floods ----------------------------------------------------------------------------------------------


def _answer_after_flood(vehicle: VehicleUnderTest, mark: int) -> str:
    began_s = vehicle.now
    while vehicle.now - began_s < ANSWER_S:
        request_mark = vehicle.mark()
        vehicle.send(vehicle.command_long(REQUEST, VERSION))
        if vehicle.wait_for("AUTOPILOT_VERSION", within_s=2.0, mark=request_mark) is not None:
            break
    else:
        holds(False, f"no answer within {ANSWER_S:g} s")
    heartbeats_s = [entry.at_s for entry in vehicle.received[mark:] if entry.kind == "HEARTBEAT"]
    gap_s = max((b - a for a, b in pairwise(heartbeats_s)), default=0.0)
    holds(gap_s < 3.0, f"no heartbeat for {gap_s:.1f} s")
    return f"answered after {vehicle.now - began_s:.2f} s"


@check("robustness.flood.parameter_requests", limit_s=60)
def flood_of_requests(vehicle: VehicleUnderTest) -> str:
    """The vehicle still answers after 200 simultaneous parameter requests."""
    name, mark = next(iter(parameters.listed(vehicle))), vehicle.mark()
    for _ in range(N_REQUESTS):
        vehicle.send(parameters.read_message(vehicle, name))
    return _answer_after_flood(vehicle, mark)


@check("robustness.flood.lists", limit_s=120)
def flood_of_lists(vehicle: VehicleUnderTest) -> str:
    """The vehicle still answers after ten simultaneous requests for the parameter list."""
    mark = vehicle.mark()
    for _ in range(10):
        vehicle.send(mavlink.MAVLink_param_request_list_message(*vehicle.target))
    return _answer_after_flood(vehicle, mark)


@check("robustness.flood.commands", limit_s=60)
def flood_of_commands(vehicle: VehicleUnderTest) -> str:
    """The vehicle still answers after a hundred simultaneous commands."""
    mark = vehicle.mark()
    for _ in range(100):
        vehicle.send(vehicle.command_long(REQUEST, VERSION))
    return _answer_after_flood(vehicle, mark)


@check("robustness.flood.stations", limit_s=60)
def flood_of_stations(vehicle: VehicleUnderTest) -> str:
    """The vehicle still answers after heartbeats of fifty ground stations."""
    beat = mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3)
    mark = vehicle.mark()
    for sysid in range(150, 200):
        vehicle.send(beat, (sysid, 190))
    return _answer_after_flood(vehicle, mark)


@check("robustness.flood.mission_counts", limit_s=60)
def flood_of_counts(vehicle: VehicleUnderTest) -> str:
    """An upload is accepted 12 s after 20 alternating MISSION_COUNT messages of two stations."""
    for number in range(20):
        vehicle.send(plans.count_message(vehicle, 2 + number % 3), SECOND_STATION if number % 2 else STATION)
    vehicle.wait(12.0)
    plans.upload_or_fail(vehicle, plans.sample_plan(vehicle))
    return "ACCEPTED"


@check("endurance.every_message.zeros", needs=[SIMULATOR], limit_s=120)
def every_message_zeros(vehicle: VehicleUnderTest) -> str:
    """The vehicle still answers after messages of most kinds with zeros in the fields."""
    return _every_message(vehicle, bytes)


@check("endurance.every_message.ones", needs=[SIMULATOR], limit_s=120)
def every_message_ones(vehicle: VehicleUnderTest) -> str:
    """The vehicle still answers after messages of most kinds with all bits set (NaN, -1, largest values)."""
    return _every_message(vehicle, lambda size: b"\xff" * size)


@check("endurance.every_message.random", needs=[SIMULATOR], limit_s=120)
def every_message_random(vehicle: VehicleUnderTest) -> str:
    """The vehicle still answers after messages of most kinds with random fields."""
    return _every_message(vehicle, np.random.default_rng(7).bytes)


def _every_message(vehicle: VehicleUnderTest, payload: Callable[[int], bytes]) -> str:
    """Send messages of most kinds with a payload, addressed to the vehicle.

    The `excluded` messages and messages with an `objection` are not sent.
    """
    excluded = {"COMMAND_LONG", "COMMAND_INT", "SETUP_SIGNING", "PARAM_SET", "SET_MODE", "LOG_ERASE"}
    count = 0
    for message_id, message in sorted(mavlink.mavlink_map.items()):
        if message.msgname in excluded or message_id < 0:
            continue
        data = bytearray(payload(message.unpacker.size))
        _address(message, data, vehicle.target)
        sent = frames.frame(vehicle, message_id, bytes(data), message.crc_extra)
        if vehicle.objection(sent) is not None:
            continue
        vehicle.send_raw(sent)
        count += 1
        if count % 40 == 0:
            vehicle.wait(0.2)
    vehicle.wait(10.0)
    _require_answer(vehicle)
    return f"{count} messages"


def _address(message: type, data: bytearray, target: tuple[int, int]) -> None:
    """Write the target into the target fields of a payload."""
    names = message.fieldnames  # type: ignore[attr-defined]
    ordered = message.ordered_fieldnames  # type: ignore[attr-defined]
    offsets = _offsets(message)
    for name, value in zip(("target_system", "target_component"), target, strict=True):
        if name in names:
            data[offsets[ordered.index(name)]] = value


def _offsets(message: type) -> list[int]:
    """Return the offset of each field in the payload [bytes], in the order on the wire."""
    sizes = {"c": 1, "b": 1, "B": 1, "h": 2, "H": 2, "i": 4, "I": 4, "f": 4, "q": 8, "Q": 8, "d": 8, "s": 1}
    formats = message.native_format.decode().removeprefix("<")  # type: ignore[attr-defined]
    lengths = message.array_lengths  # type: ignore[attr-defined]
    offsets, position = [], 0
    for kind, name in zip(formats, message.ordered_fieldnames, strict=True):  # type: ignore[attr-defined]
        offsets.append(position)
        position += sizes[kind] * max(1, lengths[message.ordered_fieldnames.index(name)])  # type: ignore[attr-defined]
    return offsets
