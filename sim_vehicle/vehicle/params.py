"""Parameters of one vehicle and the messages that read and write them."""

import math
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.definitions import HEADER_BYTES, DefinedMessage, layout_of
from sim_vehicle.files.pacing import Pacer

HASH_NAME = "_HASH_CHECK"
FRAME_BYTES = 37  # length of a PARAM_VALUE frame
UNINDEXED = 0xFFFF
DEFAULT_BITS = 32
WIRE_TYPES = {
    8: int(mavlink.MAV_PARAM_TYPE_INT8),
    16: int(mavlink.MAV_PARAM_TYPE_INT16),
    32: int(mavlink.MAV_PARAM_TYPE_INT32),
}
_VALUE = layout_of(mavlink.MAVLINK_MSG_ID_PARAM_VALUE)
# PARAM_VALUE with the bytes of an integer, because a float conversion changes those of a signalling NaN.
_INTEGER_VALUE = replace(_VALUE, dtype=np.dtype([("param_value", "<u4"), *_VALUE.dtype.descr[1:]]))
# ArduPilot adds this offset before the truncation of a float, so that 2.999 becomes 3.
TRUNCATION_OFFSET = 0.01


def as_float32(value: float) -> float:
    """Return the value rounded to a 32-bit float, as autopilots store and send it."""
    return float(struct.unpack("<f", struct.pack("<f", value))[0])


@dataclass(frozen=True, slots=True)
class ParameterTable:
    """The parameters of one firmware, and their encoding."""

    defaults: Mapping[str, float | int]  # an int makes an integer parameter
    system_id: str  # name of the parameter with the system id
    # True: PX4's encoding; the float field has the four bytes of an integer, and a PARAM_SET of another type
    # is ignored. False: ArduPilot's encoding; the field has the nearest float, and fractions are truncated.
    byte_wise: bool
    read_only: frozenset[str] = frozenset()  # names that PARAM_SET cannot change
    bits: Mapping[str, int] = field(default_factory=dict)  # widths of integers; 32 if absent


