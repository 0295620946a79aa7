"""Commands of a mission: their stored form, and their execution by a copter."""

import math
from itertools import pairwise
from typing import Any

import pytest
from px4_station import QuietPx4Station, command_item
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import Station, fleet_of, item, land, place_m, takeoff, waypoint

from sim_vehicle.personalities.ardupilot.items import store_item, store_plane_item
from sim_vehicle.vehicle.mission import Item, Mission

TURNS, TO_ALT, DELAY, SPLINE = (
    mavlink.MAV_CMD_NAV_LOITER_TURNS,
    mavlink.MAV_CMD_NAV_LOITER_TO_ALT,
    mavlink.MAV_CMD_NAV_DELAY,
    mavlink.MAV_CMD_NAV_SPLINE_WAYPOINT,
)
YAW, DISTANCE, SPEED = (
    mavlink.MAV_CMD_CONDITION_YAW,
    mavlink.MAV_CMD_CONDITION_DISTANCE,
    mavlink.MAV_CMD_DO_CHANGE_SPEED,
)
NAN = math.nan


@pytest.mark.autopilots("2 read-back")
@pytest.mark.parametrize(
    ("command", "sent", "kept"),
    [
        (TURNS, (3.9, 9, 300.0, 1), (3, 0, 300, 1)),
        (TURNS, (0.5, 0, -12.7, 0), (0.5, 0, -12, 0)),
        (TURNS, (300, 0, 1234.0, 0), (255, 0, 1230, 0)),
        (mavlink.MAV_CMD_NAV_LOITER_UNLIM, (9, 9, -25.9, 9), (0, 0, -25, 0)),
        (TO_ALT, (1, -40.5, 3, 0), (0, -40, 0, 0)),
        (SPLINE, (4.7, 1, 2, 3), (4, 0, 0, 0)),
        (DELAY, (5.5, 23, 59, -1), (5.5, 23, 59, -1)),
        (YAW, (90.5, 10, -1, 1), (90.5, 10, -1, 1)),
        (DISTANCE, (12.5, 1, 1, 1), (12.5, 0, 0, 0)),
        (mavlink.MAV_CMD_DO_SET_SERVO, (9, 1500, 3, 4), (9, 1500, 0, 0)),
        (mavlink.MAV_CMD_DO_SET_RELAY, (1, 1, 3, 4), (1, 1, 0, 0)),
        (mavlink.MAV_CMD_DO_REPEAT_SERVO, (9, 1100, 4, 2.5), (9, 1100, 4, 2.5)),
        (mavlink.MAV_CMD_DO_MOUNT_CONTROL, (-45.5, 1, 2, 3), (-45.5, 1, 2, 0)),
        (mavlink.MAV_CMD_DO_SET_CAM_TRIGG_DIST, (7.5, 1, 1, 1), (7.5, 0, 1, 0)),
        (mavlink.MAV_CMD_DO_JUMP, (3.9, -1, 1, 1), (3, -1, 0, 0)),
        (mavlink.MAV_CMD_DO_FENCE_ENABLE, (1, 1, 1, 1), (1, 0, 0, 0)),
        (mavlink.MAV_CMD_DO_LAND_START, (1, 1, 1, 1), (0, 0, 0, 0)),
        (mavlink.MAV_CMD_DO_SET_ROI, (3, 1, 1, 1), (3, 0, 0, 0)),
        (mavlink.MAV_CMD_IMAGE_START_CAPTURE, (0, 2.5, 3, 1), (0, 2.5, 3, 1)),
    ],
)
def test_the_stored_form_of_items_on_ardupilot(
    command: int, sent: tuple[float, ...], kept: tuple[float, ...]
) -> None:
    p1, p2, p3, p4 = sent
    stored = store_item(Item(command, 6, p1, p2, p3, p4, x=460_000_000, y=145_000_000, z=20.0))
    assert isinstance(stored, Item)
    assert (stored.param1, stored.param2, stored.param3, stored.param4) == kept


