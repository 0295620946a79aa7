"""What must not disturb a vehicle: garbage, strange frames, floods."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import frames, parameters, plans
from sim_vehicle.conformance.guard import SIMULATOR
from sim_vehicle.conformance.peer import SECOND_STATION, Peer
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.words import equal, holds, result_name

REQUEST = mavlink.MAV_CMD_REQUEST_MESSAGE
VERSION = mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION
UNKNOWN_ID = 60_000
STORM = 200
SERVED_S = 10.0  # a vehicle that was flooded has to answer again within that


def _answers(peer: Peer) -> None:
    equal(result_name(peer.command(REQUEST, VERSION)), "ACCEPTED", "a command afterwards")


def _request(peer: Peer) -> bytes:
    return peer.pack(peer.command_long(REQUEST, VERSION))


def _seeded(length: int, seed: int) -> bytes:
    return np.random.default_rng(seed).bytes(length)


def _survives(data: Callable[[Peer], bytes]) -> Callable[[Peer], str]:
    def run(peer: Peer) -> str:
        sent = data(peer)
        peer.send_raw(sent)
        peer.wait(0.3)
        _answers(peer)
        return f"{len(sent)} bytes"

    return run


_GARBAGE: tuple[tuple[str, str, Callable[[Peer], bytes]], ...] = (
    ("random_bytes", "Random bytes are passed over.", lambda _: _seeded(1000, 1)),
    ("zeros", "Zero bytes are passed over.", lambda _: bytes(400)),
    ("start_bytes", "A row of bytes that begin a frame is passed over.", lambda _: b"\xfd" * 500),
    ("text", "Text on the link is passed over.", lambda _: b"\r\n\r\nnsh> help\r\n" * 20),
    ("bad_checksum", "A frame with a wrong checksum is passed over.",
     lambda peer: frames.with_bad_crc(peer, peer.command_long(REQUEST, VERSION))),
    ("unknown_message", "A message id nobody has is passed over.",
     lambda peer: frames.frame(peer, UNKNOWN_ID, bytes(range(30)), 0)),
    ("longest_frame", "A frame of 255 bytes with an unknown id is passed over.",
     lambda peer: frames.frame(peer, UNKNOWN_ID, bytes(255), 0)),
)  # fmt: skip
for _name, _says, _data in _GARBAGE:
    _function = _survives(_data)
    _function.__doc__ = _says
    check(f"robustness.garbage.{_name}")(_function)


@check("robustness.garbage.half_a_frame")
def half_a_frame(peer: Peer) -> str:
    """A frame that breaks off does not swallow more than the next one or two."""
    peer.send_raw(_request(peer)[:20])
    peer.wait(0.3)
    for attempt in range(4):
        mark = peer.mark()
        peer.send_raw(_request(peer))
        if peer.maybe("COMMAND_ACK", within_s=1.0, mark=mark) is not None:
            return f"answered the {attempt + 1}. frame"
    _answers(peer)
    return "answered later"


@check("robustness.garbage.around_a_frame")
def around_a_frame(peer: Peer) -> str:
    """A good frame among other bytes is found."""
    mark = peer.mark()
    peer.send_raw(b"hello" + _request(peer) + b"\r\nworld")
    peer.expect("COMMAND_ACK", mark=mark)
    return "found"


@check("robustness.garbage.much", limit_s=60)
def much(peer: Peer) -> str:
    """Twenty kilobytes of random bytes, and the vehicle is there."""
    for seed in range(20):
        peer.send_raw(_seeded(1000, 100 + seed))
        peer.wait(0.05)
    mark = peer.wait(3.0)
    holds(len(peer.since(mark, "HEARTBEAT")) >= 2, "heartbeats stopped")
    _answers(peer)
    return "20 kB"


@check("robustness.frame.bad_checksum_is_not_obeyed")
def bad_checksum(peer: Peer) -> str:
    """A command with a wrong checksum is neither executed nor answered."""
    mark = peer.mark()
    peer.send_raw(frames.with_bad_crc(peer, peer.command_long(REQUEST, VERSION)))
    peer.none("COMMAND_ACK", during_s=1.5, mark=mark)
    return "ignored"


@check("robustness.frame.two_at_once")
def two_at_once(peer: Peer) -> str:
    """Two frames in one datagram are both taken."""
    mark = peer.mark()
    peer.send_raw(_request(peer) + _request(peer))
    peer.wait(1.0)
    equal(len(peer.since(mark, "COMMAND_ACK")), 2, "acknowledgements")
    return "2"


@check("robustness.frame.in_pieces")
def in_pieces(peer: Peer) -> str:
    """A frame that comes in three pieces is put together."""
    peer.quiet = True  # nothing of ours may come between the pieces
    data, mark = _request(peer), peer.mark()
    for piece in (data[:5], data[5:17], data[17:]):
        peer.send_raw(piece)
        peer.wait(0.1)
    peer.expect("COMMAND_ACK", mark=mark)
    return "put together"


@check("robustness.frame.mavlink1")
def mavlink1(peer: Peer) -> str:
    """A MAVLink 1 frame is understood."""
    codec = peer.codec()
    data = bytes(peer.command_long(REQUEST, VERSION).pack(codec, force_mavlink1=True))
    codec.seq = (codec.seq + 1) % 256
    mark = peer.mark()
    peer.send_raw(data)
    peer.expect("COMMAND_ACK", mark=mark)
    peer.wait(0.5)
    _answers(peer)
    return "answered"


@check("robustness.frame.untrimmed")
def untrimmed(peer: Peer) -> str:
    """A payload with its trailing zeros is taken like the trimmed one."""
    message = peer.command_long(REQUEST, VERSION)
    mark = peer.mark()
    peer.send_raw(frames.untrimmed(peer, message, message.crc_extra))
    peer.expect("COMMAND_ACK", mark=mark)
    return "answered"


@check("robustness.frame.from_the_future")
def from_the_future(peer: Peer) -> str:
    """A message longer than known, with fields of a later version, is taken."""
    message = peer.command_long(REQUEST, VERSION)
    payload = peer.pack(message)[10:-2].ljust(message.unpacker.size, b"\0") + b"\x07\x08"
    mark = peer.mark()
    peer.send_raw(frames.frame(peer, message.id, payload, message.crc_extra))
    peer.expect("COMMAND_ACK", mark=mark)
    return "answered"


@check("robustness.frame.incompatible_flag")
def incompatible_flag(peer: Peer) -> str:
    """A frame with an incompatibility flag nobody knows is dropped, as the specification demands."""
    message = peer.command_long(REQUEST, VERSION)
    payload = peer.pack(message)[10:-2]
    mark = peer.mark()
    peer.send_raw(frames.frame(peer, message.id, payload, message.crc_extra, incompatible=0x40))
    peer.none("COMMAND_ACK", during_s=1.5, mark=mark)
    _answers(peer)
    return "dropped"


@check("robustness.frame.compatible_flag")
def compatible_flag(peer: Peer) -> str:
    """A compatibility flag nobody knows does not matter."""
    message = peer.command_long(REQUEST, VERSION)
    payload = peer.pack(message)[10:-2]
    mark = peer.mark()
    peer.send_raw(frames.frame(peer, message.id, payload, message.crc_extra, compatible=0x40))
    peer.expect("COMMAND_ACK", mark=mark)
    return "answered"


@check("robustness.frame.sequence_gap")
def sequence_gap(peer: Peer) -> str:
    """A jump of our sequence numbers, as after losses, does not matter."""
    codec = peer.codec()
    codec.seq = (codec.seq + 100) % 256
    _answers(peer)
    return "answered"


@check("robustness.names.without_end")
def names_without_end(peer: Peer) -> str:
    """A parameter name of 16 bytes that are no text does no harm."""
    message = mavlink.MAVLink_param_request_read_message(*peer.target, b"\xff\xfe\x01" * 5 + b"\x80", -1)
    peer.send(message)
    peer.wait(0.3)
    _answers(peer)
    return "ignored"


# -- floods ----------------------------------------------------------------------------------------------


def _still_served(peer: Peer, mark: int) -> str:
    began_s = peer.now
    while peer.now - began_s < SERVED_S:
        place = peer.mark()
        peer.send(peer.command_long(REQUEST, VERSION))
        if peer.maybe("AUTOPILOT_VERSION", within_s=2.0, mark=place) is not None:
            break
    else:
        holds(False, f"no answer within {SERVED_S:g} s")
    beats = [entry.at_s for entry in peer.heard[mark:] if entry.kind == "HEARTBEAT"]
    gap_s = max((b - a for a, b in pairwise(beats)), default=0.0)
    holds(gap_s < 3.0, f"no heartbeat for {gap_s:.1f} s")
    return f"answered after {peer.now - began_s:.2f} s"


@check("robustness.flood.parameter_requests", limit_s=60)
def flood_of_requests(peer: Peer) -> str:
    """Two hundred parameter requests at once, and the vehicle still answers."""
    name, mark = next(iter(parameters.listed(peer))), peer.mark()
    for _ in range(STORM):
        peer.send(parameters.read_message(peer, name))
    return _still_served(peer, mark)


@check("robustness.flood.lists", limit_s=120)
def flood_of_lists(peer: Peer) -> str:
    """Ten parameter lists asked for at once."""
    mark = peer.mark()
    for _ in range(10):
        peer.send(mavlink.MAVLink_param_request_list_message(*peer.target))
    return _still_served(peer, mark)


@check("robustness.flood.commands", limit_s=60)
def flood_of_commands(peer: Peer) -> str:
    """A hundred commands at once."""
    mark = peer.mark()
    for _ in range(100):
        peer.send(peer.command_long(REQUEST, VERSION))
    return _still_served(peer, mark)


@check("robustness.flood.stations", limit_s=60)
def flood_of_stations(peer: Peer) -> str:
    """Heartbeats of fifty ground stations."""
    beat = mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3)
    mark = peer.mark()
    for sysid in range(150, 200):
        peer.send(beat, (sysid, 190))
    return _still_served(peer, mark)


@check("robustness.flood.mission_counts", limit_s=60)
def flood_of_counts(peer: Peer) -> str:
    """Announcements of missions by two stations, mixed, and then a clean upload."""
    for number in range(20):
        peer.send(plans.count_message(peer, 2 + number % 3), SECOND_STATION if number % 2 else (255, 190))
    peer.wait(12.0)
    plans.put(peer, plans.sample_plan(peer))
    return "a clean upload is accepted"


@check("endurance.every_message.zeros", needs=[SIMULATOR], limit_s=120)
def every_message_zeros(peer: Peer) -> str:
    """Every message that names its receiver, with nothing but zeros."""
    return _every_message(peer, bytes)


@check("endurance.every_message.ones", needs=[SIMULATOR], limit_s=120)
def every_message_ones(peer: Peer) -> str:
    """Every message that names its receiver, with every bit set: NaN, -1 and the largest numbers."""
    return _every_message(peer, lambda size: b"\xff" * size)


@check("endurance.every_message.random", needs=[SIMULATOR], limit_s=120)
def every_message_random(peer: Peer) -> str:
    """Every message that names its receiver, with random fields."""
    return _every_message(peer, np.random.default_rng(7).bytes)


def _every_message(peer: Peer, payload: Callable[[int], bytes]) -> str:
    """Send each message with a payload, addressed to the vehicle.

    Those that arm or end it are left out, and those that name no receiver: others could hear them.
    """
    left_out = {"COMMAND_LONG", "COMMAND_INT", "SETUP_SIGNING", "PARAM_SET", "SET_MODE", "LOG_ERASE"}
    count = 0
    for message_id, message in sorted(mavlink.mavlink_map.items()):
        if message.msgname in left_out or message_id < 0:
            continue
        data = bytearray(payload(message.unpacker.size))
        _address(message, data, peer.target)
        sent = frames.frame(peer, message_id, bytes(data), message.crc_extra)
        if peer.objection(sent) is not None:
            continue
        peer.send_raw(sent)
        count += 1
        if count % 40 == 0:
            peer.wait(0.2)
    peer.wait(10.0)
    _answers(peer)
    return f"{count} messages"


def _address(message: type, data: bytearray, target: tuple[int, int]) -> None:
    """Write the target into a payload, where the message has one."""
    names = message.fieldnames  # type: ignore[attr-defined]
    ordered = message.ordered_fieldnames  # type: ignore[attr-defined]
    offsets = _offsets(message)
    for name, value in zip(("target_system", "target_component"), target, strict=True):
        if name in names:
            data[offsets[ordered.index(name)]] = value


def _offsets(message: type) -> list[int]:
    sizes = {"c": 1, "b": 1, "B": 1, "h": 2, "H": 2, "i": 4, "I": 4, "f": 4, "q": 8, "Q": 8, "d": 8, "s": 1}
    formats = message.native_format.decode().removeprefix("<")  # type: ignore[attr-defined]
    lengths = message.array_lengths  # type: ignore[attr-defined]
    offsets, at = [], 0
    for kind, name in zip(formats, message.ordered_fieldnames, strict=True):  # type: ignore[attr-defined]
        offsets.append(at)
        at += sizes[kind] * max(1, lengths[message.ordered_fieldnames.index(name)])  # type: ignore[attr-defined]
    return offsets
