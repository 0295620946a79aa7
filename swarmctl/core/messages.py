"""What agents tell each other, and its bytes on the bus.

A message is one version byte and a MessagePack map (msgspec); a field that a later version adds is ignored by
an earlier one, a missing field or another version is refused.
"""

from __future__ import annotations

import msgspec

from swarmctl.core.belief import Observation

VERSION = 1


class ObservationShared(msgspec.Struct, frozen=True, tag="observation"):
    """A UAV has seen something for the first time."""

    sender: int
    observation: Observation


class StateShared(msgspec.Struct, frozen=True, tag="state"):
    """Where a UAV is and what it is doing, about once a second of its own time."""

    sender: int
    time_s: float
    lat_deg: float
    lon_deg: float
    alt_rel_m: float
    phase: str
    n_observed: int
    n_found: int


Message = ObservationShared | StateShared


class BadMessage(ValueError):
    """Bytes from the bus that are no message of ours; says what was found."""


_encoder = msgspec.msgpack.Encoder()
_decoder: msgspec.msgpack.Decoder[Message] = msgspec.msgpack.Decoder(Message)


def encode(message: Message) -> bytes:
    return bytes((VERSION,)) + _encoder.encode(message)


def decode(data: bytes) -> Message:
    """Raises BadMessage; never anything else, whatever the bytes."""
    if not data:
        raise BadMessage("empty payload, expected a version byte and MessagePack")
    if data[0] != VERSION:
        raise BadMessage(f"message version {data[0]}, this program speaks version {VERSION}")
    try:
        return _decoder.decode(memoryview(data)[1:])
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise BadMessage(f"not a message of version {VERSION}: {error}") from error
