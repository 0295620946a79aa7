"""A PX4 fixed wing: feasible missions, take-off, landing, and returns by RTL_TYPE."""

import math
from typing import Any

import pytest
from px4_station import QuietPx4Station, command_item
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import item, land, place_m, takeoff, waypoint

RADIUS_M = 60.0
SETUP = {"RTL_RETURN_ALT": 30.0, "NAV_LOITER_RAD": 60.0, "NAV_FW_ALT_RAD": 60.0}


def land_start() -> dict[str, Any]:
    return command_item(mavlink.MAV_CMD_DO_LAND_START)


def circle(north_m: float, east_m: float, up_m: float = 20.0, radius_m: float = RADIUS_M) -> dict[str, Any]:
    command = mavlink.MAV_CMD_NAV_LOITER_TO_ALT
    return item(command, north_m, east_m, up_m, param1=1.0, param2=radius_m, param4=1.0)


def down(north_m: float, east_m: float) -> list[dict[str, Any]]:
    """Return a landing northward out of a circle with its centre in the east."""
    return [circle(north_m - 250, east_m + RADIUS_M), land(north_m, east_m)]


def up(height_m: float = 20.0) -> dict[str, Any]:
    """Return a take-off to the north."""
    return takeoff(height_m) | {k: v for k, v in waypoint(200, 0).items() if k in ("x", "y")}


HOME = [land_start(), *down(0, 0)]
ROUTE = [up(), waypoint(600, 0, 40), waypoint(1500, 0, 40)]


def plane(**params: float) -> QuietPx4Station:
    return QuietPx4Station("plane", params=SETUP | params)


def flown(items: list[dict[str, Any]], **params: float) -> QuietPx4Station:
    station = plane(**params)
    station.fly_mission(items)
    return station


def away_m(station: QuietPx4Station, north_m: float, east_m: float) -> float:
    return math.dist(place_m(station), (north_m, east_m))


# -- feasible missions ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("items", "says"),
    [
        ([*ROUTE, *HOME], None),
        ([*ROUTE, *HOME, *down(1500, 0)], None),
        ([*ROUTE, *HOME, land_start(), *down(1500, 0)], "more than one land start"),
        ([*ROUTE, *down(0, 0), land_start()], "invalid land start"),
        ([land(0, 0)], "starts with land waypoint"),
        ([*ROUTE, land_start(), circle(-250, RADIUS_M, 0), land(0, 0)], "must be above the landing point"),
        ([*ROUTE, circle(-40, 0), land(0, 0)], "outside the orbit radius"),
        ([*ROUTE, circle(-250, 60, 30), land(0, 0)], "landing glide slope is steeper"),
        ([*ROUTE, waypoint(-190, 0, 20), land(0, 0)], "landing glide slope is steeper"),
        ([*ROUTE, waypoint(-240, 0, 20), land(0, 0)], None),
        (
            [*ROUTE, item(mavlink.MAV_CMD_NAV_LOITER_TIME, -300, 0, 20, param1=3.0), land(0, 0)],
            "unsupported landing approach entrance",
        ),
        ([*ROUTE, up()], "takeoff not first waypoint item"),
        (
            [up(), *HOME, command_item(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)],
            "land start item before RTL item not possible",
        ),
    ],
)
def test_an_infeasible_mission_is_reported_and_stored(items: list[dict[str, Any]], says: str | None) -> None:
    station = plane()
    station.upload_and_wait(items)
    rejected = [text for text in station.texts() if text.startswith("Mission rejected")]
    assert len(station.download()) == len(items)
    assert (says is None) is not rejected if says is None else says in rejected[0]


def test_a_steeper_slope_is_flown_if_its_parameter_allows_it() -> None:
    station = plane(FW_LND_ANG=7.0)
    station.upload_and_wait([*ROUTE, circle(-250, 60, 30), land(0, 0)])
    assert not [text for text in station.texts() if text.startswith("Mission rejected")]


# -- missions in flight -----------------------------------------------------------------------------------


