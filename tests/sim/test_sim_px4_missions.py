"""PX4 1.15: the distance of a mission (MIS_DIST_1WP), and answers that differ from other autopilots."""

import pytest
from px4_station import ACCEPTED, AUTO, DENIED, HOLD, MISSION, TEMPORARILY_REJECTED, QuietPx4Station
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import item, takeoff, waypoint

LIMIT_M = 40.0
TOO_FAR = "First waypoint too far away: "
MISSION_ITEMS = [takeoff(), waypoint(60, 0), waypoint(900, 0)]


def flying_beyond_the_limit() -> QuietPx4Station:
    """Return a copter that flies to its last item, more than `LIMIT_M` from the first item."""
    station = QuietPx4Station(params={"MIS_DIST_1WP": LIMIT_M})
    station.fly_mission(MISSION_ITEMS)
    station.until(lambda: any(m.seq == 1 for m in station.of("MISSION_ITEM_REACHED")), 120)
    assert not any(text.startswith(TOO_FAR) for text in station.texts())
    return station


def assert_refused(station: QuietPx4Station) -> None:
    assert any(text.startswith(TOO_FAR) for text in station.texts())
    assert "No valid mission available, loitering" in station.texts()
    assert station.change(AUTO, MISSION) == TEMPORARILY_REJECTED


@pytest.mark.parametrize(("north_m", "result"), [(880, ACCEPTED), (920, DENIED)])
def test_the_limit_is_900_m(north_m: float, result: int) -> None:
    station = QuietPx4Station()
    station.upload_and_wait([waypoint(north_m, 0)])
    assert station.command(mavlink.MAV_CMD_MISSION_START) == result


def test_a_mission_replaced_far_from_its_first_item_is_not_flown() -> None:
    station = flying_beyond_the_limit()
    station.upload_and_wait([takeoff(), waypoint(60, 0), waypoint(900, 100)])
    assert_refused(station)
    station.upload_and_wait([waypoint(80, 0), waypoint(900, 100)])
    assert station.change(AUTO, MISSION) == ACCEPTED


def test_a_mission_resumed_far_from_its_first_item_is_not_flown() -> None:
    station = flying_beyond_the_limit()
    assert station.change(AUTO, HOLD) == ACCEPTED
    station.change(AUTO, MISSION)
    assert_refused(station)


def test_a_new_fence_checks_the_flying_mission_again() -> None:
    station = flying_beyond_the_limit()
    circle = item(mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION, param1=5000.0, frame=mavlink.MAV_FRAME_GLOBAL)
    assert station.upload([circle], mavlink.MAV_MISSION_TYPE_FENCE) == 0
    station.wait(1.0)
    assert_refused(station)


# -- PX4's answers ---------------------------------------------------------------------------------------


def test_a_request_without_news_since_the_stream_is_denied() -> None:
    station = QuietPx4Station()
    gps, request = mavlink.MAVLINK_MSG_ID_GPS_RAW_INT, mavlink.MAV_CMD_REQUEST_MESSAGE
    station.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, gps, 1e6)
    station.until(lambda: bool(station.of("GPS_RAW_INT")), 3)
    assert station.command(request, gps) == DENIED
    station.wait(0.5)
    assert station.command(request, gps) == ACCEPTED
    assert station.command(request, mavlink.MAVLINK_MSG_ID_MISSION_CURRENT) == DENIED
