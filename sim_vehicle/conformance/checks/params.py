"""Parameters: the list, reading, writing, unknown names."""

import math
import struct
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import parameters
from sim_vehicle.conformance.assertions import at_least, equal, holds, near, one_of, within
from sim_vehicle.conformance.outcomes import CheckFailed, Skip
from sim_vehicle.conformance.registry import check, checks, row
from sim_vehicle.conformance.traffic import SECOND_STATION, Condition
from sim_vehicle.conformance.vehicle import VehicleUnderTest
from sim_vehicle.station.messages import INTEGER_RANGES

NO_SUCH = "NO_SUCH_PARAM"
SILENT_S = 1.5  # a request without an answer for this time counts as unanswered


def _integer_change(vehicle: VehicleUnderTest) -> tuple[str, int]:
    """Return name and new value of an integer parameter that is safe to change."""
    name, value = parameters.harmless_change(vehicle, vehicle.dialect.integer_parameters)
    return name, int(value)


def _real_change(vehicle: VehicleUnderTest) -> tuple[str, float]:
    return parameters.harmless_change(vehicle, vehicle.dialect.real_parameters)


def _first(vehicle: VehicleUnderTest) -> str:
    return next(iter(parameters.listed(vehicle)))


@check("parameters.list")
def is_complete(vehicle: VehicleUnderTest) -> str:
    """One request brings at least 95 % of the list; names and indices are unique, the count is constant."""
    listed = parameters.request_list(vehicle)
    count = listed[0].param_count
    equal({m.param_count for m in listed}, {count}, "param_count")
    names = {m.param_index: m.param_id for m in listed}
    within(max(names), 0, count - 1, "greatest index")
    equal(len(set(names.values())), len(names), "different names of different indices")
    at_least(len(names), 0.95 * count, "parameters")
    equal(len(parameters.fetch_all(vehicle)), count, "parameters, lost ones read by index")
    return f"{len(names)} of {count} at once"


@check("parameters.list")
def names_are_valid(vehicle: VehicleUnderTest) -> str:
    """Every name has 1 to 16 printable ASCII characters without blanks."""
    names = parameters.listed(vehicle)
    valid = [n for n in names if 1 <= len(n) <= 16 and n.isascii() and n.isprintable() and " " not in n]
    bad = sorted(set(names) - set(valid))
    holds(not bad, f"saw {bad[:3]}")
    return f"{len(names)} names"


@check("parameters.list")
def types_are_valid(vehicle: VehicleUnderTest) -> str:
    """Every type is a MAV_PARAM_TYPE of at most 32 bits; on PX4, INT32 or REAL32."""
    types = {found.type for found in parameters.listed(vehicle).values()}
    integers = {mavlink.MAV_PARAM_TYPE_INT32} if vehicle.dialect.name == "px4" else INTEGER_RANGES
    allowed = {*integers, mavlink.MAV_PARAM_TYPE_REAL32}
    equal(sorted(types - allowed), [], "other types")
    return f"types {sorted(types)}"


@check("parameters.list")
def values_fit_types(vehicle: VehicleUnderTest) -> str:
    """An integer parameter has a whole value within the range of its type; no value is NaN."""
    for found in parameters.listed(vehicle).values():
        low, high = INTEGER_RANGES.get(found.type, (-math.inf, math.inf))
        within(found.value, low, high, found.name)
        is_whole = found.type not in INTEGER_RANGES or float(found.value).is_integer()
        holds(is_whole, f"{found.name} of type {found.type} is {found.value}")
    return f"{len(vehicle.catalogue)} values"


@check("parameters.list")
def same_twice(vehicle: VehicleUnderTest) -> str:
    """Two lists have the same names in the same order."""
    first = list(parameters.listed(vehicle))
    return f"{len(equal(list(parameters.fetch_all(vehicle)), first, 'names'))} names"


def _beyond(vehicle: VehicleUnderTest) -> int:
    return len(parameters.listed(vehicle)) + 7


def _is_unanswered(
    vehicle: VehicleUnderTest,
    build: Callable[[VehicleUnderTest], Any],
    answer: Callable[[VehicleUnderTest], Condition],
) -> None:
    """A vehicle that answers a valid read does not answer this message."""
    parameters.read(vehicle, _first(vehicle))
    vehicle.send(build(vehicle))
    vehicle.expect_none("PARAM_VALUE", answer(vehicle), during_s=SILENT_S)