def test_a_plane_climbs_straight_toward_its_take_off_item() -> None:
    station = flown([up(30.0), waypoint(600, 600, 40), *HOME])
    sides: list[float] = []

    def climbed() -> bool:
        sides.append(abs(place_m(station)[1]))
        return station.current == 1

    station.until(climbed, 60)
    assert station.height_m >= 29.5
    assert max(sides) < 3.0
    assert place_m(station)[0] > 50.0


def test_the_turn_before_a_waypoint_depends_on_the_speed_and_not_on_the_item() -> None:
    for radius_m in (0.0, 200.0):
        corner = waypoint(450, 0, 40) | {"param2": radius_m}
        station = flown([up(), corner, waypoint(450, 1500, 40), *HOME])
        station.until(lambda s=station: s.current == 2, 120)
        assert 450 - place_m(station)[0] == pytest.approx(0.32 * 0.7 * 10.0 * 15.0, abs=3)


def test_a_plane_too_low_at_a_waypoint_circles_to_its_altitude() -> None:
    station = flown([up(), waypoint(300, 0, 120), waypoint(1500, 0, 120), *HOME], NAV_FW_ALT_RAD=10.0)
    station.until(lambda: station.current == 1 and away_m(station, 300, 0) < 40, 60)
    station.until(lambda: station.current == 2, 120)
    assert station.height_m > 109
    assert away_m(station, 300, 0) < 2 * RADIUS_M


def test_a_plane_descends_on_the_circle_and_leaves_toward_the_landing() -> None:
    station = flown([up(), waypoint(300, 0, 60), *down(-100, 0)])
    station.until(lambda: station.current == 2, 120)
    station.until(lambda: away_m(station, -350, RADIUS_M) < 150, 120)
    assert station.height_m == pytest.approx(60, abs=4)
    station.until(lambda: station.current == 3, 200)
    assert station.height_m == pytest.approx(20, abs=6)
    assert place_m(station)[1] == pytest.approx(0, abs=20)
    assert station.ask(mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE).landed_state == 4
    station.until(lambda: not station.armed, 120)
    assert away_m(station, -100, 0) < 60


def test_a_jump_leads_past_the_landing_at_home() -> None:
    jump = command_item(mavlink.MAV_CMD_DO_JUMP, param1=6.0, param2=1.0)
    station = flown([up(), waypoint(600, 0, 40), jump, *HOME, *down(1200, 0)])
    station.until(lambda: not station.armed, 400)
    assert away_m(station, 1200, 0) < 60


def test_a_restarted_landing_spirals_down_around_its_position() -> None:
    station = flown([*ROUTE, *HOME])
    station.until(lambda: station.current == 2, 120)
    station.set_current(5)
    station.until(lambda: not station.armed, 400)
    assert away_m(station, 0, 0) == pytest.approx(RADIUS_M, abs=40)


# -- returns ----------------------------------------------------------------------------------------------


@pytest.mark.full
@pytest.mark.parametrize(
    ("items", "kind", "lands_at"),
    [
        ([*ROUTE, *HOME, *down(1500, 0)], 1, (0, 0)),
        ([*ROUTE, land_start(), *down(300, 0)], 3, (300, 0)),
        ([*ROUTE, *HOME], 3, None),  # no nearer than home
        ([*ROUTE, *HOME], 0, None),
        ([*ROUTE], 1, None),
    ],
)
def test_a_return_lands_by_the_mission_according_to_rtl_type(
    items: list[dict[str, Any]], kind: int, lands_at: tuple[float, float] | None
) -> None:
    station = flown(items, RTL_TYPE=kind)
    station.until(lambda: station.current == 2, 120)
    assert station.set_mode("Return") == 0
    station.wait(240)
    assert station.armed is (lands_at is None)
    if lands_at is not None:
        assert away_m(station, *lands_at) < 60
    else:
        assert station.height_m > 15
        assert station.mode == "Return"


def test_a_return_uses_the_first_landing_of_the_list() -> None:
    """A landing item before DO_LAND_START replaces it as the landing (mavlink_mission.cpp)."""
    station = flown([*ROUTE, *down(900, 0), *HOME], RTL_TYPE=1)
    station.until(lambda: station.current == 2, 120)
    assert station.set_mode("Return") == 0
    station.until(lambda: not station.armed, 400)
    assert away_m(station, 900, 0) < 120


