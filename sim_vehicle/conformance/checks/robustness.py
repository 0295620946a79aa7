"""Robustness against garbage, malformed frames and floods; the texts and answers at the end of the run."""

from collections.abc import Callable, Iterable
from itertools import pairwise
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import parameters, plans
from sim_vehicle.conformance.assertions import at_least, at_most, equal
from sim_vehicle.conformance.frames import LONGEST_FRAME, frame
from sim_vehicle.conformance.guard import SIMULATOR
from sim_vehicle.conformance.outcomes import CheckFailed, Skip
from sim_vehicle.conformance.registry import check, checks, row
from sim_vehicle.conformance.traffic import SECOND_STATION
from sim_vehicle.conformance.vehicle import VehicleUnderTest
from sim_vehicle.definitions import layout_of
from sim_vehicle.station.frames import STATION, Source
from sim_vehicle.station.messages import heartbeat

UNKNOWN_ID = 60_000
N_REQUESTS = 200
ANSWER_S = 10.0  # longest time to the first answer after a flood
Build = Callable[[VehicleUnderTest], bytes]


def _request(vehicle: VehicleUnderTest) -> bytes:
    return vehicle.sender.pack(vehicle.version_request())


def _bad_checksum(vehicle: VehicleUnderTest) -> bytes:
    data = bytearray(_request(vehicle))
    data[-1] ^= 0x5A
    return bytes(data)


def _repacked(vehicle: VehicleUnderTest, *, padded: bool = False, added: bytes = b"", **flags: Any) -> bytes:
    """Return a command in a frame with other flags, with its trailing zeros, or with further bytes."""
    message = vehicle.version_request()
    payload = vehicle.sender.pack(message)[10:-2]
    whole = payload.ljust(message.unpacker.size, b"\0") if padded else payload
    return frame(vehicle.sender, message.id, whole + added, message.crc_extra, **flags)


def _unknown(vehicle: VehicleUnderTest, payload: bytes) -> bytes:
    return frame(vehicle.sender, UNKNOWN_ID, payload, 0)


def _random_bytes(length: int, seed: int) -> bytes:
    return np.random.default_rng(seed).bytes(length)


def _survives(vehicle: VehicleUnderTest, build: Build) -> str:
    sent = build(vehicle)
    # The zeros end a frame that the garbage may announce; it would swallow the next commands.
    vehicle.send_raw(sent + bytes(LONGEST_FRAME))
    vehicle.wait(0.3)
    vehicle.expect_answer()
    return f"{len(sent)} bytes"


def _after(what: str) -> str:
    return f"The vehicle still answers after {what}."


checks(
    "robustness", _survives,
    row("garbage.random_bytes", _after("random bytes"), lambda _: _random_bytes(1000, 1)),
    row("garbage.zeros", _after("zero bytes"), lambda _: bytes(400)),
    row("garbage.start_bytes", _after("a row of start bytes"), lambda _: b"\xfd" * 500),
    row("garbage.text", _after("text on the link"), lambda _: b"\r\n\r\nnsh> help\r\n" * 20),
    row("garbage.bad_checksum", _after("a frame with a wrong checksum"), _bad_checksum),
    row("garbage.unknown_message", _after("a message with an unknown id"),
        lambda v: _unknown(v, bytes(range(30)))),
    row("garbage.longest_frame", _after("an unknown message with 255 bytes of payload"),
        lambda v: _unknown(v, bytes(255))),
    row("names.without_end", _after("a parameter name of 16 unreadable bytes"),
        lambda v: v.sender.pack(
            mavlink.MAVLink_param_request_read_message(*v.target, b"\xff\xfe\x01" * 5 + b"\x80", -1))),
)  # fmt: skip


@check("robustness.garbage")
def half_a_frame(vehicle: VehicleUnderTest) -> str:
    """The vehicle still answers after a truncated frame; the next frames may be lost."""
    vehicle.send_raw(_request(vehicle)[:20])
    vehicle.wait(0.3)
    for attempt in range(4):
        vehicle.send_raw(_request(vehicle))
        if vehicle.wait_for("COMMAND_ACK", within_s=1.0) is not None:
            return f"answered frame {attempt + 1}"
    vehicle.expect_answer()
    return "answered later"


