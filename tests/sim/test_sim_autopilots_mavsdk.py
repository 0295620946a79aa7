"""The requests of MAVSDK to both autopilots, action by action, and the different answers it hides."""

import math

import pytest
from px4_station import AUTO as PX4_AUTO
from px4_station import HOLD, QuietPx4Station
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import Station, home_item, item, place_m, takeoff, waypoint

ACCEPTED = 0


@pytest.mark.autopilots("MAVSDK 5 goto_location", of="px4")
def test_px4_turns_to_the_yaw_of_a_target_in_radians() -> None:
    station = QuietPx4Station()
    station.fly(10)
    assert station.reposition(40, 18, -1, 1, 0, math.pi / 2) == ACCEPTED
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
    circle = item(mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION, frame=0, param1=100)
    assert station.upload([circle], mavlink.MAV_MISSION_TYPE_FENCE) == ACCEPTED
    assert station.parameter("FENCE_ENABLE") == 0
