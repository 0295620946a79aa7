"""Geofence transfer."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import parameters, plans
from sim_vehicle.conformance.assertions import equal, holds, mission_result_name, near, result_name
from sim_vehicle.conformance.plans import FENCE
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.vehicle import VehicleUnderTest, known_behaviour
from sim_vehicle.station.exchanges import REQUESTS
from sim_vehicle.station.plan_items import MISSION, PlanItem

CLAIMS = ("MISSION_FENCE",)
INCLUSION_VERTEX = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
EXCLUSION_VERTEX = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION
INCLUSION_CIRCLE = mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION
EXCLUSION_CIRCLE = mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION
ENABLE = mavlink.MAV_CMD_DO_FENCE_ENABLE
SQUARE = ((-200, -200), (-200, 200), (200, 200), (200, -200))  # metres north and east of the vehicle


def polygon(
    vehicle: VehicleUnderTest,
    corners: Sequence[tuple[float, float]] = SQUARE,
    *,
    command: int = INCLUSION_VERTEX,
    vertex_count: int | None = None,
) -> list[PlanItem]:
    """Return a polygon; `corners`: metres north and east of the vehicle; `vertex_count`: a wrong count."""
    place = plans.current_position(vehicle)
    vertices = float(len(corners) if vertex_count is None else vertex_count)
    blank = PlanItem(command, frame=mavlink.MAV_FRAME_GLOBAL, params=(vertices, 0, 0, 0))
    return [replace(blank, x=x, y=y) for x, y in (plans.offset(place, n, e) for n, e in corners)]


def circle(vehicle: VehicleUnderTest, radius_m: float, *, command: int = INCLUSION_CIRCLE) -> PlanItem:
    x, y = plans.current_position(vehicle)
    return PlanItem(command, x, y, frame=mavlink.MAV_FRAME_GLOBAL, params=(radius_m, 0, 0, 0))


@contextmanager
def fence_in_force(vehicle: VehicleUnderTest, items: Sequence[PlanItem]) -> Iterator[None]:
    """Upload and enable a fence; afterwards disable the fence and, unless a check failed, remove it."""
    plans.upload_or_fail(vehicle, items, FENCE)
    with _fence_disabled_afterwards(vehicle):
        vehicle.expect_accepted(ENABLE, 1)
        yield
    with vehicle.extra_time():
        plans.upload_or_fail(vehicle, [], FENCE)


@contextmanager
def _fence_disabled_afterwards(vehicle: VehicleUnderTest) -> Iterator[float | None]:
    """Yield the present FENCE_ENABLE (None without this parameter), and disable the fence afterwards."""
    enabled = parameters.value_or_none(vehicle, "FENCE_ENABLE")
    if enabled:
        # `restore_all` enables this fence again at the end of the run.
        vehicle.pending_restores.setdefault("the enabled fence", lambda: vehicle.expect_accepted(ENABLE, 1))
    with vehicle.restoring("the disabled fence", lambda: _disable(vehicle)):
        yield enabled


def _disable(vehicle: VehicleUnderTest) -> None:
    result = vehicle.command(ENABLE, 0)
    if result != mavlink.MAV_RESULT_UNSUPPORTED:
        equal(result_name(result), "ACCEPTED", "DO_FENCE_ENABLE 0")


def _coordinates(items: Sequence[Any]) -> list[tuple[int, int, int]]:
    return [(item.command, item.x, item.y) for item in items]


def _round_trip(vehicle: VehicleUnderTest, items: list[PlanItem]) -> list[Any]:
    plans.upload_or_fail(vehicle, items, FENCE)
    back = plans.download(vehicle, FENCE)
    equal(_coordinates(back), _coordinates(items), "fence")
    return back


def _result(vehicle: VehicleUnderTest, items: list[PlanItem]) -> str:
    return mission_result_name(plans.upload(vehicle, items, FENCE).result)


@check("fence.polygon", claims=CLAIMS)
def one_polygon(vehicle: VehicleUnderTest) -> str:
    """An inclusion polygon is accepted, and its vertices are read back exactly."""
    back = _round_trip(vehicle, polygon(vehicle))
    equal({item.param1 for item in back}, {4.0}, "vertex count")
    return "4 vertices"


@check("fence.exclusion_polygon", claims=CLAIMS)
def exclusion_polygon(vehicle: VehicleUnderTest) -> str:
    """An exclusion and an inclusion polygon are accepted, and their vertices are read back exactly."""
    triangle = ((100, 100), (150, 100), (150, 150))
    _round_trip(vehicle, [*polygon(vehicle), *polygon(vehicle, triangle, command=EXCLUSION_VERTEX)])
    return "4 and 3 vertices"


@check("fence.circle", claims=CLAIMS)
def one_circle(vehicle: VehicleUnderTest) -> str:
    """An inclusion circle keeps its radius."""
    back = _round_trip(vehicle, [circle(vehicle, 250.0)])
    near(back[0].param1, 250.0, 0.5, "radius")
    return f"{back[0].param1:g} m"


@check("fence.exclusion_circle", claims=CLAIMS)
def exclusion_circle(vehicle: VehicleUnderTest) -> str:
    """An inclusion and an exclusion circle are accepted, and their centres are read back exactly."""
    place = plans.offset(plans.current_position(vehicle), 120, 0)
    out = replace(circle(vehicle, 20.0, command=EXCLUSION_CIRCLE), x=place[0], y=place[1])
    _round_trip(vehicle, [circle(vehicle, 300.0), out])
    return "2 circles"


@check(
    "fence.read_back_frame", claims=CLAIMS, source="AUTOPILOTS 2: fence read back frame 0 / read-back frame 5"
)
def read_back_frame(vehicle: VehicleUnderTest) -> str:
    """Items are read back in frame 0 on ArduPilot and in frame 5 on PX4."""
    expected = known_behaviour(vehicle, ardupilot=0, px4=5)
    plans.upload_or_fail(vehicle, polygon(vehicle), FENCE)
    equal({item.frame for item in plans.download(vehicle, FENCE)}, {expected}, "frames")
    return str(expected)


@check(
    "fence.relative_frame",
    claims=CLAIMS,
    source="AUTOPILOTS 2: fence frames 0,3,5,6 / frame 0 and 3 accepted",
)
def relative_frame(vehicle: VehicleUnderTest) -> str:
    """Items in frame 3 are accepted."""
    known_behaviour(vehicle, ardupilot=True, px4=True)
    equal(_result(vehicle, [replace(i, frame=3) for i in polygon(vehicle)]), "ACCEPTED", "frame 3")
    return "ACCEPTED"


@check(
    "fence.mission_frame",
    claims=CLAIMS,
    dialects=("ardupilot",),
    source="AUTOPILOTS 2: fence frames (2 refused)",
)
def fence_mission_frame(vehicle: VehicleUnderTest) -> str:
    """Items in frame 2 are refused."""
    seen = _result(vehicle, [replace(i, frame=2) for i in polygon(vehicle)])
    holds(seen != "ACCEPTED", "expected a refusal, saw ACCEPTED")
    return seen


@check("fence.two_vertices", claims=CLAIMS, source="AUTOPILOTS 2: 2-vertex polygon -> ERROR")
def two_vertices(vehicle: VehicleUnderTest) -> str:
    """A polygon of two vertices is refused."""
    seen = _result(vehicle, polygon(vehicle, SQUARE[:2]))
    holds(seen != "ACCEPTED", "expected a refusal, saw ACCEPTED")
    if vehicle.dialect.known:
        equal(seen, "ERROR", "2 vertices")
    return seen


@check("fence.wrong_vertex_count", claims=CLAIMS, source="AUTOPILOTS 2: wrong vertex count")
def wrong_vertex_count(vehicle: VehicleUnderTest) -> str:
    """A polygon of four vertices with a vertex count of 6 is an ERROR on ArduPilot, ACCEPTED on PX4."""
    expected = known_behaviour(vehicle, ardupilot="ERROR", px4="ACCEPTED")
    equal(_result(vehicle, polygon(vehicle, vertex_count=6)), expected, "vertex count 6 for 4 vertices")
    return str(expected)


@check(
    "fence.refusal_keeps_the_old",
    claims=CLAIMS,
    source="AUTOPILOTS 2: fence atomic, old fence kept on failure",
)
def old_fence_stays(vehicle: VehicleUnderTest) -> str:
    """After a refused upload the vehicle keeps its old fence."""
    old = polygon(vehicle)
    plans.upload_or_fail(vehicle, old, FENCE)
    holds(_result(vehicle, polygon(vehicle, SQUARE[:2])) != "ACCEPTED", "2 vertices were accepted")
    equal(_coordinates(plans.download(vehicle, FENCE)), _coordinates(old), "fence")
    return "kept"


@check(
    "fence.self_intersecting",
    claims=CLAIMS,
    dialects=("ardupilot",),
    source="AUTOPILOTS 2: self-intersecting accepted",
)
def self_intersecting(vehicle: VehicleUnderTest) -> str:
    """A self-intersecting polygon is accepted, and its vertices are read back exactly."""
    _round_trip(vehicle, polygon(vehicle, (SQUARE[0], SQUARE[2], SQUARE[1], SQUARE[3])))
    return "ACCEPTED"


@check(
    "fence.too_large",
    claims=CLAIMS,
    dialects=("ardupilot",),
    source="AUTOPILOTS 2: 200 -> NO_SPACE",
    limit_s=90,
)
def too_large(vehicle: VehicleUnderTest) -> str:
    """A fence of 200 vertices is refused, and the old fence stays."""
    old = polygon(vehicle)
    plans.upload_or_fail(vehicle, old, FENCE)
    corners = [(200 - i, 150.0 + i % 2) for i in range(200)]
    seen = _result(vehicle, polygon(vehicle, corners))
    equal(seen, "NO_SPACE", "200 vertices")
    equal(_coordinates(plans.download(vehicle, FENCE)), _coordinates(old), "fence")
    return seen


@check(
    "fence.total_parameter",
    claims=CLAIMS,
    dialects=("ardupilot",),
    source="AUTOPILOTS 2: FENCE_TOTAL reads 6",
)
def total_parameter(vehicle: VehicleUnderTest) -> str:
    """FENCE_TOTAL reads 6 for a polygon of four vertices."""
    plans.upload_or_fail(vehicle, polygon(vehicle), FENCE)
    equal(parameters.read(vehicle, "FENCE_TOTAL").value, 6, "FENCE_TOTAL")
    return "6"


@check("fence.clear", claims=CLAIMS)
def clear(vehicle: VehicleUnderTest) -> str:
    """Clearing removes the fence."""
    plans.upload_or_fail(vehicle, polygon(vehicle), FENCE)
    equal(mission_result_name(plans.clear(vehicle, FENCE)), "ACCEPTED", "MISSION_CLEAR_ALL")
    equal(plans.count(vehicle, FENCE), 0, "items left")
    return "empty"


@check("fence.is_not_the_mission", claims=CLAIMS)
def is_not_the_mission(vehicle: VehicleUnderTest) -> str:
    """The upload of a fence does not change the mission; clearing the mission does not change the fence."""
    mission, fence = plans.sample_plan(vehicle), polygon(vehicle)
    plans.upload_or_fail(vehicle, mission)
    plans.upload_or_fail(vehicle, fence, FENCE)
    equal(plans.coordinates(vehicle, plans.download(vehicle)), plans.coordinates(vehicle, mission), "mission")
    plans.clear(vehicle, MISSION)
    equal(_coordinates(plans.download(vehicle, FENCE)), _coordinates(fence), "fence")
    return "independent"


@check("fence.wrong_command", claims=CLAIMS, dialects=("ardupilot", "mavlink"))
def wrong_command(vehicle: VehicleUnderTest) -> str:
    """A waypoint in a fence is refused."""
    seen = _result(vehicle, [replace(circle(vehicle, 250), command=mavlink.MAV_CMD_NAV_WAYPOINT)])
    holds(seen != "ACCEPTED", "expected a refusal, saw ACCEPTED")
    return seen


@check(
    "fence.interleaved_with_mission",
    claims=CLAIMS,
    dialects=("ardupilot",),
    source="AUTOPILOTS 2: mission and fence uploads may run interleaved",
)
def interleaved(vehicle: VehicleUnderTest) -> str:
    """A mission and a fence can be uploaded at the same time, item by item."""
    sent = {MISSION: plans.sample_plan(vehicle, 4), FENCE: polygon(vehicle)}
    mark = vehicle.mark()
    for kind, items in sent.items():
        vehicle.send(plans.count_message(vehicle, len(items), kind))
    results: dict[int, int] = {}
    while len(results) < 2:
        index = vehicle.seek((*REQUESTS, "MISSION_ACK"), within_s=3.0, mark=mark)
        holds(index is not None, f"no request or result within 3 s; results so far by type: {results}")
        assert index is not None
        entry, mark = vehicle.received[index], index + 1
        kind = entry.message.mission_type
        if entry.kind == "MISSION_ACK":
            results[kind] = entry.message.type
        else:
            seq = entry.message.seq
            vehicle.send(sent[kind][seq].message(vehicle.target, seq, kind))
    equal(results, {MISSION: 0, FENCE: 0}, "results by type")
    equal(_coordinates(plans.download(vehicle, FENCE)), _coordinates(sent[FENCE]), "fence")
    equal(
        plans.coordinates(vehicle, plans.download(vehicle)),
        plans.coordinates(vehicle, sent[MISSION]),
        "mission",
    )
    return "both ACCEPTED"


@check("fence.enable_command", claims=CLAIMS, source="AUTOPILOTS 2: MAV_CMD_DO_FENCE_ENABLE(207)")
def enable_command(vehicle: VehicleUnderTest) -> str:
    """DO_FENCE_ENABLE is ACCEPTED on ArduPilot, without a change of FENCE_ENABLE, and UNSUPPORTED on PX4."""
    expected = known_behaviour(vehicle, ardupilot="ACCEPTED", px4="UNSUPPORTED")
    plans.upload_or_fail(vehicle, polygon(vehicle), FENCE)
    with _fence_disabled_afterwards(vehicle) as before:
        seen = result_name(vehicle.command(ENABLE, 1))
        after = parameters.value_or_none(vehicle, "FENCE_ENABLE")
    equal(seen, expected, "DO_FENCE_ENABLE")
    equal(after, before, "FENCE_ENABLE")
    return seen


@check("fence.empty_upload", claims=CLAIMS)
def empty_upload(vehicle: VehicleUnderTest) -> str:
    """An empty upload is accepted and removes the fence."""
    plans.upload_or_fail(vehicle, polygon(vehicle), FENCE)
    equal(plans.count(vehicle, FENCE), len(SQUARE), "items before")
    plans.upload_or_fail(vehicle, [], FENCE)
    equal(plans.count(vehicle, FENCE), 0, "items left")
    return "empty"
