"""The requests of MAVSDK to both autopilots, action by action, and the different answers it hides."""

import math

import pytest
from px4_station import AUTO as PX4_AUTO
from px4_station import HOLD, QuietPx4Station
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import ALT_M, LAT_DEG, LON_DEG, Station, home_item, item, place_m, takeoff, waypoint

ACCEPTED = 0


def send_fence(station: Station, corners: int) -> int:
    angles = [2 * math.pi * seq / corners for seq in range(corners)]
    vertices = [item(5001, 100 * math.cos(a), 100 * math.sin(a), frame=0, param1=corners) for a in angles]
    return station.upload(vertices, mavlink.MAV_MISSION_TYPE_FENCE)


@pytest.mark.autopilots("MAVSDK 5 goto_location", of="px4")
def test_px4_turns_to_the_yaw_of_a_target_in_radians() -> None:
    station = QuietPx4Station()
    station.fly(10)
    there = (round((LAT_DEG + 40 / 111_195) * 1e7), round(LON_DEG * 1e7), ALT_M + 18)
    command = mavlink.MAV_CMD_DO_REPOSITION
    assert station.command_int(command, 5, *there, -1, 1, 0, math.pi / 2) == ACCEPTED
    assert station.custom_mode == (PX4_AUTO, HOLD)
    station.until(lambda: place_m(station)[0] > 39 and station.height_m > 17.5, 60)
    station.wait(3)
    assert station.ask(mavlink.MAVLINK_MSG_ID_ATTITUDE).yaw == pytest.approx(math.pi / 2, abs=0.1)


@pytest.mark.autopilots("MAVSDK 5 clear_mission")
def test_an_upload_of_a_home_alone_empties_the_mission() -> None:
    station = Station()
    assert station.upload([home_item(), takeoff(10), waypoint(200, 0, 10)]) == 0
    assert station.upload([home_item()]) == 0
    assert station.ask(mavlink.MAVLINK_MSG_ID_MISSION_CURRENT).total == 0
    assert len(station.download()) == 1


@pytest.mark.autopilots("MAVSDK 5 geofence", "2 fence")
def test_an_uploaded_fence_is_not_enabled() -> None:
    station = Station()
    assert send_fence(station, 5) == ACCEPTED
    assert station.parameter("FENCE_ENABLE") == 0
