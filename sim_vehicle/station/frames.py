"""Frames between ground stations and vehicles."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.definitions import HEADER_BYTES, MAVLINK2, decoded

Source = tuple[int, int]  # (system id, component id)

STATION: Source = (255, mavlink.MAV_COMP_ID_MISSIONPLANNER)
NOISE = "BAD_DATA"  # kind of bytes outside of valid frames


@dataclass(frozen=True, slots=True)
class ReceivedFrame:
    """A received frame: arrival time [s], name of the message, decoded message, bytes."""

    at_s: float
    kind: str
    message: Any
    raw: bytes

    @property
    def seq(self) -> int:
        return self.raw[4 if self.raw[0] == MAVLINK2 else 2]

    @property
    def sysid(self) -> int:
        return self.raw[5 if self.raw[0] == MAVLINK2 else 3]

    @property
    def component(self) -> int:
        return self.raw[6 if self.raw[0] == MAVLINK2 else 4]

    @property
    def payload(self) -> bytes:
        start = HEADER_BYTES[self.raw[0]]
        return self.raw[start : start + self.raw[1]]


class Sender:
    """The encoders of one or several ground stations, each with its own frame numbers."""

    def __init__(self) -> None:
        self._codecs: dict[Source, mavlink.MAVLink] = {}

    def codec(self, source: Source = STATION) -> mavlink.MAVLink:
        """Return the encoder of a station."""
        if source not in self._codecs:
            self._codecs[source] = mavlink.MAVLink(None, *source)
        return self._codecs[source]

    def pack(self, message: Any, source: Source = STATION) -> bytes:
        """Return the next frame of a station."""
        codec = self.codec(source)
        data = bytes(message.pack(codec))
        codec.seq = (codec.seq + 1) % 256
        return data


class Receiver:
    """The parser of the bytes of one link; `codec` has the settings of signatures."""

    def __init__(self) -> None:
        self.codec = mavlink.MAVLink(None)
        self.codec.robust_parsing = True

    def frames(self, data: bytes, now: float) -> Iterator[ReceivedFrame]:
        """Yield the frames that are complete now, and the bytes of `NOISE`."""
        for message in self._parsed(data):
            yield ReceivedFrame(now, message.get_type(), message, bytes(message.get_msgbuf()))

    def messages(self, data: bytes) -> list[Any]:
        """Return the messages that are complete now, without noise."""
        return [message for message in self._parsed(data) if message.get_type() != NOISE]

    def _parsed(self, data: bytes) -> Iterator[Any]:
        return map(decoded, self.codec.parse_buffer(data) or ())
