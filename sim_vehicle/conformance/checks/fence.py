"""Fences and rally points."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import parameters, plans
from sim_vehicle.conformance.assertions import equal, near, refused
from sim_vehicle.conformance.outcomes import ACCEPTED
from sim_vehicle.conformance.plans import FENCE, RALLY
from sim_vehicle.conformance.registry import KNOWN, check, checks, row
from sim_vehicle.conformance.vehicle import VehicleUnderTest
from sim_vehicle.station.messages import MISSION, PlanItem

CLAIMS, RALLY_CLAIMS = ("MISSION_FENCE",), ("MISSION_RALLY",)
INCLUSION_VERTEX = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
EXCLUSION_VERTEX = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION
INCLUSION_CIRCLE = mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION
EXCLUSION_CIRCLE = mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION
ENABLE = mavlink.MAV_CMD_DO_FENCE_ENABLE
SQUARE = ((-200, -200), (-200, 200), (200, 200), (200, -200))  # metres north and east of the vehicle
CROSSED = (SQUARE[0], SQUARE[2], SQUARE[1], SQUARE[3])
TRIANGLE = ((100, 100), (150, 100), (150, 150))
Build = Callable[[VehicleUnderTest], list[PlanItem]]


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


def circle(
    vehicle: VehicleUnderTest, radius_m: float, *, north_m: float = 0, command: int = INCLUSION_CIRCLE
) -> PlanItem:
    x, y = plans.offset(plans.current_position(vehicle), north_m, 0)
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
    if result != "UNSUPPORTED":
        equal(result, ACCEPTED, "DO_FENCE_ENABLE 0")


def _result(vehicle: VehicleUnderTest, items: Sequence[PlanItem]) -> str:
    return plans.upload(vehicle, items, FENCE).result


def _in_frame(items: Sequence[PlanItem], frame: int) -> list[PlanItem]:
    return [replace(item, frame=frame) for item in items]


def _store_square(vehicle: VehicleUnderTest) -> list[PlanItem]:
    items = polygon(vehicle)
    plans.upload_or_fail(vehicle, items, FENCE)
    return items


def _round_trip(vehicle: VehicleUnderTest, build: Build) -> None:
    """The fence is accepted and read back, param1 (vertex count, radius) included."""
    items = build(vehicle)
    for seen, sent in zip(plans.store(vehicle, items, FENCE), items, strict=True):
        near(seen.param1, sent.params[0], 0.5, "vertex count or radius")


checks(
    "fence", _round_trip,
    row("polygon", "An inclusion polygon is accepted, and its vertices are read back exactly.", polygon),
    row("exclusion_polygon",
        "An exclusion and an inclusion polygon are accepted, and their vertices are read back exactly.",
        lambda v: [*polygon(v), *polygon(v, TRIANGLE, command=EXCLUSION_VERTEX)]),
    row("circle", "An inclusion circle keeps its radius.", lambda v: [circle(v, 250)]),
    row("exclusion_circle",
        "An inclusion and an exclusion circle are accepted, and their centres are read back exactly.",
        lambda v: [circle(v, 300), circle(v, 20, north_m=120, command=EXCLUSION_CIRCLE)]),
    row("self_intersecting",
        "A self-intersecting polygon is accepted, and its vertices are read back exactly.",
        lambda v: polygon(v, CROSSED),
        dialects=("ardupilot",), source="AUTOPILOTS 2: self-intersecting accepted"),
    claims=CLAIMS,
)  # fmt: skip


def _uploads(vehicle: VehicleUnderTest, build: Build, results: Mapping[str, str]) -> str:
    """The upload has the result of the autopilot; an autopilot without a result refuses."""
    seen = _result(vehicle, build(vehicle))
    expected = results.get(vehicle.dialect.name)
    return refused(seen) if expected is None else equal(seen, expected, "upload")


checks(
    "fence", _uploads,
    row("relative_frame", "Items in frame 3 are accepted.", lambda v: _in_frame(polygon(v), 3),
        {"ardupilot": ACCEPTED, "px4": ACCEPTED},
        dialects=KNOWN, source="AUTOPILOTS 2: fence frames 0,3,5,6 / frame 0 and 3 accepted"),
    row("mission_frame", "Items in frame 2 are refused.", lambda v: _in_frame(polygon(v), 2), {},
        dialects=("ardupilot",), source="AUTOPILOTS 2: fence frames (2 refused)"),
    row("two_vertices", "A polygon of two vertices is refused.", lambda v: polygon(v, SQUARE[:2]),
        {"ardupilot": "ERROR", "px4": "ERROR"}, source="AUTOPILOTS 2: 2-vertex polygon -> ERROR"),
    row("wrong_vertex_count",
        "A polygon of four vertices with a vertex count of 6 is an ERROR on ArduPilot, ACCEPTED on PX4.",
        lambda v: polygon(v, vertex_count=6), {"ardupilot": "ERROR", "px4": ACCEPTED},
        dialects=KNOWN, source="AUTOPILOTS 2: wrong vertex count"),
    row("wrong_command", "A waypoint in a fence is refused.",
        lambda v: [circle(v, 250, command=mavlink.MAV_CMD_NAV_WAYPOINT)], {},
        dialects=("ardupilot", "mavlink")),
    claims=CLAIMS,
)  # fmt: skip


_fence_check = partial(check, "fence", claims=CLAIMS)
_ardupilot_check = partial(_fence_check, dialects=("ardupilot",))


@_fence_check(source="AUTOPILOTS 2: fence read back frame 0 / read-back frame 5")
def read_back_frame(vehicle: VehicleUnderTest) -> None:
    """Items are read back in frame 0 on ArduPilot and in frame 5 on PX4."""
    expected = vehicle.known(ardupilot=0, px4=5)
    _store_square(vehicle)
    equal({item.frame for item in plans.download(vehicle, FENCE)}, {expected}, "frames")


@_fence_check(source="AUTOPILOTS 2: fence atomic, old fence kept on failure")
def refusal_keeps_the_old(vehicle: VehicleUnderTest) -> None:
    """After a refused upload the vehicle keeps its old fence."""
    old = _store_square(vehicle)
    refused(_result(vehicle, polygon(vehicle, SQUARE[:2])))
    plans.expect_stored(vehicle, old, FENCE)


@_ardupilot_check(source="AUTOPILOTS 2: 200 -> NO_SPACE")
def too_large(vehicle: VehicleUnderTest) -> str:
    """A fence of 200 vertices is refused, and the old fence stays."""
    old = _store_square(vehicle)
    seen = _result(vehicle, polygon(vehicle, [(200 - i, 150.0 + i % 2) for i in range(200)]))
    plans.expect_stored(vehicle, old, FENCE)
    return equal(seen, "NO_SPACE", "200 vertices")


@_ardupilot_check(source="AUTOPILOTS 2: FENCE_TOTAL reads 6")
def total_parameter(vehicle: VehicleUnderTest) -> str:
    """FENCE_TOTAL reads 6 for a polygon of four vertices."""
    _store_square(vehicle)
    return f"{equal(parameters.read(vehicle, 'FENCE_TOTAL').value, 6, 'FENCE_TOTAL'):g}"


def _clears(vehicle: VehicleUnderTest, kind: int, build: Build) -> None:
    plans.upload_or_fail(vehicle, build(vehicle), kind)
    equal(plans.clear(vehicle, kind), ACCEPTED, "MISSION_CLEAR_ALL")
    equal(plans.count(vehicle, kind), 0, "items left")


def _is_independent(vehicle: VehicleUnderTest, kind: int, build: Build) -> None:
    """An upload leaves the mission, and the clearing of the mission leaves this plan."""
    mission, items = plans.store_sample(vehicle), build(vehicle)
    plans.upload_or_fail(vehicle, items, kind)
    plans.expect_stored(vehicle, mission)
    plans.clear(vehicle)
    plans.expect_stored(vehicle, items, kind)


checks("fence", _clears, row("clear", "Clearing removes the fence.", FENCE, polygon), claims=CLAIMS)
checks(
    "fence", _is_independent,
    row("is_not_the_mission",
        "The upload of a fence does not change the mission; clearing the mission does not change the fence.",
        FENCE, polygon),
    claims=CLAIMS,
)  # fmt: skip


@_ardupilot_check(source="AUTOPILOTS 2: mission and fence uploads may run interleaved")
def interleaved_with_mission(vehicle: VehicleUnderTest) -> None:
    """A mission and a fence can be uploaded at the same time, item by item."""
    sent = {MISSION: plans.sample_plan(vehicle, 4), FENCE: polygon(vehicle)}
    mark = vehicle.mark()
    for kind, items in sent.items():
        vehicle.send(plans.count_message(vehicle, len(items), kind))
    results: dict[int, int] = {}
    while len(results) < 2:
        entry, mark = plans.next_step(vehicle, mark)
        kind = entry.message.mission_type
        if entry.kind == "MISSION_ACK":
            results[kind] = entry.message.type
        else:
            plans.send_item(vehicle, sent[kind], entry.message.seq, kind)
    equal(results, {MISSION: 0, FENCE: 0}, "results by type")
    for kind, items in sent.items():
        plans.expect_stored(vehicle, items, kind)


@_fence_check(source="AUTOPILOTS 2: MAV_CMD_DO_FENCE_ENABLE(207)")
def enable_command(vehicle: VehicleUnderTest) -> str:
    """DO_FENCE_ENABLE is ACCEPTED on ArduPilot, without a change of FENCE_ENABLE, and UNSUPPORTED on PX4."""
    expected = vehicle.known(ardupilot=ACCEPTED, px4="UNSUPPORTED")
    _store_square(vehicle)
    with _fence_disabled_afterwards(vehicle) as before:
        seen = vehicle.command(ENABLE, 1)
        after = parameters.value_or_none(vehicle, "FENCE_ENABLE")
    equal(after, before, "FENCE_ENABLE")
    return equal(seen, expected, "DO_FENCE_ENABLE")


# The last check of a fence leaves none, because PX4 keeps within a stored fence in later flights.
@_fence_check()
def empty_upload(vehicle: VehicleUnderTest) -> None:
    """An empty upload is accepted and removes the fence."""
    _store_square(vehicle)
    equal(plans.count(vehicle, FENCE), len(SQUARE), "items before")
    plans.upload_or_fail(vehicle, [], FENCE)
    equal(plans.count(vehicle, FENCE), 0, "items left")


_rally_check = partial(check, "rally", claims=RALLY_CLAIMS)


def _points(vehicle: VehicleUnderTest, count: int = 3) -> list[PlanItem]:
    place = plans.current_position(vehicle)
    blank = PlanItem(mavlink.MAV_CMD_NAV_RALLY_POINT, frame=mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT)
    places = [plans.offset(place, 40.0 * i, -30.0) for i in range(1, count + 1)]
    return [replace(blank, x=x, y=y, z=20.0 + i) for i, (x, y) in enumerate(places)]


@_rally_check(dialects=KNOWN, source="AUTOPILOTS 2: rally ok (count 0)")
def is_empty_at_first(vehicle: VehicleUnderTest) -> str:
    """After MISSION_CLEAR_ALL the count is 0."""
    plans.clear(vehicle, RALLY)
    return str(equal(plans.count(vehicle, RALLY), 0, "count"))


@_rally_check()
def upload(vehicle: VehicleUnderTest) -> None:
    """An upload of three points is accepted, and the vehicle requests them in order."""
    done = plans.upload_or_fail(vehicle, _points(vehicle), RALLY)
    equal([seq for _, seq in done.requests], [0, 1, 2], "requested items")


@_rally_check()
def read_back(vehicle: VehicleUnderTest) -> None:
    """Positions are read back exactly, altitudes within 1 m."""
    points = _points(vehicle)
    for seen, sent in zip(plans.store(vehicle, points, RALLY), points, strict=True):
        near(seen.z, sent.z, 1.0, "z")


@_rally_check()
def replaces(vehicle: VehicleUnderTest) -> str:
    """A shorter list replaces a longer list."""
    plans.upload_or_fail(vehicle, _points(vehicle, 4), RALLY)
    plans.upload_or_fail(vehicle, _points(vehicle, 2), RALLY)
    return f"{equal(plans.count(vehicle, RALLY), 2, 'count')} points left"


@_rally_check(dialects=("ardupilot", "mavlink"))
def wrong_command(vehicle: VehicleUnderTest) -> str:
    """A waypoint in place of a rally point is refused."""
    bad = [replace(point, command=mavlink.MAV_CMD_NAV_WAYPOINT) for point in _points(vehicle, 1)]
    return refused(plans.upload(vehicle, bad, RALLY).result)


checks(
    "rally", _is_independent,
    row("is_not_the_mission",
        "Rally points do not change the mission; clearing the mission does not change the rally points.",
        RALLY, _points),
    claims=RALLY_CLAIMS,
)  # fmt: skip
checks(
    "rally", _clears,
    row("clear", "Clearing is accepted and removes the rally points.", RALLY, _points),
    claims=RALLY_CLAIMS,
)  # fmt: skip