checks(
    "parameters", _is_unanswered,
    row("list.another_vehicles", "The vehicle does not answer a list request to another system.",
        lambda v: mavlink.MAVLink_param_request_list_message(v.unused_sysid(), v.identity.component),
        lambda _: parameters.is_listed),
    row("read.another_vehicles", "The vehicle does not answer a read request to another system.",
        lambda v: parameters.read_message(v, _first(v), sysid=v.unused_sysid()),
        lambda v: lambda m: m.param_id == _first(v)),
    row("read.unknown_name", "A read of an unknown name is not answered.",
        lambda v: parameters.read_message(v, NO_SUCH), lambda _: lambda m: m.param_id == NO_SUCH,
        source="AUTOPILOTS 1.16"),
    row("read.index_out_of_range", "A read of an index after the last parameter is not answered.",
        lambda v: parameters.read_message(v, index=_beyond(v)),
        lambda v: lambda m: m.param_index == _beyond(v) or m.param_id not in v.catalogue),
    row("set.unknown_name", "PARAM_SET of an unknown name is not answered.",
        lambda v: parameters.set_message(v, NO_SUCH, 1.0, mavlink.MAV_PARAM_TYPE_REAL32),
        lambda _: lambda m: m.param_id == NO_SUCH,
        source="AUTOPILOTS 1.16: PARAM_SET of an unknown name: no reply at all"),
)  # fmt: skip


