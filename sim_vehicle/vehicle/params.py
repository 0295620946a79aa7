"""Parameters of one vehicle and the messages that read and write them."""

import math
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.files.pacing import Pacer

HASH_NAME = "_HASH_CHECK"
FRAME_BYTES = 37  # of a PARAM_VALUE on the link
BYTES_S = 200_000
MOST_BYTES_AT_ONCE = 40_000
INT_LIMITS = (-(2**31), 2**31 - 1)


def as_float32(value: float) -> float:
    """The value as the wire and the autopilot's memory keep it."""
    return float(struct.unpack("<f", struct.pack("<f", value))[0])


class Parameters:
    """Named numbers in the autopilot's units; the list is fixed, and a default that is an int makes an int.

    `read_only` names are answered with the value they keep when somebody sets them. `byte_wise`: integers
    travel as their four bytes in the float field (PX4), else as the nearest float (ArduPilot).
    """

    def __init__(
        self,
        values: Mapping[str, float | int],
        *,
        read_only: frozenset[str] = frozenset(),
        byte_wise: bool = False,
    ) -> None:
        self._values = {name: _kept(values[name], values[name]) for name in sorted(values)}
        self.defaults = dict(self._values)
        self._names = list(self._values)
        self._index = {name: index for index, name in enumerate(self._names)}
        self._read_only = read_only
        self._byte_wise = byte_wise
        self._pacer = Pacer(BYTES_S, MOST_BYTES_AT_ONCE)
        self._listed = len(self._names)  # index of the list's next parameter, -1: the hash

    def __getitem__(self, name: str) -> float | int:
        return self._values[name]

    def __contains__(self, name: str) -> bool:
        return name in self._values

    def __len__(self) -> int:
        return len(self._values)

    def items(self) -> Iterator[tuple[str, float | int]]:
        """Names and values in the order of their indices."""
        return iter(self._values.items())

    def is_integer(self, name: str) -> bool:
        return isinstance(self._values[name], int)

    def set(self, name: str, value: float) -> None:
        """Set a known parameter; KeyError for another name. An integer one takes the nearest integer.

        What is no finite number changes nothing.
        """
        if name not in self._values:
            raise KeyError(name)
        if name not in self._read_only and math.isfinite(value):
            self._values[name] = _kept(self._values[name], value)

    def keep(self, name: str, value: float) -> None:
        """Set one that nobody but the vehicle may set (a count of what is stored)."""
        self._values[name] = _kept(self._values[name], value)

    @property
    def listing(self) -> bool:
        """Whether a list is under way, so that `tick` has something to send."""
        return self._listed < len(self._names)

    def tick(self, send: Callable[[Any], None], now: float) -> None:
        """Send of the list that was asked for what the link takes by `now` [s]."""
        while self.listing and self._pacer.take(FRAME_BYTES, now):
            send(self._hash_message() if self._listed < 0 else self.value_message(self._listed))
            self._listed += 1

    def reboot(self) -> None:
        """A list that is under way is forgotten; the values stay."""
        self._listed = len(self._names)

    def receive(self, message: Any, send: Callable[[Any], None], now: float) -> str | None:
        """Answer PARAM_REQUEST_LIST, PARAM_REQUEST_READ or PARAM_SET; the name that was set, if one was.

        Whoever asks for the list while it is being sent has it begin again.

        An unknown name gets no reply at all.
        """
        kind: str = message.get_type()
        if kind == "PARAM_REQUEST_LIST":
            self._listed = -1 if self._byte_wise else 0
            self.tick(send, now)
            return None
        if kind == "PARAM_REQUEST_READ" and message.param_index >= 0:
            if message.param_index < len(self._names):
                send(self.value_message(message.param_index))
            return None
        if message.param_id == HASH_NAME and self._byte_wise and kind == "PARAM_REQUEST_READ":
            send(self._hash_message())
        if message.param_id not in self._values:
            return None
        if kind == "PARAM_SET":
            if self._byte_wise and message.param_type != self._wire_type(message.param_id):
                return None  # of another type than the parameter: dropped without an answer
            self.set(message.param_id, self._from_wire(message))
        send(self.value_message(self._index[message.param_id]))
        return str(message.param_id) if kind == "PARAM_SET" else None

    def _from_wire(self, message: Any) -> float:
        if self._byte_wise and message.param_type == mavlink.MAV_PARAM_TYPE_INT32:
            # The bytes as they came: through a float, those of a signalling NaN would change.
            frame = bytes(message.get_msgbuf())
            start = 10 if frame[:1] == b"\xfd" else 6  # length of the header, of MAVLink 2 or 1
            value = frame[start : start + 4] or struct.pack("<f", message.param_value)
            return int(struct.unpack("<i", value)[0])
        return float(message.param_value)

    def _wire_type(self, name: str) -> int:
        is_integer = isinstance(self._values[name], int)
        return int(mavlink.MAV_PARAM_TYPE_INT32 if is_integer else mavlink.MAV_PARAM_TYPE_REAL32)

    def hash(self) -> int:
        """CRC-32 over names and values, by which a ground station knows that it has them all already."""
        crc = 0xFFFFFFFF
        for name, value in self._values.items():
            packed = struct.pack("<i" if isinstance(value, int) else "<f", value)
            crc = zlib.crc32(name.encode() + packed, crc)
        return crc ^ 0xFFFFFFFF

    def _hash_message(self) -> Any:
        bits = struct.pack("<I", self.hash())
        return _BytesValue(HASH_NAME, bits, mavlink.MAV_PARAM_TYPE_UINT32, len(self._names), 0xFFFF)

    def value_message(self, index: int) -> Any:
        """PARAM_VALUE of one index."""
        name = self._names[index]
        value = self._values[name]
        kind = self._wire_type(name)
        if self._byte_wise and isinstance(value, int):
            return _BytesValue(name, struct.pack("<i", value), kind, len(self._names), index)
        return mavlink.MAVLink_param_value_message(name.encode(), value, kind, len(self._names), index)


class _BytesValue(mavlink.MAVLink_param_value_message):  # type: ignore[misc]
    """PARAM_VALUE whose value is four bytes and not a float."""

    def __init__(self, name: str, value: bytes, kind: int, count: int, index: int) -> None:
        super().__init__(name.encode(), struct.unpack("<f", value)[0], kind, count, index)
        self._bytes = value

    def pack(self, mav: Any, force_mavlink1: bool = False) -> bytes:
        rest = struct.pack("<HH16sB", self.param_count, self.param_index, self._param_id_raw, self.param_type)
        return bytes(self._pack(mav, self.crc_extra, self._bytes + rest, force_mavlink1=force_mavlink1))


def _kept(like: float, value: float) -> float | int:
    """A value as it is stored: of the type of `like`, in its range."""
    if isinstance(like, int):
        return min(max(round(value), INT_LIMITS[0]), INT_LIMITS[1])
    return as_float32(value)
