"""Parameters by name: https://mavlink.io/en/services/parameter.html

A number travels in a float field. ArduPilot converts an integer to the nearest float; PX4 copies the four
bytes of an integer into the field. A request with an unknown name gets no answer.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterable, Mapping

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.mavlink.protocol.codec import Message, payload
from swarmctl.mavlink.protocol.outcome import Done
from swarmctl.mavlink.protocol.procedure import Context, Procedure
from swarmctl.mavlink.protocol.wait import Requests

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


TRIES = 10
"""number of tries of each request"""
MAX_PENDING = 10
"""greatest number of requests under way; ArduPilot queues about twenty, and drops further requests"""


def _exchange(
    requests: Mapping[str, Message],
    confirms: Callable[[str, Parameter], bool] = lambda _name, _parameter: True,
    *,
    byte_wise: bool,
) -> Requests[str, Parameter]:
    """Return an exchange whose result has the reported values; `requests` and `confirms` are by name."""

    def answer_to(message: Message, _now: float) -> tuple[str, Parameter] | None:
        if message.get_type() != "PARAM_VALUE":
            return None
        return str(message.param_id).rstrip("\0"), decoded(message, byte_wise=byte_wise)

    return Requests(requests, answer_to, confirms, tries=TRIES, max_pending=MAX_PENDING)


def read_parameters(ctx: Context, names: Iterable[str]) -> Procedure[dict[str, Parameter]]:
    """Read parameters; return the parameters that the vehicle reports, by name."""
    to = (ctx.peer.sysid, ctx.peer.compid)
    requests = {name: mavlink.MAVLink_param_request_read_message(*to, name.encode(), -1) for name in names}
    current: dict[str, Parameter] = yield _exchange(requests, byte_wise=ctx.autopilot in BYTE_WISE)
    return current


def _write_parameters(ctx: Context, new: Mapping[str, Parameter]) -> Procedure[dict[str, Parameter]]:
    """Write parameters; return the last reported values, without unanswered names.

    PX4 drops a value of a wrong type without an answer, so the type has to be read first. Raises ValueError
    as `encoded` does.
    """
    to, byte_wise = (ctx.peer.sysid, ctx.peer.compid), ctx.autopilot in BYTE_WISE
    requests = {
        name: mavlink.MAVLink_param_set_message(
            *to, name.encode(), encoded(parameter, byte_wise=byte_wise), parameter.kind
        )
        for name, parameter in new.items()
    }
    # Another value may be the late answer to an earlier request.
    written: dict[str, Parameter] = yield _exchange(
        requests, lambda name, found: same_value(found.value, new[name].value), byte_wise=byte_wise
    )
    return written


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
        written = yield from _write_parameters(ctx, to_write)
    except ValueError as error:
        return Done(f"nothing was set: {error}")
    refused = [
        f"{name} is {written[name].value:g} instead of {parameter.value:g}"
        if name in written
        else f"{name} was not confirmed"
        for name, parameter in to_write.items()
        if name not in written or not same_value(written[name].value, parameter.value)
    ]
    return Done("; ".join(refused) or None)
