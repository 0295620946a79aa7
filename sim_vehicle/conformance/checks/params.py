"""Parameters: the list, reading, writing, and what is not there."""

import math
import struct

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import parameters as p
from sim_vehicle.conformance.peer import SECOND_STATION, Peer, known
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.words import CheckFailed, Skip, equal, holds, near

NO_SUCH = "NO_SUCH_PARAM"
SILENT_S = 1.5


def _whole(peer: Peer) -> tuple[str, int]:
    name, value = p.harmless(peer, peer.dialect.whole_parameters)
    return name, int(value)


def _real(peer: Peer) -> tuple[str, float]:
    return p.harmless(peer, peer.dialect.real_parameters)


@check("parameters.list.is_complete", limit_s=150)
def list_is_complete(peer: Peer) -> str:
    """PARAM_REQUEST_LIST brings every index."""
    found = p.fetch_all(peer)
    counts = {value.count for value in found.values()}
    equal(counts, {len(found)}, "param_count")
    return f"{len(found)} parameters"


@check("parameters.list.another_vehicles")
def list_anothers(peer: Peer) -> str:
    """A list that another system is asked for does not come."""
    p.read(peer, next(iter(p.listed(peer))))  # it does answer
    peer.send(mavlink.MAVLink_param_request_list_message(peer.stranger(), peer.facts.component))
    peer.none("PARAM_VALUE", during_s=SILENT_S)
    return "no answer"


@check("parameters.list.names_are_valid")
def names_are_valid(peer: Peer) -> str:
    """Names are 1 to 16 printable characters without blanks, each once."""
    bad = [
        n
        for n in p.listed(peer)
        if not 1 <= len(n) <= 16 or not n.isascii() or not n.isprintable() or " " in n
    ]
    holds(not bad, f"saw {bad[:3]}")
    return f"{len(peer.catalogue)} names"


@check("parameters.list.types_are_valid")
def types_are_valid(peer: Peer) -> str:
    """Every type is a MAV_PARAM_TYPE that fits into the message."""
    types = {found.type for found in p.listed(peer).values()}
    allowed = {*p.WHOLE_RANGES, mavlink.MAV_PARAM_TYPE_REAL32}
    if peer.dialect.name == "px4":
        allowed = {mavlink.MAV_PARAM_TYPE_INT32, mavlink.MAV_PARAM_TYPE_REAL32}
    holds(types <= allowed, f"expected types of {sorted(allowed)}, saw {sorted(types - allowed)}")
    return f"types {sorted(types)}"


@check("parameters.list.values_fit_types")
def values_fit_types(peer: Peer) -> str:
    """An integer parameter has a whole value within the range of its type; no value is NaN."""
    for found in p.listed(peer).values():
        low, high = p.WHOLE_RANGES.get(found.type, (-math.inf, math.inf))
        whole = found.type not in p.WHOLE_RANGES or float(found.value).is_integer()
        holds(whole and low <= found.value <= high, f"{found.name} of type {found.type} is {found.value}")
    return f"{len(peer.catalogue)} values"


@check("parameters.list.same_twice", limit_s=150)
def same_twice(peer: Peer) -> str:
    """The list has the same names in the same order when it is asked for again."""
    first = list(p.listed(peer))
    equal(list(p.fetch_all(peer)), first, "names")
    return f"{len(first)} names"


