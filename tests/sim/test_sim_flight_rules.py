"""Rules of flight that are easy to get wrong, for each autopilot."""

import math
from itertools import pairwise
from typing import Any

import pytest
from profiles import full_only
from px4_station import QuietPx4Station
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import (
    Station,
    airborne_plane,
    home_item,
    item,
    land,
    place_m,
    setpoint,
    station_of,
    takeoff,
    waypoint,
)


def fly_plane_mission(station: Station, items: list[dict[str, Any]]) -> None:
    station.fly_plane_mission([home_item(), takeoff(50), *items])


def around(station: Station) -> tuple[float, float]:
    """Return distance [m] and bearing [rad] of the vehicle from a point 300 m north of the start."""
    north_m, east_m = place_m(station)
    return math.hypot(north_m - 300, east_m), math.atan2(east_m, north_m - 300)


def swept_rad(circle: list[tuple[float, float]]) -> float:
    return sum(math.remainder(b - a, 2 * math.pi) for (_, a), (_, b) in pairwise(circle))


# -- ArduCopter ------------------------------------------------------------------------------------------


def test_a_refused_reposition_changes_no_mode() -> None:
    station = station_of(params={"FENCE_RADIUS": 60.0, "FENCE_ENABLE": 1})
    station.fly(20)
    assert station.set_mode("BRAKE") == 0
    assert station.reposition(200, 20) == 4  # FAILED
    assert station.mode == "BRAKE"
    assert station.reposition(30, 20) == 0
    assert station.mode == "GUIDED"


def test_a_reposition_to_height_0_is_denied() -> None:
    station = Station()
    station.fly(20)
    assert station.reposition(30, 0.0) == 2  # DENIED
    station.wait(5)
    assert station.height_m == pytest.approx(20, abs=1)


def test_a_reposition_does_not_change_the_speed() -> None:
    station = Station()
    station.fly(20)
    assert station.reposition(300, 20, 2.0, 1) == 0
    station.wait(10)
    assert station.speed_m_s > 8  # WPNAV_SPEED


def test_a_copter_grounded_by_a_lost_motor_stays_down_when_the_motor_returns() -> None:
    station = Station()
    station.fly(4)
    station.inject("motor_loss:for=6")
    station.until(lambda: not station.fleet.truth().airborne[0], 6)
    station.wait(8)
    assert station.height_m < 0.5
    assert station.armed
    assert station.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 10) == 0
    station.until(lambda: station.height_m > 9, 30)


def test_an_unknown_battery_capacity_has_no_effect() -> None:
    station = Station()
    station.fly(20)
    station.set_parameter("BATT_CAPACITY", 0)
    station.wait(20)
    assert station.height_m == pytest.approx(20, abs=1)


# -- PX4 -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("frame", "value"), [(1, math.nan), (77, 0.0)])
def test_set_points_without_any_field_do_not_keep_offboard_active(frame: int, value: float) -> None:
    station = QuietPx4Station()
    station.fly(10)
    station.hold(setpoint((0, 0, -10)), 1.0)
    assert station.set_mode("Offboard") == 0
    station.hold(setpoint((0, 0, -10)), 2.0)
    assert station.mode == "Offboard"
    blank = (value,) * 6
    mask = 0x0FF8 if frame == 77 else 0x0DC7
    mute = mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, frame, mask, *blank, 0, 0, 0, 0, 0)
    for _ in range(30):
        station.send(mute)
        station.wait(0.1)
    assert station.mode != "Offboard"
    assert station.set_mode("Hold") == 0


@pytest.mark.autopilots("MAVSDK 5 goto_location", of="px4")
def test_px4_turns_to_the_yaw_of_a_target_in_radians() -> None:
    station = QuietPx4Station()
    station.fly(10)
    assert station.reposition(40, 18, -1, 1, 0, math.pi / 2) == 0
    assert station.mode == "Hold"
    station.until(lambda: place_m(station)[0] > 39 and station.height_m > 17.5, 60)
    station.wait(3)
    assert station.ask(mavlink.MAVLINK_MSG_ID_ATTITUDE).yaw == pytest.approx(math.pi / 2, abs=0.1)


