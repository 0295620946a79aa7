"""Parameters, read and written in the encoding of the vehicle."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance.outcomes import CheckFailed, Skip
from sim_vehicle.conformance.vehicle import VehicleUnderTest
from sim_vehicle.station.messages import from_wire, to_wire

LIST_QUIET_S = 1.5  # after a longer pause in a list, missing entries are requested
LIST_S = 120.0  # longest time for a parameter list
UNINDEXED = 65_535  # param_index in ArduPilot's answer by name, and of PX4's _HASH_CHECK


@dataclass(frozen=True, slots=True)
class ParameterValue:
    """One decoded PARAM_VALUE."""

    name: str
    value: float
    type: int  # MAV_PARAM_TYPE
    index: int
    count: int


def byte_wise(vehicle: VehicleUnderTest) -> bool:
    """Return True if integers are sent as their bytes."""
    if vehicle.dialect.byte_wise is not None:
        return vehicle.dialect.byte_wise
    return vehicle.identity.claims("PARAM_ENCODE_BYTEWISE")


def decode(vehicle: VehicleUnderTest, message: Any) -> ParameterValue:
    value = from_wire(message.param_value, message.param_type, byte_wise=byte_wise(vehicle))
    return ParameterValue(
        message.param_id, value, message.param_type, message.param_index, message.param_count
    )


def set_message(vehicle: VehicleUnderTest, name: str, value: float, kind: int) -> Any:
    """Return PARAM_SET in the encoding of the vehicle."""
    field = to_wire(value, kind, byte_wise=byte_wise(vehicle))
    return mavlink.MAVLink_param_set_message(*vehicle.target, name.encode(), field, kind)


def read_message(
    vehicle: VehicleUnderTest, name: str = "", index: int = -1, *, sysid: int | None = None
) -> Any:
    return mavlink.MAVLink_param_request_read_message(
        vehicle.identity.sysid if sysid is None else sysid, vehicle.identity.component, name.encode(), index
    )


def read(vehicle: VehicleUnderTest, name: str) -> ParameterValue:
    """Read a parameter by name; raise CheckFailed if no answer arrives."""
    return decode(
        vehicle, vehicle.ask(read_message(vehicle, name), "PARAM_VALUE", lambda m: m.param_id == name)
    )


def read_index(vehicle: VehicleUnderTest, index: int) -> ParameterValue:
    """Read a parameter by its index; raise CheckFailed if no answer arrives."""
    message = vehicle.ask(
        read_message(vehicle, index=index), "PARAM_VALUE", lambda m: m.param_index in (index, UNINDEXED)
    )
    return decode(vehicle, message)


def write(vehicle: VehicleUnderTest, name: str, value: float, kind: int) -> ParameterValue:
    """Send PARAM_SET; return the acknowledged value, or raise CheckFailed if no answer arrives."""
    message = set_message(vehicle, name, value, kind)
    return decode(vehicle, vehicle.ask(message, "PARAM_VALUE", lambda m: m.param_id == name))


def restore(vehicle: VehicleUnderTest, before: ParameterValue) -> None:
    """Write back an earlier value; raise CheckFailed if the vehicle acknowledges another value."""
    seen = write(vehicle, before.name, before.value, before.type).value
    if seen != before.value and not math.isnan(before.value):
        raise CheckFailed(f"{before.name}: expected {before.value:g}, saw {seen:g}")


@contextmanager
def restored(vehicle: VehicleUnderTest, name: str) -> Iterator[ParameterValue]:
    """Yield the current value of a parameter, and restore it at the end."""
    before = read(vehicle, name)
    with vehicle.restoring(name, lambda: restore(vehicle, before)):
        yield before


@contextmanager
def changed(vehicle: VehicleUnderTest, name: str, value: float) -> Iterator[ParameterValue]:
    """Change a parameter and yield the acknowledgement; restore the parameter at the end."""
    with restored(vehicle, name) as before:
        yield write(vehicle, name, value, before.type)


def has(vehicle: VehicleUnderTest, name: str) -> bool:
    """Return True if the vehicle lists a parameter or, before `fetch_all`, answers a read of it."""
    if vehicle.catalogue:
        return name in vehicle.catalogue
    for _ in range(2):
        vehicle.send(read_message(vehicle, name))
        if vehicle.wait_for("PARAM_VALUE", lambda m: m.param_id == name) is not None:
            return True
    return False


def value_or_none(vehicle: VehicleUnderTest, name: str) -> float | None:
    """Return the value of a parameter, or None if the vehicle does not have the parameter."""
    return read(vehicle, name).value if has(vehicle, name) else None


def harmless_change(
    vehicle: VehicleUnderTest, candidates: tuple[tuple[str, float], ...]
) -> tuple[str, float]:
    """Return name and new value of the first candidate on the vehicle; raise Skip if there is none."""
    for name, value in candidates:
        if has(vehicle, name):
            return name, value if read(vehicle, name).value != value else value + 1
    raise Skip("no parameter of this vehicle is known to be safe to change")


def is_listed(message: Any) -> bool:
    """Return True for a value of a list; a value that is reported unasked (STAT_RUNTIME) has no index."""
    return bool(message.param_index != UNINDEXED)


def request_list(vehicle: VehicleUnderTest) -> list[Any]:
    """Request the list; return its PARAM_VALUEs until a pause of `LIST_QUIET_S`, at most for `LIST_S`."""
    found: list[Any] = []
    vehicle.send(mavlink.MAVLink_param_request_list_message(*vehicle.target))
    mark, end_s = vehicle.mark(), vehicle.now + LIST_S
    while vehicle.now < end_s:
        index = vehicle.seek(("PARAM_VALUE",), is_listed, within_s=LIST_QUIET_S, mark=mark)
        if index is None:
            break
        found.append(vehicle.received[index].message)
        mark = index + 1
    if not found:
        raise CheckFailed("expected PARAM_VALUE for PARAM_REQUEST_LIST, saw none")
    return found


def fetch_all(vehicle: VehicleUnderTest) -> dict[str, ParameterValue]:
    """Fetch, store and return the parameter list; missing entries are requested by index."""
    found = [decode(vehicle, message) for message in request_list(vehicle)]
    by_index = {value.index: value for value in found}
    for index in range(found[0].count):
        if index not in by_index:
            by_index[index] = read_index(vehicle, index)
    vehicle.catalogue = {value.name: value for _, value in sorted(by_index.items())}
    return vehicle.catalogue


def listed(vehicle: VehicleUnderTest) -> dict[str, ParameterValue]:
    """Return the stored parameter list, fetched if necessary."""
    return vehicle.catalogue or fetch_all(vehicle)