@check("robustness.garbage")
def twenty_kilobytes(vehicle: VehicleUnderTest) -> None:
    """The vehicle sends heartbeats and answers after twenty kilobytes of random bytes."""
    for seed in range(20):
        vehicle.send_raw(_random_bytes(1000, 100 + seed))
        vehicle.wait(0.05)
    at_least(len(vehicle.listen("HEARTBEAT", 3.0)), 2, "heartbeats in 3 s")
    vehicle.expect_answer()


def _mavlink1(vehicle: VehicleUnderTest) -> bytes:
    codec = vehicle.sender.codec()
    data = bytes(vehicle.version_request().pack(codec, force_mavlink1=True))
    codec.seq = (codec.seq + 1) % 256
    return data


def _frame_is(vehicle: VehicleUnderTest, build: Build, answered: bool) -> None:
    vehicle.send_raw(build(vehicle))
    if answered:
        vehicle.expect("COMMAND_ACK")
        vehicle.wait(0.5)
    else:
        vehicle.expect_none("COMMAND_ACK", during_s=1.5)
    vehicle.expect_answer()


checks(
    "robustness", _frame_is,
    row("garbage.around_a_frame", "A frame between other bytes is processed.",
        lambda v: b"hello" + _request(v) + b"\r\nworld", True),
    row("frame.bad_checksum_is_not_obeyed", "A command with a wrong checksum is not acknowledged.",
        _bad_checksum, False),
    row("frame.mavlink1", "A MAVLink 1 frame is processed.", _mavlink1, True),
    row("frame.untrimmed", "A payload with its trailing zeros is processed.",
        lambda v: _repacked(v, padded=True), True),
    row("frame.later_version", "A message with the additional fields of a later version is processed.",
        lambda v: _repacked(v, padded=True, added=b"\x07\x08"), True),
    row("frame.incompatible_flag",
        "A frame with an unknown incompatibility flag is not answered, as the specification demands.",
        lambda v: _repacked(v, incompatible=0x40), False),
    row("frame.compatible_flag", "A frame with an unknown compatibility flag is processed.",
        lambda v: _repacked(v, compatible=0x40), True),
)  # fmt: skip


@check("robustness.frame")
def two_at_once(vehicle: VehicleUnderTest) -> str:
    """Two frames sent at once are both processed."""
    vehicle.send_raw(_request(vehicle) + _request(vehicle))
    return str(equal(len(vehicle.listen("COMMAND_ACK", 1.0)), 2, "acknowledgements"))


@check("robustness.frame")
def in_pieces(vehicle: VehicleUnderTest) -> None:
    """A frame in three pieces is reassembled."""
    vehicle.heartbeats_off = True  # a heartbeat between the pieces would break the frame
    data, mark = _request(vehicle), vehicle.mark()
    for piece in (data[:5], data[5:17], data[17:]):
        vehicle.send_raw(piece)
        vehicle.wait(0.1)
    vehicle.expect("COMMAND_ACK", mark=mark)


@check("robustness.frame")
def sequence_gap(vehicle: VehicleUnderTest) -> None:
    """The vehicle still answers after a gap in the station's sequence numbers, as after losses."""
    codec = vehicle.sender.codec()
    codec.seq = (codec.seq + 100) % 256
    vehicle.expect_answer()


def _survives_flood(
    vehicle: VehicleUnderTest, build: Callable[[VehicleUnderTest], Iterable[tuple[Any, Source]]]
) -> str:
    """After many messages at once the vehicle answers soon, and its heartbeats went on."""
    messages, first_mark = list(build(vehicle)), vehicle.mark()
    for message, source in messages:
        vehicle.send(message, source)
    began_s = vehicle.now
    while vehicle.now - began_s < ANSWER_S:
        vehicle.send(vehicle.version_request())
        if vehicle.wait_for("AUTOPILOT_VERSION", within_s=2.0) is not None:
            break
    else:
        raise CheckFailed(f"no answer within {ANSWER_S:g} s")
    beats_s = [entry.at_s for entry in vehicle.received[first_mark:] if entry.kind == "HEARTBEAT"]
    at_most(max((b - a for a, b in pairwise(beats_s)), default=0.0), 3.0, "gap between heartbeats [s]")
    return f"answered after {vehicle.now - began_s:.2f} s"


def _reads(vehicle: VehicleUnderTest) -> list[tuple[Any, Source]]:
    name = next(iter(parameters.listed(vehicle)))
    return [(parameters.read_message(vehicle, name), STATION)] * N_REQUESTS


