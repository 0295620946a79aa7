"""Ends of missions of a plane: landings after a return and out of a circle; acceptance radii."""

import math
from typing import Any

import pytest
from profiles import full_only
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import Station, home_item, item, land, place_m, station_of, takeoff, waypoint

RADIUS_M = 70.0


def to_altitude(north_m: float, east_m: float, up_m: float, radius_m: float) -> dict[str, Any]:
    return item(mavlink.MAV_CMD_NAV_LOITER_TO_ALT, north_m, east_m, up_m, param2=radius_m, param4=1.0)


def mission() -> list[dict[str, Any]]:
    start = item(mavlink.MAV_CMD_DO_LAND_START, -300, RADIUS_M)
    down = [start, to_altitude(-300, RADIUS_M, 20, RADIUS_M), waypoint(-190, 0, 20), land(0, 0)]
    return [home_item(), takeoff(40), waypoint(3000, 0, 60), *down]


def sent_home(**params: float) -> Station:
    station = station_of("plane", {"RTL_ALTITUDE": -1.0, "LAND_DISARMDELAY": 5.0} | params)
    station.fly_plane_mission(mission())
    station.until(lambda: place_m(station)[0] > 700, 120)
    assert station.set_mode("RTL") == 0
    return station


def test_a_return_with_autoland_flies_home_first() -> None:
    station = sent_home(RTL_AUTOLAND=1.0)
    assert (station.mode, station.current) == ("RTL", 2)
    station.until(lambda: station.mode == "AUTO", 120)
    assert math.hypot(*place_m(station)) < 100.0
    station.until(lambda: not station.armed, 240)
    assert math.hypot(*place_m(station)) < 60.0


def test_a_return_may_go_to_the_landing_at_once() -> None:
    station = sent_home(RTL_AUTOLAND=2.0)
    station.wait(2.0)
    assert (station.mode, station.current) == ("AUTO", 4)


@pytest.mark.parametrize("autoland", [0.0, *full_only(3.0)])
def test_a_return_without_autoland_circles_over_home(autoland: float) -> None:
    station = sent_home(RTL_AUTOLAND=autoland)
    station.wait(100)
    assert station.mode == "RTL"
    assert station.height_m > 30


def test_a_plane_leaves_a_circle_at_its_altitude_and_toward_the_next_item() -> None:
    station = station_of("plane")
    circle = to_altitude(600, 0, 25, -RADIUS_M)
    beyond = waypoint(600, 900, 25), waypoint(3000, 900, 25)
    station.fly_plane_mission([home_item(), takeoff(60), circle, *beyond])
    station.until(lambda: station.current == 2, 60)
    radii_m, sides = [], []

    def is_circle_left() -> bool:
        north_m, east_m = place_m(station)
        radii_m.append(math.hypot(north_m - 600, east_m))
        sides.append(north_m - 600)
        return station.current == 3

    station.until(is_circle_left, 200)
    assert station.height_m == pytest.approx(25, abs=6)
    assert radii_m[-1] == pytest.approx(RADIUS_M, abs=15)
    assert sides[-1] < -0.8 * RADIUS_M  # a counter-clockwise plane flies east at the south of its circle
    station.wait(3.0)
    heading_deg = station.ask(mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT).hdg / 100
    assert heading_deg == pytest.approx(90, abs=15)


@pytest.mark.parametrize(("radius_m", "nearest_m"), [(10.0, 10.0), (0.0, 90.0)])
def test_a_waypoint_sets_its_acceptance_radius(radius_m: float, nearest_m: float) -> None:
    station = station_of("plane")  # WP_RADIUS is 90 m as it comes
    wide_waypoint = item(mavlink.MAV_CMD_NAV_WAYPOINT, 800, 0, 50, param2=radius_m)
    station.fly_plane_mission([home_item(), takeoff(50), wide_waypoint, waypoint(800, 1500, 50)])
    station.until(lambda: station.current == 3, 120)
    assert 800 - place_m(station)[0] == pytest.approx(nearest_m, abs=6)


def landed_by_its_mission() -> Station:
    station = sent_home(RTL_AUTOLAND=2.0)
    station.until(lambda: not station.armed, 400)
    assert station.mode == "AUTO"
    return station


@pytest.mark.full
def test_a_landed_plane_does_not_arm_in_its_landing_sequence() -> None:
    station = landed_by_its_mission()
    assert station.current == 6, "the current item is still the landing"
    station.set_mode("GUIDED")
    assert station.arm() == mavlink.MAV_RESULT_FAILED
    assert "Arm: In landing sequence" in station.texts()
    assert station.command(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, 1.0) == 0
    assert station.arm() == 0


def test_a_landed_mission_restarts_after_a_pilots_mode() -> None:
    station = landed_by_its_mission()
    assert station.arm() == mavlink.MAV_RESULT_FAILED
    assert "Arm: In landing sequence" in station.texts()
    station.set_mode("MANUAL")
    assert "In landing sequence: mission reset" in station.texts()
    assert station.current == 0
    station.set_mode("GUIDED")
    assert station.arm() == 0


def test_an_arduplane_returns_to_launch_after_its_mission() -> None:
    station = station_of("plane")
    station.fly_plane_mission([home_item(), takeoff(60.0), waypoint(400, 0, 60.0)])
    station.until(lambda: station.mode == "RTL", 180)
    assert "Mission complete, changing mode to RTL" in station.texts()