# -- ArduPlane -------------------------------------------------------------------------------------------


def test_a_plane_circles_in_its_take_off_mode() -> None:
    station = airborne_plane({"TKOFF_ALT": 100.0}, up_m=97)
    station.wait(60)
    assert station.mode == "TAKEOFF"
    assert station.height_m == pytest.approx(100, abs=8)


def test_a_plane_without_rotors_does_not_take_off_on_command() -> None:
    station = station_of("plane")
    assert station.set_mode("GUIDED") == 0
    assert station.arm() == 0
    assert station.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 50) == 4  # FAILED


@pytest.mark.parametrize("mode", ["FBWB", *full_only("CRUISE")])
def test_height_is_held_in_the_modes_that_control_it(mode: str) -> None:
    station = airborne_plane({"TKOFF_ALT": 100.0}, up_m=97)
    assert station.set_mode(mode) == 0
    before_m, before = station.height_m, place_m(station)
    station.wait(20)
    assert station.height_m == pytest.approx(before_m, abs=5)
    assert math.dist(before, place_m(station)) > 150  # straight on


def test_fbwa_does_not_hold_height() -> None:
    station = airborne_plane({"TKOFF_ALT": 100.0}, up_m=97)
    assert station.set_mode("FBWA") == 0
    station.wait(30)
    assert station.height_m < 90


def test_turns_are_counted_at_any_speed() -> None:
    station = station_of("plane")
    speed = item(mavlink.MAV_CMD_DO_CHANGE_SPEED, param1=0, param2=21.0)
    turns = item(mavlink.MAV_CMD_NAV_LOITER_TURNS, 300, 0, 50, param1=3)
    fly_plane_mission(station, [speed, turns, waypoint(300, 900, 50)])
    station.until(lambda: math.dist(place_m(station), (300, 0)) < 70, 120)
    circle = [around(station)]
    while station.current < 4:
        station.wait(0.5)
        circle.append(around(station))
    assert abs(swept_rad(circle)) / (2 * math.pi) == pytest.approx(3, abs=0.4)


def test_a_change_of_altitude_in_a_mission_is_flown_straight() -> None:
    station = station_of("plane")
    fly_plane_mission(
        station,
        [
            waypoint(300, 0, 50),
            item(mavlink.MAV_CMD_NAV_CONTINUE_AND_CHANGE_ALT, z=120),
            waypoint(300, 900, 120),
        ],
    )
    station.until(lambda: station.current == 3, 120)
    begun = place_m(station)
    station.until(lambda: station.current == 4, 120)
    assert station.height_m == pytest.approx(120, abs=7)
    assert math.dist(begun, place_m(station)) > 150


def test_the_last_waypoint_before_a_landing_is_flown_through() -> None:
    station = station_of("plane", {"WP_RADIUS": 30})
    fly_plane_mission(station, [waypoint(600, 0, 50), waypoint(900, 0, 40), land(1300, 0)])
    station.until(lambda: station.current == 4, 240)
    assert math.dist(place_m(station), (900, 0)) < 35
    station.until(lambda: not station.armed, 240)


def test_a_reposition_sets_radius_and_direction_of_a_planes_circle() -> None:
    station = airborne_plane({"TKOFF_ALT": 100.0}, up_m=97)
    assert station.reposition(300, 100, -1, 1, 140.0, 1.0) == 0
    station.wait(90)
    circle = []
    for _ in range(60):
        station.wait(0.5)
        circle.append(around(station))
    assert sum(away_m for away_m, _ in circle) / len(circle) == pytest.approx(140.0, abs=6)
    assert swept_rad(circle) < 0