checks(
    "robustness.flood", _survives_flood,
    row("parameter_requests", _after("200 simultaneous parameter requests"), _reads),
    row("lists", _after("ten simultaneous requests for the parameter list"),
        lambda v: [(mavlink.MAVLink_param_request_list_message(*v.target), STATION)] * 10),
    row("commands", _after("a hundred simultaneous commands"),
        lambda v: [(v.version_request(), STATION)] * 100),
    row("stations", _after("heartbeats of fifty ground stations"),
        lambda _: [(heartbeat(), (sysid, 190)) for sysid in range(150, 200)]),
)  # fmt: skip


@check("robustness.flood")
def mission_counts(vehicle: VehicleUnderTest) -> None:
    """An upload is accepted 12 s after 20 alternating MISSION_COUNT messages of two stations."""
    for number in range(20):
        vehicle.send(plans.count_message(vehicle, 2 + number % 3), SECOND_STATION if number % 2 else STATION)
    vehicle.wait(12.0)
    plans.store_sample(vehicle)


# Messages that could change the vehicle for later checks; messages with an `objection` are not sent either.
_EXCLUDED = frozenset({"COMMAND_LONG", "COMMAND_INT", "SETUP_SIGNING", "PARAM_SET", "SET_MODE", "LOG_ERASE"})


def _survives_messages(vehicle: VehicleUnderTest, payload: Callable[[int], bytes]) -> str:
    """The vehicle answers after messages of most kinds; `payload` returns a payload of a length."""
    count = 0
    for message_id, message in sorted(mavlink.mavlink_map.items()):
        if message.msgname in _EXCLUDED or message_id < 0:
            continue
        data = _addressed(message_id, payload(message.unpacker.size), vehicle.target)
        sent = frame(vehicle.sender, message_id, data, message.crc_extra)
        if vehicle.objection(sent) is not None:
            continue
        vehicle.send_raw(sent)
        count += 1
        if count % 40 == 0:
            vehicle.wait(0.2)
    vehicle.wait(10.0)
    vehicle.expect_answer()
    return f"{count} messages"


def _addressed(message_id: int, payload: bytes, target: tuple[int, int]) -> bytes:
    """Return a payload with the target in its target fields."""
    data, layout = bytearray(payload), layout_of(message_id).dtype
    for name, value in zip(("target_system", "target_component"), target, strict=True):
        if layout.fields and name in layout.fields:
            data[layout.fields[name][1]] = value
    return bytes(data)


_EVERY = "messages of most kinds with"
checks(
    "endurance.every_message",
    _survives_messages,
    row("zeros", _after(f"{_EVERY} zeros in the fields"), bytes),
    row("ones", _after(f"{_EVERY} all bits set (NaN, -1, largest values)"), lambda size: b"\xff" * size),
    row("random", _after(f"{_EVERY} random fields"), lambda size: _random_bytes(size, size)),
    needs=[SIMULATOR],
)


def _texts(vehicle: VehicleUnderTest) -> list[Any]:
    if not vehicle.texts:
        raise Skip("the vehicle sent no texts")
    return vehicle.texts


@check("endurance.texts")
def severities(vehicle: VehicleUnderTest) -> str:
    """Every STATUSTEXT has a MAV_SEVERITY."""
    severities = {message.severity for message in _texts(vehicle)}
    equal(sorted(severities - set(mavlink.enums["MAV_SEVERITY"])), [], "unknown severities")
    return f"{len(vehicle.texts)} texts"


@check("endurance.texts")
def are_readable(vehicle: VehicleUnderTest) -> str:
    """Every STATUSTEXT is printable, apart from tabs; PX4 also sends a mere tab."""
    texts = [message.text for message in _texts(vehicle)]
    equal([text for text in texts if not text.replace("\t", " ").isprintable()], [], "unreadable texts")
    return f"{len(vehicle.texts)} texts"


@check("endurance")
def still_answers(vehicle: VehicleUnderTest) -> str:
    """At the end of the run the vehicle sends a heartbeat and AUTOPILOT_VERSION."""
    vehicle.expect("HEARTBEAT", within_s=3.0)
    vehicle.request("AUTOPILOT_VERSION")
    return f"mode {vehicle.mode}"
