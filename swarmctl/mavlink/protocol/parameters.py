"""Parameters by name: https://mavlink.io/en/services/parameter.html

A number travels in a float field. ArduPilot converts an integer to the nearest float; PX4 copies the four
bytes of an integer into the field. A request with an unknown name gets no answer.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Mapping

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.mavlink.protocol.codec import Message, payload
from swarmctl.mavlink.protocol.conversation import Conversation, ConversationState, MavlinkPeer
from swarmctl.mavlink.protocol.outcome import Done
from swarmctl.mavlink.protocol.procedure import Context, Procedure

BYTE_WISE = frozenset({int(mavlink.MAV_AUTOPILOT_PX4)})
"""MAV_AUTOPILOTs that copy the bytes of integers into the float field"""

_REAL32 = int(mavlink.MAV_PARAM_TYPE_REAL32)
_PACKED: Mapping[int, str] = {
    int(mavlink.MAV_PARAM_TYPE_UINT8): "<Bxxx",
    int(mavlink.MAV_PARAM_TYPE_INT8): "<bxxx",
    int(mavlink.MAV_PARAM_TYPE_UINT16): "<Hxx",
    int(mavlink.MAV_PARAM_TYPE_INT16): "<hxx",
    int(mavlink.MAV_PARAM_TYPE_UINT32): "<I",
    int(mavlink.MAV_PARAM_TYPE_INT32): "<i",
    _REAL32: "<f",
}


class Parameter(msgspec.Struct, frozen=True):
    """A value in the unit of the parameter, and its MAV_PARAM_TYPE."""

    value: float
    kind: int


def decoded(message: Message, *, byte_wise: bool) -> Parameter:
    """Return the parameter in a PARAM_VALUE or PARAM_SET."""
    kind = int(message.param_type)
    if not byte_wise or kind == _REAL32 or kind not in _PACKED:
        return Parameter(float(message.param_value), kind)
    # The bytes as received: a conversion to float would change some integers (signalling NaNs).
    data = payload(message)[:4] or struct.pack("<f", message.param_value)
    return Parameter(float(struct.unpack(_PACKED[kind], data)[0]), kind)


def encoded(parameter: Parameter, *, byte_wise: bool) -> float:
    """Return the float field of a parameter. Raises ValueError if field or type cannot hold the value."""
    if not byte_wise or parameter.kind == _REAL32:
        return parameter.value
    code = _PACKED.get(parameter.kind)
    whole = int(parameter.value)
    if code is None or whole != parameter.value:
        raise ValueError(f"{parameter.value:g} is no value of MAV_PARAM_TYPE {parameter.kind}")
    try:
        data = struct.pack(code, whole)
    except struct.error as error:
        raise ValueError(f"{whole} does not fit MAV_PARAM_TYPE {parameter.kind}: {error}") from None
    field = float(struct.unpack("<f", data)[0])
    if struct.pack("<f", field) != data:
        raise ValueError(f"{whole} would not keep its bytes in a float field")
    return field


def same_value(a: float, b: float) -> bool:
    """Return whether two values are equal within the precision of a 32-bit float."""
    return math.isclose(a, b, rel_tol=1e-6, abs_tol=1e-6)


class _ParameterExchange(Conversation[dict[str, Parameter]]):
    """Base of reading and writing: several requests at a time, each sent up to TRIES times.

    ArduPilot queues about twenty requests and drops further requests.
    """

    REPEAT_PERIOD_S = 1.0
    TRIES = 10
    MAX_PENDING = 10

    def __init__(self, peer: MavlinkPeer, names: Iterable[str], *, byte_wise: bool) -> None:
        super().__init__()
        self._peer = peer
        self._byte_wise = byte_wise
        self._waiting = list(dict.fromkeys(names))
        self._tries: dict[str, int] = {}
        """tries of each pending name"""
        self._values: dict[str, Parameter] = {}

    def _request(self, name: str) -> Message:
        raise NotImplementedError

    def _is_answer(self, name: str, parameter: Parameter) -> bool:
        raise NotImplementedError

    def _begin(self, now: float) -> list[Message]:
        self._enter(ConversationState.EXCHANGING)
        return self._request_next(now)

    def _request_next(self, now: float) -> list[Message]:
        room = self.MAX_PENDING - len(self._tries)
        started, self._waiting = self._waiting[:room], self._waiting[room:]
        self._tries.update(dict.fromkeys(started, 1))
        if not self._tries:
            self._finish(self._values)
            return []
        self.next_deadline = now + self.REPEAT_PERIOD_S
        return [self._request(name) for name in started]

    def _on_message(self, message: Message, now: float) -> list[Message]:
        if message.get_type() != "PARAM_VALUE":
            return []
        name = str(message.param_id).rstrip("\0")
        if name not in self._tries:
            return []
        self._values[name] = decoded(message, byte_wise=self._byte_wise)
        if not self._is_answer(name, self._values[name]):
            return []
        del self._tries[name]
        return self._request_next(now)

    def _on_deadline(self, now: float) -> list[Message]:
        again = [name for name, tries in self._tries.items() if tries < self.TRIES]
        self._tries = {name: self._tries[name] + 1 for name in again}
        requests = [self._request(name) for name in again]
        return requests + self._request_next(now)


class ReadParameters(_ParameterExchange):
    """Reading of some parameters; the result lacks names without an answer."""

    def _request(self, name: str) -> Message:
        return mavlink.MAVLink_param_request_read_message(
            self._peer.sysid, self._peer.compid, name.encode(), -1
        )

    def _is_answer(self, name: str, parameter: Parameter) -> bool:
        return True


class WriteParameters(_ParameterExchange):
    """Writing of some parameters; the result has the last reported values, without unanswered names.

    PX4 drops a value of a wrong type without an answer, so the type has to be read first. Raises ValueError
    as `encoded` does.
    """

    def __init__(self, peer: MavlinkPeer, new: Mapping[str, Parameter], *, byte_wise: bool) -> None:
        super().__init__(peer, new, byte_wise=byte_wise)
        self._new = dict(new)
        self._fields = {name: encoded(p, byte_wise=byte_wise) for name, p in new.items()}

    def _request(self, name: str) -> Message:
        kind = self._new[name].kind
        return mavlink.MAVLink_param_set_message(
            self._peer.sysid, self._peer.compid, name.encode(), self._fields[name], kind
        )

    def _is_answer(self, name: str, parameter: Parameter) -> bool:
        # Another value may be the late answer to an earlier request.
        return same_value(parameter.value, self._new[name].value)


def read_parameters(ctx: Context, names: Iterable[str]) -> Procedure[dict[str, Parameter]]:
    """Read parameters; return the parameters that the vehicle reports, by name."""
    byte_wise = ctx.autopilot in BYTE_WISE
    current: dict[str, Parameter] = yield ReadParameters(ctx.peer, names, byte_wise=byte_wise)
    return current


def _refusal_if_armed(ctx: Context) -> Done | None:
    """Return a failure if the vehicle is armed, else None."""
    why = "the vehicle is armed; change its parameters while it is disarmed on the ground [armed]"
    return Done(why) if ctx.state.armed else None


def set_parameters(ctx: Context, wanted: Mapping[str, float]) -> Procedure[Done]:
    """Change the parameters that differ from `wanted` on a disarmed vehicle, and confirm the new values."""
    if armed := _refusal_if_armed(ctx):
        return armed
    current = yield from read_parameters(ctx, wanted)
    if armed := _refusal_if_armed(ctx):  # a pilot may have armed the vehicle during the reading
        return armed
    unknown = [name for name in wanted if name not in current]
    if unknown:
        return Done(f"the vehicle does not report {', '.join(unknown)}; nothing was set [parameter-unknown]")
    to_write = {
        name: Parameter(value, current[name].kind)
        for name, value in wanted.items()
        if not same_value(value, current[name].value)
    }
    try:
        writing = WriteParameters(ctx.peer, to_write, byte_wise=ctx.autopilot in BYTE_WISE)
    except ValueError as error:
        return Done(f"nothing was set: {error}")
    written: dict[str, Parameter] = yield writing
    refused = [
        f"{name} is {written[name].value:g} instead of {parameter.value:g}"
        if name in written
        else f"{name} was not confirmed"
        for name, parameter in to_write.items()
        if name not in written or not same_value(written[name].value, parameter.value)
    ]
    return Done("; ".join(refused) or None)