@pytest.mark.parametrize(
    ("command", "sent", "result"),
    [
        pytest.param(0, {}, mavlink.MAV_MISSION_INVALID, id="command 0"),
        pytest.param(TURNS, {"param4": NAN}, mavlink.MAV_MISSION_INVALID_PARAM4, id="NaN p4 of LOITER_TURNS"),
        pytest.param(YAW, {"param3": math.inf}, mavlink.MAV_MISSION_INVALID_PARAM3, id="infinite p3"),
        pytest.param(2999, {"param1": NAN}, mavlink.MAV_MISSION_INVALID_PARAM1, id="parameters come first"),
        pytest.param(SPLINE, {"z": 90_000.0}, mavlink.MAV_MISSION_INVALID_PARAM7, id="altitude"),
    ],
)
def test_items_refused_by_ardupilot(command: int, sent: dict[str, Any], result: int) -> None:
    assert store_item(Item(command, **sent)) == result


def test_a_plane_stores_the_radii_of_a_waypoint_and_refuses_a_spline() -> None:
    stored = store_plane_item(Item(16, 3, 5.0, 30.7, 400.0, NAN, 1, 1, 50.0))
    assert isinstance(stored, Item)
    assert (stored.param1, stored.param2, stored.param3, stored.param4) == (0, 30, 255, 0)
    assert store_plane_item(Item(SPLINE)) == mavlink.MAV_MISSION_UNSUPPORTED


