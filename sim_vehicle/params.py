"""Parameters of one vehicle and the messages that read and write them."""

import math
import struct
from collections.abc import Callable, Mapping
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink


def as_float32(value: float) -> float:
    """The value as the wire and the autopilot's memory keep it."""
    return float(struct.unpack("<f", struct.pack("<f", value))[0])


class Parameters:
    """Named floats in the autopilot's own units; the list is fixed, and every one of them acts.

    `read_only` names are answered with the value they keep when somebody sets them.
    """

    def __init__(self, values: Mapping[str, float], *, read_only: frozenset[str] = frozenset()) -> None:
        self._values = {name: as_float32(values[name]) for name in sorted(values)}
        self._names = list(self._values)
        self._read_only = read_only

    def __getitem__(self, name: str) -> float:
        return self._values[name]

    def set(self, name: str, value: float) -> None:
        """Set a known parameter; KeyError for another name."""
        if name not in self._values:
            raise KeyError(name)
        if name not in self._read_only:
            self._values[name] = as_float32(value)

    def receive(self, message: Any, send: Callable[[Any], None]) -> bool:
        """Answer PARAM_REQUEST_LIST, PARAM_REQUEST_READ or PARAM_SET; True if a value was set.

        An unknown name gets no reply at all.
        """
        kind: str = message.get_type()
        if kind == "PARAM_REQUEST_LIST":
            for index in range(len(self._names)):
                send(self._value_message(index))
            return False
        if kind == "PARAM_REQUEST_READ" and message.param_index >= 0:
            if message.param_index < len(self._names):
                send(self._value_message(message.param_index))
            return False
        if message.param_id not in self._values:
            return False
        if kind == "PARAM_SET" and math.isfinite(message.param_value):
            self.set(message.param_id, message.param_value)
        send(self._value_message(self._names.index(message.param_id)))
        return kind == "PARAM_SET"

    def _value_message(self, index: int) -> Any:
        name = self._names[index]
        return mavlink.MAVLink_param_value_message(
            name.encode(), self._values[name], mavlink.MAV_PARAM_TYPE_REAL32, len(self._names), index
        )
