"""Codec: bytes to frames and messages, and messages to bytes, by pymavlink's generated dialect.

Received frames are MAVLink 1 or 2, sent frames are MAVLink 2. Layouts:
https://mavlink.io/en/guide/serialization.html
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator
from itertools import islice
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

Message = Any
"""a pymavlink message object; pymavlink is untyped"""

GCS_SYSID = 255
GCS_COMPID = int(mavlink.MAV_COMP_ID_MISSIONPLANNER)

_V1_MAGIC, _V2_MAGIC = 0xFE, 0xFD
_V1_OVERHEAD_BYTES, _V2_OVERHEAD_BYTES = 8, 12
_V1_HEADER_BYTES, _V2_HEADER_BYTES = 6, 10
_SIGNED_FLAG = 0x01
SIGNATURE_BYTES = 13
_LOG_TIME_BYTES = 8
_CRC_EXTRA: dict[int, int] = {msgid: kind.crc_extra for msgid, kind in mavlink.mavlink_map.items()}


class Frame(NamedTuple):
    """One frame with the header fields that decide whether its payload is decoded."""

    data: bytes
    sysid: int
    compid: int
    msgid: int

    @property
    def known(self) -> bool:
        """Return whether the dialect has the message; checksum and header of other frames are unverified."""
        return self.msgid in _CRC_EXTRA

    @property
    def signed(self) -> bool:
        return self.data[0] == _V2_MAGIC and bool(self.data[2] & _SIGNED_FLAG)

    @property
    def from_autopilot(self) -> bool:
        return self.compid == mavlink.MAV_COMP_ID_AUTOPILOT1 and self.known

    @property
    def name(self) -> str:
        """Return the name of the message; empty if the dialect does not have it."""
        return str(mavlink.mavlink_map[self.msgid].msgname) if self.known else ""


class FrameSplitter:
    """Splitter of one byte stream into frames; it never raises.

    Bytes outside of frames are skipped: text that autopilots print at boot, line noise, parts of frames.
    """

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[Frame]:
        """Return the frames completed by `data`, in order. An incomplete frame waits for more bytes."""
        self._buffer += data
        frames: list[Frame] = []
        buffer, at = self._buffer, 0
        while (at := _next_magic(buffer, at)) < len(buffer):
            length = _frame_length(buffer, at)
            if length is None or at + length > len(buffer):
                break
            frame = _frame(bytes(buffer[at : at + length]))
            # The checksum of an unknown message needs its definition.
            is_whole = _has_right_checksum(frame) if frame.known else _may_end_at(buffer, at + length)
            if not is_whole or _unknown_flags(frame):
                # The start byte may be noise, so a good frame may begin inside the rejected bytes.
                at += 1
            else:
                frames.append(frame)
                at += length
        del buffer[:at]
        return frames


def _has_right_checksum(frame: Frame) -> bool:
    data = frame.data
    end = len(data) - (SIGNATURE_BYTES if frame.signed else 0)
    crc = mavlink.x25crc(data[1 : end - 2] + bytes((_CRC_EXTRA[frame.msgid],))).crc
    return bool(crc == data[end - 2] | data[end - 1] << 8)


def _unknown_flags(frame: Frame) -> int:
    """Return the incompatibility flags that forbid the reading of a frame; 0: none."""
    return frame.data[2] & ~_SIGNED_FLAG if frame.data[0] == _V2_MAGIC else 0


def logged_frames(tlog: bytes) -> Iterator[Frame]:
    """Return the known frames of a tlog with right checksums, each after 8 bytes of time."""
    at = _LOG_TIME_BYTES
    while at + _V2_HEADER_BYTES <= len(tlog) and tlog[at] in (_V1_MAGIC, _V2_MAGIC):
        length = _frame_length(tlog, at) or 0
        if at + length > len(tlog):
            return
        frame = _frame(tlog[at : at + length])
        if frame.known and _has_right_checksum(frame):
            yield frame
        at += length + _LOG_TIME_BYTES


def _frame(data: bytes) -> Frame:
    if data[0] == _V2_MAGIC:
        return Frame(data, data[5], data[6], data[7] | data[8] << 8 | data[9] << 16)
    return Frame(data, data[3], data[4], data[5])


def _next_magic(buffer: bytearray, at: int) -> int:
    """Return the index of the next start byte, from `at` on; the length of the buffer if there is none."""
    while at < len(buffer) and buffer[at] not in (_V1_MAGIC, _V2_MAGIC):
        at += 1
    return at


def _frame_length(buffer: bytes | bytearray, at: int) -> int | None:
    """Return the length of the frame that begins at `at`; None while its header is incomplete."""
    if len(buffer) < at + 3:
        return None
    if buffer[at] == _V1_MAGIC:
        return buffer[at + 1] + _V1_OVERHEAD_BYTES
    return buffer[at + 1] + _V2_OVERHEAD_BYTES + (SIGNATURE_BYTES if buffer[at + 2] & _SIGNED_FLAG else 0)


def _may_end_at(buffer: bytearray, end: int) -> bool:
    return end == len(buffer) or buffer[end] in (_V1_MAGIC, _V2_MAGIC)


def decode(frame: Frame) -> Message | None:
    """Return the message of a frame with a right checksum; None for a message that the dialect lacks.

    `MAVLink.decode` would compute the checksum again, and return an unknown message with source system 0, a
    vehicle that does not exist.
    """
    if not frame.known:
        return None
    kind = mavlink.mavlink_map[frame.msgid]
    size = kind.unpacker.size
    # MAVLink 2 cuts trailing zeros, and a later version of the message may be longer.
    values = iter(kind.unpacker.unpack(_payload(frame.data)[:size].ljust(size, b"\0")))
    fields = [next(values) if n == 1 else list(islice(values, n)) for n in kind.lengths]
    message = kind(*[fields[i] for i in kind.orders])
    header = message.get_header()
    header.srcSystem, header.srcComponent = frame.sysid, frame.compid
    message.get_msgbuf().extend(frame.data)
    return message


def _payload(frame: bytes) -> bytes:
    begin = _V2_HEADER_BYTES if frame[0] == _V2_MAGIC else _V1_HEADER_BYTES
    return frame[begin : begin + frame[1]]


def payload(message: Message) -> bytes:
    """Return the payload as received; empty if the message was not received."""
    frame = bytes(message.get_msgbuf() or b"")
    return _payload(frame) if frame else b""


def extension(message: Message, at: int) -> int:
    """Return the unsigned 4-byte field at offset `at` of the payload, for a field that pymavlink lacks.

    A field that was not sent is 0: MAVLink 1 has no extensions, and MAVLink 2 cuts trailing zeros.
    """
    return int.from_bytes(payload(message)[at : at + 4], "little")


class Signature(NamedTuple):
    """Key, link id and timestamp of a signature: https://mavlink.io/en/guide/message_signing.html"""

    key: bytes
    link_id: int
    timestamp: int
    """units of 10 µs since 2015; greater than all earlier timestamps of this link"""


class Encoder:
    """Encoder of one ground station; each channel has its own sequence numbers.

    A receiver counts gaps in the sequence as packet loss. Messages go to single addresses, so each address is
    a channel.
    """

    def __init__(self, sysid: int = GCS_SYSID, compid: int = GCS_COMPID) -> None:
        self._mav = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=compid)
        self._next_seq: dict[Hashable, int] = {}

    def pack(self, message: Message, channel: Hashable, signature: Signature | None = None) -> bytes:
        """Return the frame of a message; unsigned if `signature` is None."""
        signing = self._mav.signing
        signing.sign_outgoing = signature is not None
        if signature is not None:
            signing.secret_key, signing.link_id, signing.timestamp = signature
        self._mav.seq = self._next_seq.get(channel, 0)
        self._next_seq[channel] = (self._mav.seq + 1) % 256
        return bytes(message.pack(self._mav))