class Parameters:
    """Named numbers in the autopilot's units; the set of names is fixed.

    start: initial values of this vehicle, which become its defaults.
    """

    def __init__(self, table: ParameterTable, start: Mapping[str, float | int]) -> None:
        defaults, self._bits, self._byte_wise = table.defaults, table.bits, table.byte_wise
        self._values = {name: defaults[name] for name in sorted(defaults)}
        for name, value in {**defaults, **start}.items():
            self._values[name] = self._stored_value(name, value)
        self._defaults, self._start = defaults, start
        self._names = list(self._values)
        self._read_only = table.read_only
        self._pacer = Pacer()
        self._list_index = len(self._names)  # index of the next parameter in the list; -1: the hash

    def __getitem__(self, name: str) -> float | int:
        return self._values[name]

    def __contains__(self, name: str) -> bool:
        return name in self._values

    def __len__(self) -> int:
        return len(self._values)

    def items(self) -> Iterator[tuple[str, float | int]]:
        """Return names and values in the order of their indices."""
        return iter(self._values.items())

    @property
    def defaults(self) -> dict[str, float | int]:
        """The vehicle's initial values, computed at each access: a fleet stores no second copy."""
        initial = {**self._defaults, **self._start}
        return {name: self._stored_value(name, initial[name]) for name in self._names}

    def bits(self, name: str) -> int:
        """Return the width of an integer parameter [bits]; 0 for a float."""
        return self._bits.get(name, DEFAULT_BITS) if isinstance(self._values[name], int) else 0

    def set(self, name: str, value: float) -> None:
        """Set a parameter, limited to its type's range; raise KeyError if the name is unknown.

        A read-only name, NaN and infinity change nothing.
        """
        if name not in self._values:
            raise KeyError(name)
        if name not in self._read_only and math.isfinite(value):
            self._values[name] = self._stored_value(name, value)

    def set_internal(self, name: str, value: float) -> None:
        """Set a parameter that only the vehicle writes, such as the number of stored items."""
        self._values[name] = self._stored_value(name, value)

    def _stored_value(self, name: str, value: float) -> float | int:
        """Return a value converted to the parameter's type and limited to the type's range."""
        bits = self.bits(name)
        if not bits:
            return as_float32(value)
        integer = round(value) if self._byte_wise else int(value + math.copysign(TRUNCATION_OFFSET, value))
        return min(max(integer, -(1 << bits - 1)), (1 << bits - 1) - 1)

    @property
    def listing(self) -> bool:
        """True while the vehicle sends the list."""
        return self._list_index < len(self._names)

    def tick(self, send: Callable[[Any], None], now: float) -> None:
        """Send the part of a requested list that the link can carry by `now` [s]."""
        while self.listing and self._pacer.take(FRAME_BYTES, now):
            send(self._hash_message() if self._list_index < 0 else self.value_message(self._list_index))
            self._list_index += 1

    def reboot(self) -> None:
        """Stop sending a list; the values stay."""
        self._list_index = len(self._names)

    def receive(self, message: Any, send: Callable[[Any], None], now: float) -> str | None:
        """Answer PARAM_REQUEST_LIST, PARAM_REQUEST_READ or PARAM_SET; ignore an unknown name.

        Return the name of an answered PARAM_SET, else None. A repeated PARAM_REQUEST_LIST restarts the list.
        """
        kind: str = message.get_type()
        if kind == "PARAM_REQUEST_LIST":
            # A restarted list omits the hash.
            self._list_index = -1 if self._byte_wise and not self.listing else 0
            self.tick(send, now)
            return None
        if kind == "PARAM_REQUEST_READ" and message.param_index >= 0:
            if message.param_index < len(self._names):
                send(self.value_message(message.param_index))
            return None
        if message.param_id == HASH_NAME and self._byte_wise:
            if kind == "PARAM_REQUEST_READ":
                send(self._hash_message())
            else:  # the ground station has cached the values, so the list ends
                self._list_index = len(self._names)
        if message.param_id not in self._values:
            return None
        if kind == "PARAM_SET":
            if self._byte_wise and message.param_type != self._wire_type(message.param_id):
                return None  # PX4 does not answer if the type is wrong
            self.set(message.param_id, self._from_wire(message))
        send(self.value_message(self._names.index(message.param_id), named=True))
        return str(message.param_id) if kind == "PARAM_SET" else None

    def _from_wire(self, message: Any) -> float:
        if self._byte_wise and message.param_type == mavlink.MAV_PARAM_TYPE_INT32:
            # The original bytes, because a float conversion changes the bytes of a signalling NaN.
            frame = bytes(message.get_msgbuf())
            start = HEADER_BYTES[frame[0]]
            return int.from_bytes(frame[start : start + 4], "little", signed=True)
        return float(message.param_value)

    def _wire_type(self, name: str) -> int:
        return WIRE_TYPES.get(self.bits(name), int(mavlink.MAV_PARAM_TYPE_REAL32))

    def hash(self) -> int:
        """Return PX4's CRC-32 over names and values, for a comparison with a ground station's cache."""
        crc = 0xFFFFFFFF
        for name, value in self._values.items():
            packed = struct.pack("<i" if isinstance(value, int) else "<f", value)
            crc = zlib.crc32(name.encode() + packed, crc)
        return crc ^ 0xFFFFFFFF

    def _hash_message(self) -> Any:
        return self._integer_message(HASH_NAME, self.hash(), mavlink.MAV_PARAM_TYPE_UINT32, UNINDEXED)

    def value_message(self, index: int, *, named: bool = False) -> Any:
        """Return PARAM_VALUE of an index; ArduPilot omits the index in an answer by name (`named`)."""
        name = self._names[index]
        value = self._values[name]
        kind = self._wire_type(name)
        if self._byte_wise and isinstance(value, int):
            return self._integer_message(name, value, kind, index)
        sent_index = UNINDEXED if named and not self._byte_wise else index
        return mavlink.MAVLink_param_value_message(name.encode(), value, kind, len(self._names), sent_index)

    def _integer_message(self, name: str, value: int, kind: int, index: int) -> DefinedMessage:
        return DefinedMessage(
            _INTEGER_VALUE, param_value=value & 0xFFFFFFFF, param_count=len(self._names), param_index=index,
            param_id=name.encode(), param_type=kind,
        )  # fmt: skip