def test_turns_are_flown_around_the_position() -> None:
    station = Station()
    station.fly_mission([takeoff(), item(TURNS, 80, 0, 20, param1=2, param3=20), waypoint(0, 0), land(0, 0)])
    station.until(lambda: station.reached[-1:] == [1], 60)
    angles: list[float] = []
    distances: list[float] = []

    def watch() -> bool:
        north_m, east_m = place_m(station)
        if math.hypot(north_m - 80, east_m) < 26:
            angles.append(math.atan2(east_m, north_m - 80))
            distances.append(math.hypot(north_m - 80, east_m))
        return station.reached[-1] == 2

    station.until(watch, 200)
    swept = sum(math.remainder(b - a, 2 * math.pi) for a, b in pairwise(angles))
    assert swept == pytest.approx(4 * math.pi, abs=0.6)
    assert sorted(distances)[len(distances) // 2] == pytest.approx(20, abs=2.5)
    assert "Mission: 2 LoitTurns" in station.texts()


def test_a_delay_holds_the_vehicle_at_its_position() -> None:
    station = Station()
    station.fly_mission([takeoff(10), waypoint(30, 0, 10), item(DELAY, param1=8), waypoint(60, 0, 10)])
    station.until(lambda: station.reached[-1:] == [2], 60)
    waited_s = station.until(lambda: station.reached[-1] == 3, 30)
    assert waited_s == pytest.approx(8, abs=0.5)
    assert place_m(station)[0] == pytest.approx(30, abs=3)


def test_a_change_of_altitude_at_a_position() -> None:
    station = Station()
    station.fly_mission([takeoff(10), item(TO_ALT, 40, 0, 35), land(40, 0)])
    station.until(lambda: station.reached[-1:] == [2], 90)
    assert station.height_m == pytest.approx(35, abs=2.1)  # within the radius of a waypoint
    assert place_m(station)[0] == pytest.approx(40, abs=2)


def test_a_distance_condition_delays_a_do_command() -> None:
    station = Station()
    station.fly_mission(
        [
            takeoff(10),
            item(DISTANCE, param1=50),
            item(SPEED, param1=1, param2=3.0),
            waypoint(150, 0, 10),
            land(150, 0),
        ]
    )
    station.until(lambda: 2 in station.reached, 60)
    assert 150 - place_m(station)[0] == pytest.approx(50, abs=3)
    station.wait(6)
    assert station.speed_m_s == pytest.approx(3, abs=0.3)


def test_another_current_item_drops_a_condition_and_its_do_command() -> None:
    station = Station()
    speed = item(SPEED, param1=1, param2=3.0)
    station.fly_mission(
        [takeoff(10), item(DISTANCE, param1=20), speed, waypoint(100, 0, 10), waypoint(60, 30, 10)]
    )
    station.until(lambda: station.reached == [1], 60)
    assert station.command(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, 5) == 0
    station.until(lambda: station.reached[-1] == 5, 60)
    assert station.reached == [1, 5]


def test_a_yaw_condition_turns_the_vehicle() -> None:
    station = Station()
    station.stream(mavlink.MAVLINK_MSG_ID_ATTITUDE)
    station.fly_mission([takeoff(10), item(YAW, param1=135), waypoint(300, 0, 10), land(300, 0)])
    station.until(lambda: station.reached[-1:] == [2], 60)
    station.wait(0.5)
    assert math.degrees(station.of("ATTITUDE")[-1].yaw) == pytest.approx(135, abs=6)


def test_a_landing_sequence_and_a_missing_payload_do_not_stop_a_mission() -> None:
    station = Station()
    idle = [
        mavlink.MAV_CMD_DO_LAND_START,
        mavlink.MAV_CMD_DO_SET_SERVO,
        mavlink.MAV_CMD_DO_SET_ROI_NONE,
        mavlink.MAV_CMD_DO_DIGICAM_CONTROL,
        mavlink.MAV_CMD_DO_MOUNT_CONTROL,
        mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW,
        mavlink.MAV_CMD_DO_SET_RELAY,
    ]
    station.fly_mission([takeoff(5), *(item(command) for command in idle), waypoint(20, 0, 5), land(20, 0)])
    station.until(lambda: not station.armed, 120)
    assert station.reached == [1, *range(2, 10)]


def test_after_the_last_leg_only_the_first_do_command_runs() -> None:
    station = Station()
    homes = [item(mavlink.MAV_CMD_DO_SET_HOME, north_m, 0, 0, param1=0) for north_m in (50, 80)]
    station.fly_mission([takeoff(10), *homes])
    station.until(lambda: station.height_m > 9.5, 60)
    station.wait(3)
    home = station.ask(mavlink.MAVLINK_MSG_ID_HOME_POSITION)
    assert (home.latitude, home.altitude) == (homes[0]["x"], 300_000)


def test_the_nearest_landing_sequence_is_found() -> None:
    start, land = mavlink.MAV_CMD_DO_LAND_START, mavlink.MAV_CMD_NAV_LAND
    mission = Mission(fleet_of().vehicles[0])
    items = [Item(0), Item(start), Item(16, x=100), Item(start, x=40), Item(land, x=50), Item(start)]
    for index, kept in enumerate(items):
        mission.put(index, kept)
    assert mission.land_start((90e-7, 0.0)) == 1
    assert mission.land_start((30e-7, 0.0)) == 3
    mission.cut(1)
    assert mission.land_start((0.0, 0.0)) is None


# -- PX4 -------------------------------------------------------------------------------------------------


def test_px4_flies_a_mission_over_its_do_commands_and_holds_at_the_end() -> None:
    station = QuietPx4Station()
    station.fly_mission(
        [
            takeoff(10),
            command_item(SPEED, param1=1, param2=4.0),
            waypoint(40, 0, 10),
            command_item(mavlink.MAV_CMD_CONDITION_DELAY, param1=3),
        ]
    )
    station.until(lambda: station.reached[-1:] == [2], 120)
    waited_s = station.until(lambda: "Mission finished, loitering" in station.texts(), 30)
    assert waited_s == pytest.approx(3, abs=0.5)
    assert station.reached == [0, 1, 2, 3]
    station.wait(0.5)
    assert station.mode == "Hold"
