"""Parameters by name: https://mavlink.io/en/services/parameter.html

A number travels in a float field. ArduPilot converts an integer to the nearest float; PX4 puts the integer's
four bytes there, which read as a float are nonsense. A vehicle that does not know a name does not answer.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.mavlink.procedures.basic import Done
from swarmctl.mavlink.protocol.codec import Message
from swarmctl.mavlink.protocol.conversation import Conversation, ConversationState, MavlinkPeer
from swarmctl.mavlink.protocol.procedure import Context, Procedure

BYTE_WISE = frozenset({int(mavlink.MAV_AUTOPILOT_PX4)})
"""the MAV_AUTOPILOTs that send integers as their bytes"""

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
_V2, _V1_HEADER, _V2_HEADER = 0xFD, 6, 10


@dataclass(frozen=True, slots=True)
class Parameter:
    """A value in the unit of the parameter, and its MAV_PARAM_TYPE."""

    value: float
    kind: int


def decoded(message: Message, *, byte_wise: bool) -> Parameter:
    """What a PARAM_VALUE or PARAM_SET says."""
    kind = int(message.param_type)
    if not byte_wise or kind == _REAL32 or kind not in _PACKED:
        return Parameter(float(message.param_value), kind)
    return Parameter(float(struct.unpack(_PACKED[kind], _value_bytes(message))[0]), kind)


def _value_bytes(message: Message) -> bytes:
    # As they came: a float on the way would change those of some integers (signalling NaNs).
    if not message.get_msgbuf():  # one of ours, on its way out
        return struct.pack("<f", message.param_value)
    frame = bytes(message.get_msgbuf())
    start = _V2_HEADER if frame[0] == _V2 else _V1_HEADER
    return frame[start : start + 4]


def encoded(parameter: Parameter, *, byte_wise: bool) -> float:
    """The float field for a value. Raises ValueError for one that the field, or the type, cannot carry."""
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
    """But for what a 32-bit float cannot keep."""
    return math.isclose(a, b, rel_tol=1e-6, abs_tol=1e-6)


class _ParameterExchange(Conversation[dict[str, Parameter]]):
    """Bones of both: some names at once under way, each asked about until it is settled or given up.

    ArduPilot queues about twenty requests and drops the others.
    """

    REPEAT_S = 1.0
    TRIES = 10
    MAX_PENDING = 10

    def __init__(self, peer: MavlinkPeer, names: Iterable[str], *, byte_wise: bool) -> None:
        super().__init__()
        self._peer = peer
        self._byte_wise = byte_wise
        self._waiting = list(dict.fromkeys(names))
        self._tries: dict[str, int] = {}
        """of those under way"""
        self._values: dict[str, Parameter] = {}

    def _request(self, name: str) -> Message:
        raise NotImplementedError

    def _settles(self, name: str, parameter: Parameter) -> bool:
        raise NotImplementedError

    def _begin(self, now: float) -> list[Message]:
        self._enter(ConversationState.EXCHANGING)
        return self._proceed(now)

    def _proceed(self, now: float) -> list[Message]:
        room = self.MAX_PENDING - len(self._tries)
        begun, self._waiting = self._waiting[:room], self._waiting[room:]
        self._tries.update(dict.fromkeys(begun, 1))
        if not self._tries:
            self._finish(self._values)
            return []
        self.next_deadline = now + self.REPEAT_S
        return [self._request(name) for name in begun]

    def _on_message(self, message: Message, now: float) -> list[Message]:
        if message.get_type() != "PARAM_VALUE":
            return []
        name = str(message.param_id).rstrip("\0")
        if name not in self._tries:
            return []
        self._values[name] = decoded(message, byte_wise=self._byte_wise)
        if not self._settles(name, self._values[name]):
            return []
        del self._tries[name]
        return self._proceed(now)

    def _on_deadline(self, now: float) -> list[Message]:
        again = [name for name, tries in self._tries.items() if tries < self.TRIES]
        self._tries = {name: self._tries[name] + 1 for name in again}
        questions = [self._request(name) for name in again]
        return questions + self._proceed(now)


class ReadParameters(_ParameterExchange):
    """The values of some names; one that never comes is missing from the result."""

    def _request(self, name: str) -> Message:
        return mavlink.MAVLink_param_request_read_message(
            self._peer.sysid, self._peer.compid, name.encode(), -1
        )

    def _settles(self, name: str, parameter: Parameter) -> bool:
        return True


class WriteParameters(_ParameterExchange):
    """Set values and hear them back; the result is what the vehicle said last of each.

    PX4 drops a value of another type than the parameter's without an answer, so that the type has to be read
    first. Raises ValueError as `encoded` does.
    """

    def __init__(self, peer: MavlinkPeer, wanted: Mapping[str, Parameter], *, byte_wise: bool) -> None:
        super().__init__(peer, wanted, byte_wise=byte_wise)
        self._wanted = dict(wanted)
        self._fields = {name: encoded(p, byte_wise=byte_wise) for name, p in wanted.items()}

    def _request(self, name: str) -> Message:
        kind = self._wanted[name].kind
        return mavlink.MAVLink_param_set_message(
            self._peer.sysid, self._peer.compid, name.encode(), self._fields[name], kind
        )

    def _settles(self, name: str, parameter: Parameter) -> bool:
        # Another value may be the late answer to a question before.
        return same_value(parameter.value, self._wanted[name].value)


def read_parameters(
    ctx: Context, names: Iterable[str], *, byte_wise: bool
) -> Procedure[dict[str, Parameter]]:
    """Those of the names that the vehicle knows."""
    current: dict[str, Parameter] = yield ReadParameters(ctx.peer, names, byte_wise=byte_wise)
    return current


def _refusal_if_armed(ctx: Context) -> Done | None:
    """Why nothing is set; None where it stands disarmed."""
    why = "it is armed; its parameters are changed on the ground, disarmed"
    return Done(why) if ctx.state.armed else None


def set_parameters(ctx: Context, wanted: Mapping[str, float], *, byte_wise: bool) -> Procedure[Done]:
    """Change what is not as wanted, on a vehicle that stands disarmed, and hear it back."""
    if armed := _refusal_if_armed(ctx):
        return armed
    current = yield from read_parameters(ctx, wanted, byte_wise=byte_wise)
    if armed := _refusal_if_armed(ctx):  # somebody else may have done so meanwhile
        return armed
    unknown = [name for name in wanted if name not in current]
    if unknown:
        return Done(f"it told no {', '.join(unknown)}; nothing was set")
    wrong = {
        name: Parameter(value, current[name].kind)
        for name, value in wanted.items()
        if not same_value(value, current[name].value)
    }
    try:
        writing = WriteParameters(ctx.peer, wrong, byte_wise=byte_wise)
    except ValueError as error:
        return Done(f"nothing was set: {error}")
    written: dict[str, Parameter] = yield writing
    refused = [
        f"{name} is {written[name].value:g} instead of {parameter.value:g}"
        if name in written
        else f"{name} was not heard back"
        for name, parameter in wrong.items()
        if name not in written or not same_value(written[name].value, parameter.value)
    ]
    return Done("; ".join(refused) or None)
