"""Parameters read and written in the vehicle's own encoding."""

import math
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance.peer import Peer
from sim_vehicle.conformance.words import CheckFailed, Skip

LIST_QUIET_S = 1.5  # a list that has stopped for so long has lost something
LIST_S = 120.0
UNINDEXED = 65_535  # ArduPilot's index where it was asked by name
_FORMATS = {
    mavlink.MAV_PARAM_TYPE_UINT8: "B",
    mavlink.MAV_PARAM_TYPE_INT8: "b",
    mavlink.MAV_PARAM_TYPE_UINT16: "H",
    mavlink.MAV_PARAM_TYPE_INT16: "h",
    mavlink.MAV_PARAM_TYPE_UINT32: "I",
    mavlink.MAV_PARAM_TYPE_INT32: "i",
    mavlink.MAV_PARAM_TYPE_REAL32: "f",
}
WHOLE_RANGES = {
    mavlink.MAV_PARAM_TYPE_UINT8: (0, 255),
    mavlink.MAV_PARAM_TYPE_INT8: (-128, 127),
    mavlink.MAV_PARAM_TYPE_UINT16: (0, 65_535),
    mavlink.MAV_PARAM_TYPE_INT16: (-32_768, 32_767),
    mavlink.MAV_PARAM_TYPE_UINT32: (0, 2**32 - 1),
    mavlink.MAV_PARAM_TYPE_INT32: (-(2**31), 2**31 - 1),
}


@dataclass(frozen=True, slots=True)
class Value:
    """One PARAM_VALUE, decoded."""

    name: str
    value: float
    type: int  # MAV_PARAM_TYPE
    index: int
    count: int


def byte_wise(peer: Peer) -> bool:
    """Whether integers travel as their bytes."""
    if peer.dialect.byte_wise is not None:
        return peer.dialect.byte_wise
    return peer.facts.claims("PARAM_ENCODE_BYTEWISE")


def decode(peer: Peer, message: Any) -> Value:
    raw, kind = message.param_value, message.param_type
    if byte_wise(peer) and kind in WHOLE_RANGES:
        size = struct.calcsize(_FORMATS[kind])
        raw = struct.unpack(f"<{_FORMATS[kind]}", struct.pack("<f", raw)[:size])[0]
    return Value(message.param_id, raw, kind, message.param_index, message.param_count)


def set_message(peer: Peer, name: str, value: float, kind: int) -> Any:
    """PARAM_SET in the vehicle's encoding."""
    wire = value
    if byte_wise(peer) and kind in WHOLE_RANGES:
        packed = struct.pack(f"<{_FORMATS[kind]}", int(value)).ljust(4, b"\0")
        wire = struct.unpack("<f", packed)[0]
    return mavlink.MAVLink_param_set_message(*peer.target, name.encode(), wire, kind)


def read_message(peer: Peer, name: str = "", index: int = -1, *, sysid: int | None = None) -> Any:
    return mavlink.MAVLink_param_request_read_message(
        peer.facts.sysid if sysid is None else sysid, peer.facts.component, name.encode(), index
    )


def read(peer: Peer, name: str) -> Value:
    """A parameter by name; CheckFailed where no answer comes."""
    return decode(peer, peer.ask(read_message(peer, name), "PARAM_VALUE", lambda m: m.param_id == name))


def read_index(peer: Peer, index: int) -> Value:
    """A parameter by its place in the list; CheckFailed where no answer comes."""
    message = peer.ask(
        read_message(peer, index=index), "PARAM_VALUE", lambda m: m.param_index in (index, UNINDEXED)
    )
    return decode(peer, message)


def write(peer: Peer, name: str, value: float, kind: int) -> Value:
    """PARAM_SET; the PARAM_VALUE that acknowledges it."""
    message = set_message(peer, name, value, kind)
    return decode(peer, peer.ask(message, "PARAM_VALUE", lambda m: m.param_id == name))


def put_back(peer: Peer, before: Value) -> None:
    """Write what was read; CheckFailed where it is not taken."""
    seen = write(peer, before.name, before.value, before.type).value
    if seen != before.value and not math.isnan(before.value):
        raise CheckFailed(f"{before.name}: expected {before.value:g}, saw {seen:g}")


@contextmanager
def kept(peer: Peer, name: str) -> Iterator[Value]:
    """Whatever becomes of a parameter here, it is put back; what it was."""
    before = read(peer, name)
    with peer.owing(name, lambda: put_back(peer, before)):
        yield before


@contextmanager
def changed(peer: Peer, name: str, value: float) -> Iterator[Value]:
    """A parameter has another value for a while; the acknowledgement of the change."""
    with kept(peer, name) as before:
        yield write(peer, name, value, before.type)


def has(peer: Peer, name: str) -> bool:
    """Whether the vehicle knows a parameter."""
    if peer.catalogue:
        return name in peer.catalogue
    return any(
        peer.maybe("PARAM_VALUE", lambda m: m.param_id == name, mark=mark) is not None
        for mark in (_asked(peer, name) for _ in range(2))
    )


def _asked(peer: Peer, name: str) -> int:
    mark = peer.mark()
    peer.send(read_message(peer, name))
    return mark


def setting(peer: Peer, name: str) -> float | None:
    """A parameter's value, None where the vehicle has no such one."""
    return read(peer, name).value if has(peer, name) else None


def harmless(peer: Peer, candidates: tuple[tuple[str, float], ...]) -> tuple[str, float]:
    """The first of the (name, value) that the vehicle has, with a value it does not have now."""
    for name, value in candidates:
        if has(peer, name):
            return name, value if read(peer, name).value != value else value + 1
    raise Skip("no parameter is known that could be changed without harm")


def fetch_all(peer: Peer) -> dict[str, Value]:
    """The whole list by PARAM_REQUEST_LIST, with what got lost asked for by index; kept for later checks."""
    by_index: dict[int, Value] = {}
    count, mark, began_s = None, peer.mark(), peer.now
    peer.send(mavlink.MAVLink_param_request_list_message(*peer.target))
    while count is None or len(by_index) < count:
        if peer.now - began_s > LIST_S:
            raise CheckFailed(f"parameter list: {len(by_index)} of {count} within {LIST_S:g} s")
        begin, before = mark, len(by_index)
        message = peer.maybe("PARAM_VALUE", within_s=LIST_QUIET_S, mark=begin)
        mark = peer.mark()
        for heard in peer.since(begin, "PARAM_VALUE"):
            if heard.param_index != UNINDEXED:
                by_index[heard.param_index] = decode(peer, heard)
                count = heard.param_count
        if message is None or len(by_index) == before:
            if count is None:
                raise CheckFailed("expected PARAM_VALUE for PARAM_REQUEST_LIST, saw none")
            for index in [i for i in range(count) if i not in by_index][:20]:
                peer.send(read_message(peer, index=index))
    peer.catalogue = {found.name: found for _, found in sorted(by_index.items())}
    return peer.catalogue


def listed(peer: Peer) -> dict[str, Value]:
    """The list, fetched once a run."""
    return peer.catalogue or fetch_all(peer)