@check("parameters.read")
def by_name(vehicle: VehicleUnderTest) -> None:
    """A read by name gives the value and type of the list."""
    for name in list(parameters.listed(vehicle))[:: max(1, len(vehicle.catalogue) // 8)]:
        listed, found = vehicle.catalogue[name], parameters.read(vehicle, name)
        near(found.value, listed.value, abs(listed.value) * 1e-6, name)
        equal(found.type, listed.type, f"type of {name}")
        one_of(found.index, (listed.index, parameters.UNINDEXED), f"index of {name}")


@check("parameters.read")
def by_index(vehicle: VehicleUnderTest) -> str:
    """A read by index gives the name and value of the list."""
    catalogue = list(parameters.listed(vehicle).values())
    for listed in (catalogue[0], catalogue[len(catalogue) // 2], catalogue[-1]):
        found = parameters.read_index(vehicle, listed.index)
        equal(found.name, listed.name, f"name of index {listed.index}")
        near(found.value, listed.value, abs(listed.value) * 1e-6, found.name)
    return f"indices 0 to {catalogue[-1].index}"


@check("parameters.read")
def long_name(vehicle: VehicleUnderTest) -> str:
    """A parameter with a name of 16 characters can be read; such a name has no final zero byte."""
    names = [name for name in parameters.listed(vehicle) if len(name) == 16]
    if not names:
        raise Skip("no parameter has a name of 16 characters")
    return parameters.read(vehicle, names[0]).name


@check("parameters.read")
def by_second_station(vehicle: VehicleUnderTest) -> str:
    """A second ground station can read a parameter."""
    name = _first(vehicle)
    request = parameters.read_message(vehicle, name)
    vehicle.ask(request, "PARAM_VALUE", lambda m: m.param_id == name, source=SECOND_STATION)
    return name


@check("parameters.set")
def is_acknowledged(vehicle: VehicleUnderTest) -> str:
    """The vehicle answers PARAM_SET with the new value in PARAM_VALUE."""
    name, value = _integer_change(vehicle)
    with parameters.changed(vehicle, name, value) as answer:
        return f"{name} = {equal(answer.value, value, name)}"


@check("parameters.set")
def is_kept(vehicle: VehicleUnderTest) -> str:
    """A new value is read back, and the old value can be restored."""
    name, value = _integer_change(vehicle)
    before = parameters.read(vehicle, name).value
    with parameters.changed(vehicle, name, value):
        equal(parameters.read(vehicle, name).value, value, name)
    equal(parameters.read(vehicle, name).value, before, f"{name} restored")
    return f"{name} {before:g} -> {value} -> {before:g}"


@check("parameters.set")
def fraction(vehicle: VehicleUnderTest) -> str:
    """A real parameter keeps its fraction in single precision."""
    name, value = _real_change(vehicle)
    single = struct.unpack("<f", struct.pack("<f", value))[0]
    with parameters.changed(vehicle, name, value):
        return f"{name} = {near(parameters.read(vehicle, name).value, single, 0.0, name):g}"


@check("parameters.set")
def same_value(vehicle: VehicleUnderTest) -> str:
    """PARAM_SET with the current value is acknowledged."""
    name, _ = _integer_change(vehicle)
    found = parameters.read(vehicle, name)
    answer = parameters.write(vehicle, name, found.value, found.type)
    return f"{name} = {equal(answer.value, found.value, name):g}"


@check("parameters.set")
def repeated(vehicle: VehicleUnderTest) -> str:
    """A repeated PARAM_SET, as after a lost answer, is acknowledged again."""
    name, value = _integer_change(vehicle)
    with parameters.changed(vehicle, name, value):
        again = parameters.write(vehicle, name, value, parameters.read(vehicle, name).type)
        return f"{name} = {equal(again.value, value, name)}"


@check("parameters.set", dialects=("ardupilot",))
def nan_is_refused(vehicle: VehicleUnderTest) -> None:
    """PARAM_SET with NaN does not change the value."""
    name, _ = _real_change(vehicle)
    with parameters.restored(vehicle, name) as before:
        vehicle.send(parameters.set_message(vehicle, name, math.nan, before.type))
        vehicle.wait(0.5)
        equal(parameters.read(vehicle, name).value, before.value, name)


@check("parameters.set")
def integer_stays_whole(vehicle: VehicleUnderTest) -> str:
    """An integer parameter stays whole after PARAM_SET with a fraction."""
    if parameters.byte_wise(vehicle):
        raise Skip("integers are sent as their bytes, which have no fraction")
    name, value = _integer_change(vehicle)
    if parameters.read(vehicle, name).type not in INTEGER_RANGES:
        raise Skip(f"{name} is no integer parameter of this vehicle")
    with parameters.changed(vehicle, name, value + 0.7):
        seen = parameters.read(vehicle, name).value
        holds(float(seen).is_integer(), f"{name}: expected a whole number, saw {seen}")
    return f"{name}: {value + 0.7:g} -> {seen:g}"


@check("parameters.set")
def wrong_type(vehicle: VehicleUnderTest) -> None:
    """PARAM_SET with another type is accepted by ArduPilot and refused by PX4."""
    accepts = vehicle.known(ardupilot=True, px4=False)
    name, value = _integer_change(vehicle)
    with parameters.restored(vehicle, name) as before:
        vehicle.send(parameters.set_message(vehicle, name, value, mavlink.MAV_PARAM_TYPE_REAL32))
        vehicle.wait(0.5)
        equal(parameters.read(vehicle, name).value, float(value) if accepts else before.value, name)


@check(
    "parameters", source="AUTOPILOTS 1.16: byte-wise in PX4 (MAV_SYS_ID reads 1.4e-45 if not reinterpreted)"
)
def encoding(vehicle: VehicleUnderTest) -> str:
    """The parameter with the system id has the right value in the autopilot's encoding."""
    for name in vehicle.dialect.sysid_parameters:
        if parameters.has(vehicle, name):
            found = parameters.read(vehicle, name)
            return f"{name} = {equal(found.value, vehicle.identity.sysid, name):g}"
    raise Skip("the parameter with the system id is unknown")


@check("parameters", dialects=("px4",))
def hash_(vehicle: VehicleUnderTest) -> None:
    """_HASH_CHECK can be read twice with the same value."""
    first = parameters.read(vehicle, "_HASH_CHECK").value
    equal(parameters.read(vehicle, "_HASH_CHECK").value, first, "_HASH_CHECK")


@check("parameters")
def many_in_a_row(vehicle: VehicleUnderTest) -> str:
    """The vehicle answers 30 simultaneous reads; unanswered reads are repeated."""
    names = list(parameters.listed(vehicle))[:30]
    unanswered, mark = set(names), vehicle.mark()
    for _ in range(4):
        for name in sorted(unanswered):
            vehicle.send(parameters.read_message(vehicle, name))
        vehicle.wait(1.0)
        unanswered -= {message.param_id for message in vehicle.since(mark, "PARAM_VALUE")}
        if not unanswered:
            return f"{len(names)} answers"
    raise CheckFailed(f"no answer to {len(unanswered)} of {len(names)} reads: {sorted(unanswered)[:3]}")