def test_a_plane_below_its_return_altitude_climbs_at_its_position() -> None:
    station = flown([*ROUTE, *HOME], RTL_RETURN_ALT=80.0)
    station.until(lambda: station.current == 2, 120)
    before = place_m(station)
    assert station.set_mode("Return") == 0
    station.until(lambda: station.height_m > 74, 60)
    assert math.dist(place_m(station), before) < 3 * RADIUS_M


def test_a_nearer_rally_point_replaces_the_landing_of_a_return() -> None:
    station = plane(RTL_TYPE=1)
    rally = item(mavlink.MAV_CMD_NAV_RALLY_POINT, 900, 0, 40)
    assert station.upload([rally], mavlink.MAV_MISSION_TYPE_RALLY) == 0
    station.fly_mission([*ROUTE, *HOME])
    station.until(lambda: station.current == 2, 120)
    assert station.set_mode("Return") == 0
    station.wait(90)
    assert station.armed
    assert away_m(station, 900, 0) < 200


@pytest.mark.full
@pytest.mark.parametrize("kind", [1, 2, 3])
@pytest.mark.parametrize(
    "items",
    [
        [*ROUTE, land_start(), circle(-250, RADIUS_M), command_item(mavlink.MAV_CMD_NAV_LAND) | {"frame": 6}],
        [*ROUTE, land_start(), command_item(mavlink.MAV_CMD_NAV_LAND) | {"frame": 6}],
    ],
)
def test_a_return_ignores_a_landing_without_a_position(items: list[dict[str, Any]], kind: int) -> None:
    station = flown(items, RTL_TYPE=kind)
    station.until(lambda: station.current == 2, 120)
    assert station.set_mode("Return") == 0
    station.wait(120)
    assert station.armed
    assert station.height_m > 15


@pytest.mark.full
def test_a_return_along_the_mission_begins_at_the_current_item() -> None:
    station = flown([*ROUTE, waypoint(600, 600, 40), *HOME], RTL_TYPE=2)
    station.until(lambda: station.current == 1 and place_m(station)[0] > 300, 120)
    assert station.set_mode("Return") == 0
    station.until(lambda: away_m(station, 1500, 0) < 50, 120)
    station.until(lambda: away_m(station, 600, 600) < 50, 120)
    station.until(lambda: not station.armed, 300)
    assert away_m(station, 0, 0) < 60


def test_a_return_does_not_interrupt_a_landing() -> None:
    station = flown([*ROUTE, *HOME])
    station.until(lambda: station.current == 2, 120)
    assert station.set_mode("Hold") == 0
    assert station.command(mavlink.MAV_CMD_DO_LAND_START) == 0
    station.until(lambda: station.current == 5, 300)
    assert station.set_mode("Return") == 0
    station.until(lambda: not station.armed, 40)  # to go around again would take longer
    assert away_m(station, 0, 0) < 60


def test_a_plane_in_land_mode_circles_down_at_its_position() -> None:
    station = flown([*ROUTE, *HOME])
    station.until(lambda: station.current == 2, 120)
    before = place_m(station)
    assert station.set_mode("Land") == 0
    station.until(lambda: not station.armed, 200)
    assert math.dist(place_m(station), before) < 3 * RADIUS_M


def test_do_land_start_on_the_ground_arms_the_plane() -> None:
    """A ground station should check that the plane is in the air before this command."""
    station = plane()
    station.upload_and_wait([*ROUTE, *HOME])
    assert station.command(mavlink.MAV_CMD_DO_LAND_START) == 0
    station.wait(1.0)
    assert station.armed


def test_a_mission_outside_the_fence_is_refused_for_every_fence_action() -> None:
    station = plane(GF_ACTION=0, GF_MAX_VER_DIST=100.0, GF_MAX_HOR_DIST=2000.0)
    station.upload_and_wait([*ROUTE, *HOME])
    assert not [text for text in station.texts() if "violation" in text]
    station.upload_and_wait([up(), waypoint(600, 0, 101), *HOME])
    assert "Geofence violation for waypoint 2" in station.texts()
    assert station.set_mode("Mission") == 0
    assert station.arm() != 0
