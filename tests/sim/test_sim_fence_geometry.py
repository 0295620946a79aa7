"""Zones of the stored fence and distances to their edges, against independent plane geometry."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from transfer_station import CIRCLE, EXCLUDED, NOT_CIRCLE, POLYGON, RETURN_POINT

from sim_vehicle.physics.geodesy import LocalFrame, distance_m, metres_per_degree
from sim_vehicle.vehicle.fence import Fence
from sim_vehicle.vehicle.home_and_rally import Rally
from sim_vehicle.vehicle.mission import Item

LAT, LON = 46.0, 14.5


def at(north_m: float, east_m: float, lat: float = LAT, lon: float = LON) -> tuple[float, float]:
    per_lat_m, per_lon_m = metres_per_degree(lat)
    return lat + north_m / per_lat_m, (lon + east_m / per_lon_m + 180) % 360 - 180


def polygon(command: int, corners: list[tuple[float, float]], **where: float) -> list[Item]:
    places = [at(*corner, **where) for corner in corners]
    return [Item(command, param1=len(corners), x=round(lat * 1e7), y=round(lon * 1e7)) for lat, lon in places]


def circle(command: int, north_m: float, east_m: float, radius_m: float) -> Item:
    lat, lon = at(north_m, east_m)
    return Item(command, param1=radius_m, x=round(lat * 1e7), y=round(lon * 1e7))


SQUARE = [(-100.0, -100.0), (100.0, -100.0), (100.0, 100.0), (-100.0, 100.0)]


def fence(*items: Item) -> Fence:
    made = Fence()
    made.replace(items)
    return made


@pytest.mark.parametrize(
    ("north_m", "east_m", "margin_m"),
    [(0, 0, 100), (0, 90, 10), (95, -95, 5), (0, 110, -10), (103, 104, -5), (-300, 0, -200)],
)
def test_a_square_inclusion_zone(north_m: float, east_m: float, margin_m: float) -> None:
    made = fence(*polygon(POLYGON, SQUARE))
    assert made.margin_m(*at(north_m, east_m)) == pytest.approx(margin_m, abs=0.05)
    assert made.breaches(*at(north_m, east_m)) == (margin_m < 0)


def test_exclusion_zones_inside_an_inclusion_zone() -> None:
    hole = polygon(EXCLUDED, [(20, 20), (40, 20), (30, 50)])
    made = fence(
        circle(NOT_CIRCLE, -50, -50, 20), *polygon(POLYGON, SQUARE), *hole, circle(CIRCLE, 0, 0, 120)
    )
    assert made.margin_m(*at(0, 0)) == pytest.approx(math.hypot(20, 20), abs=0.1)
    assert not made.breaches(*at(0, 0))
    assert made.breaches(*at(-45, -45))
    assert made.breaches(*at(30, 30))
    assert made.breaches(*at(99, 99))  # in the square, out of the circle
    assert len(made.zones) == 4


PLACES = st.tuples(st.floats(-150.0, 150.0), st.floats(-150.0, 150.0))


@settings(max_examples=examples(50))
@given(st.lists(PLACES, min_size=2, max_size=20), st.floats(0.01, 1.0))
def test_a_breach_does_not_depend_on_earlier_positions(
    places: list[tuple[float, float]], pace: float
) -> None:
    """Visit the places in steps of a share `pace` of the way; small steps reuse the last margin."""
    zones = [*polygon(POLYGON, SQUARE), *polygon(EXCLUDED, [(20, 20), (40, 20), (30, 50)])]
    visitor, (north_m, east_m) = fence(*zones), places[0]
    for goal_north_m, goal_east_m in places[1:]:
        for _ in range(5):
            north_m += pace * (goal_north_m - north_m)
            east_m += pace * (goal_east_m - east_m)
            here = at(north_m, east_m)
            assert visitor.breaches(*here) == (fence(*zones).margin_m(*here) < 0)


def test_no_fence_forbids_nothing() -> None:
    made = fence()
    assert not made.breaches(0, 0)
    assert made.margin_m(0, 0) == math.inf
    assert made.total == 0


def test_a_concave_and_a_self_intersecting_polygon() -> None:
    u_shape = [(0, 0), (100, 0), (100, 100), (0, 100), (0, 70), (70, 70), (70, 30), (0, 30)]
    made = fence(*polygon(POLYGON, [(float(n), float(e)) for n, e in u_shape]))
    seen = [made.breaches(*at(n, e)) for n, e in ((50, 15), (85, 50), (30, 50), (50, 85))]
    assert seen == [False, False, True, False]
    bow = fence(*polygon(POLYGON, [(0, 0), (100, 100), (100, 0), (0, 100)]))
    inside, outside = [(10, 50), (90, 50)], [(50, 10), (50, 90)]
    assert {bow.breaches(*at(*place)) for place in outside} == {True}
    assert {bow.breaches(*at(*place)) for place in inside} == {False}


def test_a_fence_across_the_antimeridian() -> None:
    made = fence(*polygon(POLYGON, SQUARE, lat=-17.0, lon=179.9999))
    assert not made.breaches(*at(0, 80, lat=-17.0, lon=179.9999))
    assert made.breaches(*at(0, 120, lat=-17.0, lon=179.9999))


def test_the_return_point_is_the_given_one_or_the_middle() -> None:
    square = polygon(POLYGON, SQUARE)
    assert fence(*square).return_point_deg == pytest.approx((LAT, LON), abs=1e-6)
    given_one = fence(*square, Item(RETURN_POINT, x=450_000_000, y=140_000_000))
    assert given_one.return_point_deg == pytest.approx((45.0, 14.0))
    assert fence().return_point_deg is None


def test_a_polygon_across_the_antimeridian_has_its_middle_there() -> None:
    corners_deg = ((9.99, 179.98), (9.99, -179.99), (10.01, -179.99), (10.01, 179.98))
    items = (Item(POLYGON, param1=4, x=round(lat * 1e7), y=round(lon * 1e7)) for lat, lon in corners_deg)
    made = fence(*items)
    assert made.return_point_deg == pytest.approx((10.0, 179.995))


def test_violated_zones_can_be_discarded() -> None:
    made = fence(*polygon(POLYGON, SQUARE), circle(NOT_CIRCLE, 0, 0, 10), circle(CIRCLE, 0, 0, 50))
    assert made.discard_violated(*at(0, 0)) == 1
    assert made.discard_violated(*at(0, 70)) == 1
    assert len(made.zones) == 1
    assert len(made.items) == 6


@settings(max_examples=examples(80))
@given(
    st.lists(st.tuples(st.floats(50, 500), st.floats(0.15, 1.0)), min_size=3, max_size=12),
    st.floats(-600, 600),
    st.floats(-600, 600),
)
def test_a_star_shaped_polygon_contains_the_points_inside_its_edges(
    spokes: list[tuple[float, float]], north_m: float, east_m: float
) -> None:
    """A point is inside if its ray from the middle meets the edge behind the point."""
    turn = 2 * math.pi / sum(share for _, share in spokes)
    angle, corners = 0.0, []
    for radius_m, share in spokes:
        corners.append((radius_m * math.cos(angle), radius_m * math.sin(angle)))
        angle += share * turn
    if max(share for _, share in spokes) * turn > math.pi * 0.95:
        return
    made = fence(*polygon(POLYGON, corners))
    inside = False
    for (n1, e1), (n2, e2) in zip(corners, corners[1:] + corners[:1], strict=True):
        area = n1 * e2 - n2 * e1
        first = (north_m * e2 - n2 * east_m) / area
        second = (n1 * east_m - north_m * e1) / area
        inside = inside or (first >= 0 and second >= 0 and first + second <= 1)
    margin_m = made.margin_m(*at(north_m, east_m))
    if abs(margin_m) > 0.2:
        assert (margin_m > 0) == inside


@settings(max_examples=examples(60))
@given(st.floats(-80, 80), st.floats(-180, 180), st.floats(-2000, 2000), st.floats(-2000, 2000))
def test_metres_per_degree_agree_with_the_projection(
    lat: float, lon: float, north_m: float, east_m: float
) -> None:
    place = LocalFrame(lat, lon).point_to_geodetic(east_m, north_m)
    assert distance_m((lat, lon), place) == pytest.approx(math.hypot(north_m, east_m), abs=1.0, rel=2e-3)


def test_the_nearest_of_home_and_rally_points_is_found() -> None:
    rally = Rally()
    near, far = (Item(5100, x=round(at(n, 0)[0] * 1e7), y=round(LON * 1e7), z=30) for n in (100.0, 400.0))
    rally.replace([far, near])
    assert rally.nearest(at(90, 0), at(0, 0)) == near
    assert rally.nearest(at(390, 0), at(0, 0)) == far
    assert rally.nearest(at(20, 0), at(0, 0)) is None
    assert rally.nearest(at(20, 0), at(0, 0), include_home=False) == near
    assert rally.nearest(at(1000, 0), at(0, 0), limit_m=300) is None
    rally.replace([])
    assert rally.nearest(at(20, 0), at(0, 0), include_home=False) is None