@check("parameters.read.by_name")
def read_by_name(peer: Peer) -> str:
    """Reading by name gives the value of the list."""
    for name in list(p.listed(peer))[:: max(1, len(peer.catalogue) // 8)]:
        listed, found = peer.catalogue[name], p.read(peer, name)
        near(found.value, listed.value, abs(listed.value) * 1e-6, name)
        equal(found.type, listed.type, f"type of {name}")
        holds(
            found.index in (listed.index, p.UNINDEXED),
            f"{name}: index {listed.index} in the list, {found.index} read",
        )
    return "equal to the list"


@check("parameters.read.by_index")
def read_by_index(peer: Peer) -> str:
    """Reading by index gives the name and value of the list."""
    catalogue = list(p.listed(peer).values())
    for listed in (catalogue[0], catalogue[len(catalogue) // 2], catalogue[-1]):
        found = p.read_index(peer, listed.index)
        equal(found.name, listed.name, f"name of index {listed.index}")
        near(found.value, listed.value, abs(listed.value) * 1e-6, found.name)
    return f"indices 0 to {catalogue[-1].index}"


@check("parameters.read.long_name")
def read_long_name(peer: Peer) -> str:
    """A name of 16 characters, which ends without a zero, is found."""
    names = [name for name in p.listed(peer) if len(name) == 16]
    if not names:
        raise Skip("no parameter has a name of 16 characters")
    p.read(peer, names[0])
    return names[0]


@check("parameters.read.unknown_name", pins="AUTOPILOTS 1.16")
def read_unknown(peer: Peer) -> str:
    """Reading a name that is not there brings no value."""
    p.read(peer, next(iter(p.listed(peer))))  # it does answer
    peer.send(p.read_message(peer, NO_SUCH))
    peer.none("PARAM_VALUE", lambda m: m.param_id == NO_SUCH, during_s=SILENT_S)
    return "no PARAM_VALUE"


@check("parameters.read.index_out_of_range")
def read_out_of_range(peer: Peer) -> str:
    """Reading an index behind the end brings no value."""
    index = len(p.listed(peer)) + 7
    peer.send(p.read_message(peer, index=index))
    peer.none("PARAM_VALUE", lambda m: m.param_index in (index, p.UNINDEXED), during_s=SILENT_S)
    return f"no PARAM_VALUE for index {index}"


@check("parameters.read.by_second_station")
def read_by_second_station(peer: Peer) -> str:
    """Another ground station reads as well."""
    name = next(iter(p.listed(peer)))
    peer.ask(p.read_message(peer, name), "PARAM_VALUE", lambda m: m.param_id == name, source=SECOND_STATION)
    return name


@check("parameters.read.another_vehicles")
def read_anothers(peer: Peer) -> str:
    """A request to another system is not answered."""
    name = next(iter(p.listed(peer)))
    peer.send(p.read_message(peer, name, sysid=peer.stranger()))
    peer.none("PARAM_VALUE", during_s=SILENT_S)
    return "no answer"


@check("parameters.set.is_acknowledged")
def set_acknowledged(peer: Peer) -> str:
    """PARAM_SET is answered by PARAM_VALUE with the new value."""
    name, value = _whole(peer)
    with p.changed(peer, name, value) as answer:
        equal(answer.value, value, name)
    return f"{name} = {value}"


@check("parameters.set.is_kept")
def set_kept(peer: Peer) -> str:
    """What was set is read afterwards, and can be set back."""
    name, value = _whole(peer)
    before = p.read(peer, name).value
    with p.changed(peer, name, value):
        equal(p.read(peer, name).value, value, name)
    equal(p.read(peer, name).value, before, f"{name} set back")
    return f"{name} {before:g} -> {value} -> {before:g}"


@check("parameters.set.fraction")
def set_fraction(peer: Peer) -> str:
    """A real parameter keeps its fraction in single precision."""
    name, value = _real(peer)
    with p.changed(peer, name, value):
        near(p.read(peer, name).value, struct.unpack("<f", struct.pack("<f", value))[0], 0.0, name)
    return f"{name} = {value:g}"


@check("parameters.set.same_value")
def set_same(peer: Peer) -> str:
    """Setting the value it has is acknowledged as well."""
    name, _ = _whole(peer)
    found = p.read(peer, name)
    equal(p.write(peer, name, found.value, found.type).value, found.value, name)
    return f"{name} = {found.value:g}"


@check("parameters.set.repeated")
def set_repeated(peer: Peer) -> str:
    """The same PARAM_SET twice, as after a lost answer, is acknowledged twice."""
    name, value = _whole(peer)
    with p.changed(peer, name, value):
        again = p.write(peer, name, value, p.read(peer, name).type)
        equal(again.value, value, name)
    return f"{name} = {value}"


@check("parameters.set.unknown_name", pins="AUTOPILOTS 1.16: PARAM_SET of an unknown name: no reply at all")
def set_unknown(peer: Peer) -> str:
    """Setting a name that is not there brings no value."""
    p.read(peer, next(iter(p.listed(peer))))  # it does answer
    peer.send(p.set_message(peer, NO_SUCH, 1.0, mavlink.MAV_PARAM_TYPE_REAL32))
    peer.none("PARAM_VALUE", lambda m: m.param_id == NO_SUCH, during_s=SILENT_S)
    return "no PARAM_VALUE"


@check("parameters.set.nan_is_refused", dialects=("ardupilot",))
def set_nan(peer: Peer) -> str:
    """NaN does not become a parameter's value."""
    name, _ = _real(peer)
    with p.kept(peer, name) as before:
        peer.send(p.set_message(peer, name, math.nan, before.type))
        peer.wait(0.5)
        equal(p.read(peer, name).value, before.value, name)
    return "unchanged"


@check("parameters.set.integer_stays_whole")
def integer_stays_whole(peer: Peer) -> str:
    """An integer parameter never reads a fraction, whatever was set."""
    if p.byte_wise(peer):
        raise Skip("integers travel as their bytes: there is no fraction to send")
    name, value = _whole(peer)
    if p.read(peer, name).type not in p.WHOLE_RANGES:
        raise Skip(f"{name} is no integer parameter here")
    with p.changed(peer, name, value + 0.7):
        seen = p.read(peer, name).value
        holds(float(seen).is_integer(), f"{name}: expected a whole number, saw {seen}")
    return f"{name}: {value + 0.7:g} -> {seen:g}"


@check("parameters.set.wrong_type")
def set_wrong_type(peer: Peer) -> str:
    """A PARAM_SET with another type: ArduPilot goes by the value, PX4 refuses."""
    takes = known(peer, ardupilot=True, px4=False)
    name, value = _whole(peer)
    with p.kept(peer, name) as before:
        peer.send(p.set_message(peer, name, value, mavlink.MAV_PARAM_TYPE_REAL32))
        peer.wait(0.5)
        after = p.read(peer, name)
    equal(after.value, float(value) if takes else before.value, name)
    return "taken" if takes else "refused"


@check(
    "parameters.encoding",
    pins="AUTOPILOTS 1.16: byte-wise in PX4 (MAV_SYS_ID reads 1.4e-45 if not reinterpreted)",
)
def encoding(peer: Peer) -> str:
    """The system id as a parameter reads as the system id, in the encoding of the autopilot."""
    names = [name for name in peer.dialect.sysid_parameters if p.has(peer, name)]
    if not names:
        raise Skip("no parameter is known that holds the system id")
    found = p.read(peer, names[0])
    equal(found.value, peer.facts.sysid, names[0])
    return f"{names[0]} = {found.value:g}"


@check("parameters.hash", dialects=("px4",))
def hash_check(peer: Peer) -> str:
    """_HASH_CHECK can be read, and is the same twice."""
    first, second = p.read(peer, "_HASH_CHECK"), p.read(peer, "_HASH_CHECK")
    equal(second.value, first.value, "_HASH_CHECK")
    return "equal"


@check("parameters.many_in_a_row")
def many_in_a_row(peer: Peer) -> str:
    """Thirty reads sent at once are all answered, those the link lost on being repeated."""
    names = list(p.listed(peer))[:30]
    open_names, mark = set(names), peer.mark()
    for _ in range(4):
        for name in sorted(open_names):
            peer.send(p.read_message(peer, name))
        peer.wait(1.0)
        open_names -= {message.param_id for message in peer.since(mark, "PARAM_VALUE")}
        if not open_names:
            return f"{len(names)} answers"
    raise CheckFailed(f"{len(open_names)} of {len(names)} never came: {sorted(open_names)[:3]}")
