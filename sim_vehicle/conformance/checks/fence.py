"""Geofence transfer."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import parameters, plans
from sim_vehicle.conformance.peer import Peer, known
from sim_vehicle.conformance.plans import FENCE, MISSION, Item
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.words import equal, holds, mission_result_name, near, result_name

CLAIMS = ("MISSION_FENCE",)
INSIDE = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
OUTSIDE = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION
CIRCLE_INSIDE = mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION
CIRCLE_OUTSIDE = mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION
ENABLE = mavlink.MAV_CMD_DO_FENCE_ENABLE
SQUARE = ((-200, -200), (-200, 200), (200, 200), (200, -200))


def polygon(
    peer: Peer,
    corners: Sequence[tuple[float, float]] = SQUARE,
    *,
    command: int = INSIDE,
    told: int | None = None,
) -> list[Item]:
    """A polygon around the vehicle; `told` is the vertex count its items give, if not the true one."""
    place = plans.here(peer)
    vertices = float(len(corners) if told is None else told)
    blank = Item(command, frame=mavlink.MAV_FRAME_GLOBAL, params=(vertices, 0, 0, 0))
    return [replace(blank, x=x, y=y) for x, y in (plans.moved(place, n, e) for n, e in corners)]


def circle(peer: Peer, radius_m: float, *, command: int = CIRCLE_INSIDE) -> Item:
    x, y = plans.here(peer)
    return Item(command, x, y, frame=mavlink.MAV_FRAME_GLOBAL, params=(radius_m, 0, 0, 0))


@contextmanager
def fence_in_force(peer: Peer, items: Sequence[Item]) -> Iterator[None]:
    """The vehicle heeds this fence for a while, and none afterwards."""
    plans.put(peer, items, FENCE)
    with _switched(peer):
        peer.accepted(ENABLE, 1)
        yield
    with peer.tidying():
        plans.put(peer, [], FENCE)


@contextmanager
def _switched(peer: Peer) -> Iterator[float | None]:
    """The fence is switched on here and off afterwards; what FENCE_ENABLE says."""
    parameter = parameters.setting(peer, "FENCE_ENABLE")
    if parameter:
        # Whose fence was on has it on again, once its own fence is there again.
        peer.debts.setdefault("the fence's being on", lambda: peer.accepted(ENABLE, 1))
    with peer.owing("the fence's being off", lambda: _off(peer)):
        yield parameter


def _off(peer: Peer) -> None:
    result = peer.command(ENABLE, 0)
    if result != mavlink.MAV_RESULT_UNSUPPORTED:
        equal(result_name(result), "ACCEPTED", "DO_FENCE_ENABLE 0")


def _places(items: Sequence[Any]) -> list[tuple[int, int, int]]:
    return [(item.command, item.x, item.y) for item in items]


def _round_trip(peer: Peer, items: list[Item]) -> list[Any]:
    plans.put(peer, items, FENCE)
    back = plans.download(peer, FENCE)
    equal(_places(back), _places(items), "fence")
    return back


def _result(peer: Peer, items: list[Item]) -> str:
    return mission_result_name(plans.upload(peer, items, FENCE).result)


@check("fence.polygon", claims=CLAIMS)
def one_polygon(peer: Peer) -> str:
    """A polygon to stay in is accepted and read back to the last digit."""
    back = _round_trip(peer, polygon(peer))
    equal({item.param1 for item in back}, {4.0}, "vertex count")
    return "4 vertices"


@check("fence.exclusion_polygon", claims=CLAIMS)
def exclusion_polygon(peer: Peer) -> str:
    """A polygon to stay out of, beside one to stay in."""
    triangle = ((100, 100), (150, 100), (150, 150))
    _round_trip(peer, [*polygon(peer), *polygon(peer, triangle, command=OUTSIDE)])
    return "4 and 3 vertices"


@check("fence.circle", claims=CLAIMS)
def one_circle(peer: Peer) -> str:
    """A circle to stay in keeps its radius."""
    back = _round_trip(peer, [circle(peer, 250.0)])
    near(back[0].param1, 250.0, 0.5, "radius")
    return f"{back[0].param1:g} m"


@check("fence.exclusion_circle", claims=CLAIMS)
def exclusion_circle(peer: Peer) -> str:
    """Circles of both kinds together."""
    place = plans.moved(plans.here(peer), 120, 0)
    out = replace(circle(peer, 20.0, command=CIRCLE_OUTSIDE), x=place[0], y=place[1])
    _round_trip(peer, [circle(peer, 300.0), out])
    return "2 circles"


@check(
    "fence.read_back_frame", claims=CLAIMS, pins="AUTOPILOTS 2: fence read back frame 0 / read-back frame 5"
)
def read_back_frame(peer: Peer) -> str:
    """Items come back in frame 0 from ArduPilot, in 5 from PX4."""
    expected = known(peer, ardupilot=0, px4=5)
    plans.put(peer, polygon(peer), FENCE)
    equal({item.frame for item in plans.download(peer, FENCE)}, {expected}, "frames")
    return str(expected)


@check(
    "fence.relative_frame", claims=CLAIMS, pins="AUTOPILOTS 2: fence frames 0,3,5,6 / frame 0 and 3 accepted"
)
def relative_frame(peer: Peer) -> str:
    """Frame 3 is accepted as well as 0."""
    known(peer, ardupilot=True, px4=True)
    equal(_result(peer, [replace(i, frame=3) for i in polygon(peer)]), "ACCEPTED", "frame 3")
    return "ACCEPTED"


@check(
    "fence.mission_frame",
    claims=CLAIMS,
    dialects=("ardupilot",),
    pins="AUTOPILOTS 2: fence frames (2 refused)",
)
def fence_mission_frame(peer: Peer) -> str:
    """Frame 2 is refused."""
    seen = _result(peer, [replace(i, frame=2) for i in polygon(peer)])
    holds(seen != "ACCEPTED", "expected a refusal, saw ACCEPTED")
    return seen


@check("fence.two_vertices", claims=CLAIMS, pins="AUTOPILOTS 2: 2-vertex polygon -> ERROR")
def two_vertices(peer: Peer) -> str:
    """A polygon of two vertices is refused."""
    seen = _result(peer, polygon(peer, SQUARE[:2]))
    holds(seen != "ACCEPTED", "expected a refusal, saw ACCEPTED")
    if peer.dialect.known:
        equal(seen, "ERROR", "2 vertices")
    return seen


@check("fence.wrong_vertex_count", claims=CLAIMS, pins="AUTOPILOTS 2: wrong vertex count")
def wrong_vertex_count(peer: Peer) -> str:
    """Four vertices that claim to be six: ERROR from ArduPilot, ACCEPTED from PX4."""
    expected = known(peer, ardupilot="ERROR", px4="ACCEPTED")
    equal(_result(peer, polygon(peer, told=6)), expected, "6 for 4")
    return str(expected)


@check("fence.old_one_stays", claims=CLAIMS, pins="AUTOPILOTS 2: fence atomic, old fence kept on failure")
def old_one_stays(peer: Peer) -> str:
    """A fence that is refused leaves the old one."""
    old = polygon(peer)
    plans.put(peer, old, FENCE)
    holds(_result(peer, polygon(peer, SQUARE[:2])) != "ACCEPTED", "2 vertices were accepted")
    equal(_places(plans.download(peer, FENCE)), _places(old), "fence")
    return "kept"


@check(
    "fence.self_intersecting",
    claims=CLAIMS,
    dialects=("ardupilot",),
    pins="AUTOPILOTS 2: self-intersecting accepted",
)
def self_intersecting(peer: Peer) -> str:
    """A polygon that crosses itself is accepted."""
    _round_trip(peer, polygon(peer, (SQUARE[0], SQUARE[2], SQUARE[1], SQUARE[3])))
    return "ACCEPTED"


@check(
    "fence.too_large",
    claims=CLAIMS,
    dialects=("ardupilot",),
    pins="AUTOPILOTS 2: 200 -> NO_SPACE",
    limit_s=90,
)
def too_large(peer: Peer) -> str:
    """Two hundred vertices do not fit, and the old fence stays."""
    old = polygon(peer)
    plans.put(peer, old, FENCE)
    corners = [(200 - i, 150.0 + i % 2) for i in range(200)]
    seen = _result(peer, polygon(peer, corners))
    equal(seen, "NO_SPACE", "200 vertices")
    equal(_places(plans.download(peer, FENCE)), _places(old), "fence")
    return seen


@check(
    "fence.total_parameter", claims=CLAIMS, dialects=("ardupilot",), pins="AUTOPILOTS 2: FENCE_TOTAL reads 6"
)
def total_parameter(peer: Peer) -> str:
    """FENCE_TOTAL reads 6 for a polygon of four vertices."""
    plans.put(peer, polygon(peer), FENCE)
    equal(parameters.read(peer, "FENCE_TOTAL").value, 6, "FENCE_TOTAL")
    return "6"


@check("fence.clear", claims=CLAIMS)
def clear(peer: Peer) -> str:
    """Clearing removes the fence."""
    plans.put(peer, polygon(peer), FENCE)
    equal(mission_result_name(plans.clear(peer, FENCE)), "ACCEPTED", "MISSION_CLEAR_ALL")
    equal(plans.count(peer, FENCE), 0, "items left")
    return "empty"


@check("fence.is_not_the_mission", claims=CLAIMS)
def is_not_the_mission(peer: Peer) -> str:
    """Writing and clearing a fence leaves the mission alone, and the other way round."""
    mission, fence = plans.sample_plan(peer), polygon(peer)
    plans.put(peer, mission)
    plans.put(peer, fence, FENCE)
    equal(plans.body(peer, plans.download(peer)), plans.body(peer, mission), "mission")
    plans.clear(peer, MISSION)
    equal(_places(plans.download(peer, FENCE)), _places(fence), "fence")
    return "independent"


@check("fence.wrong_command", claims=CLAIMS, dialects=("ardupilot", "mavlink"))
def wrong_command(peer: Peer) -> str:
    """A waypoint in a fence is refused."""
    seen = _result(peer, [replace(circle(peer, 250), command=mavlink.MAV_CMD_NAV_WAYPOINT)])
    holds(seen != "ACCEPTED", "expected a refusal, saw ACCEPTED")
    return seen


@check(
    "fence.interleaved_with_mission",
    claims=CLAIMS,
    dialects=("ardupilot",),
    pins="AUTOPILOTS 2: mission and fence uploads may run interleaved",
)
def interleaved(peer: Peer) -> str:
    """A mission and a fence go up at the same time, item by item."""
    wanted = {MISSION: plans.sample_plan(peer, 4), FENCE: polygon(peer)}
    mark = peer.mark()
    for kind, items in wanted.items():
        peer.send(plans.count_message(peer, len(items), kind))
    results: dict[int, int] = {}
    while len(results) < 2:
        place = peer.seek((*plans.REQUESTS, "MISSION_ACK"), within_s=3.0, mark=mark)
        holds(place is not None, f"the uploads stopped; finished: {results}")
        assert place is not None
        entry, mark = peer.heard[place], place + 1
        kind = entry.message.mission_type
        if entry.kind == "MISSION_ACK":
            results[kind] = entry.message.type
        else:
            seq = entry.message.seq
            peer.send(wanted[kind][seq].message(peer, seq, kind))
    equal(results, {MISSION: 0, FENCE: 0}, "results by type")
    equal(_places(plans.download(peer, FENCE)), _places(wanted[FENCE]), "fence")
    equal(plans.body(peer, plans.download(peer)), plans.body(peer, wanted[MISSION]), "mission")
    return "both ACCEPTED"


@check("fence.enable_command", claims=CLAIMS, pins="AUTOPILOTS 2: MAV_CMD_DO_FENCE_ENABLE(207)")
def enable_command(peer: Peer) -> str:
    """DO_FENCE_ENABLE: accepted by ArduPilot without a change of FENCE_ENABLE, UNSUPPORTED for PX4."""
    expected = known(peer, ardupilot="ACCEPTED", px4="UNSUPPORTED")
    plans.put(peer, polygon(peer), FENCE)
    with _switched(peer) as before:
        seen = result_name(peer.command(ENABLE, 1))
        after = parameters.setting(peer, "FENCE_ENABLE")
    equal(seen, expected, "DO_FENCE_ENABLE")
    equal(after, before, "FENCE_ENABLE")
    return seen


@check("fence.leaves_nothing", claims=CLAIMS)
def leaves_nothing(peer: Peer) -> str:
    """An empty upload is accepted: no fence is in the way of what follows."""
    plans.put(peer, [], FENCE)
    equal(plans.count(peer, FENCE), 0, "items left")
    return "empty"
