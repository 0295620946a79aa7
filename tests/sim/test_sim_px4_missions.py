"""PX4 1.15: the distance of a mission (MIS_DIST_1WP), its current item, and answers of PX4 alone."""

import pytest
from profiles import full_only
from px4_station import ACCEPTED, DENIED, TEMPORARILY_REJECTED, QuietPx4Station, command_item
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import item, place_m, takeoff, waypoint

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
    assert station.set_mode("Mission") == TEMPORARILY_REJECTED


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
    assert station.set_mode("Mission") == ACCEPTED


def test_a_mission_resumed_far_from_its_first_item_is_not_flown() -> None:
    station = flying_beyond_the_limit()
    assert station.set_mode("Hold") == ACCEPTED
    station.set_mode("Mission")
    assert_refused(station)


def test_a_new_fence_checks_the_flying_mission_again() -> None:
    station = flying_beyond_the_limit()
    circle = item(mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION, param1=5000.0, frame=mavlink.MAV_FRAME_GLOBAL)
    assert station.upload([circle], mavlink.MAV_MISSION_TYPE_FENCE) == 0
    station.wait(1.0)
    assert_refused(station)


# -- the current item ------------------------------------------------------------------------------------


def test_a_complete_mission_starts_again_from_a_requested_item_with_new_counts_of_jumps() -> None:
    station = QuietPx4Station()
    jump = command_item(mavlink.MAV_CMD_DO_JUMP, param1=1, param2=1)
    station.fly_mission([takeoff(5), waypoint(10, 0, 5), waypoint(20, 0, 5), jump, waypoint(25, 0, 5)])
    station.until(lambda: station.texts().count("Mission finished, loitering") == 1, 90)
    assert station.reached == [0, 1, 2, 1, 2, 4]
    station.set_mode("Mission")
    station.wait(0.5)
    assert "No valid mission available, loitering" in station.texts()
    station.set_current(1)
    assert station.set_mode("Mission") == ACCEPTED
    station.until(lambda: station.texts().count("Mission finished, loitering") == 2, 90)
    assert station.reached[6:] == [1, 2, 1, 2, 4]


def test_the_vehicle_stays_at_an_item_without_autocontinue() -> None:
    station = QuietPx4Station()
    station.count(3)
    for seq, fields in enumerate((takeoff(5), waypoint(15, 0, 5), waypoint(40, 0, 5))):
        message = station.item_message(seq, fields)
        message.autocontinue = int(seq != 1)
        station.send(message)
    station.wait(1.0)
    assert station.set_mode("Mission") == ACCEPTED
    assert station.arm() == ACCEPTED
    station.until(lambda: station.reached == [0, 1], 60)
    station.wait(10)
    assert station.reached == [0, 1]
    assert station.mode == "Mission"
    assert place_m(station)[0] < 20
    station.set_current(2)
    station.until(lambda: station.reached == [0, 1, 2], 60)


def land_and_start(station: QuietPx4Station, *items: dict[str, object]) -> int:
    """Land and disarm, upload a mission if there is one, and start; return the current item."""
    assert station.set_mode("Land") == ACCEPTED
    station.until(lambda: not station.armed, 60)
    if items:
        station.upload_and_wait(items)
    assert station.set_mode("Mission") == ACCEPTED
    assert station.arm() == ACCEPTED
    station.wait(0.5)
    return station.current


def test_a_landing_and_an_upload_keep_the_index_until_the_mission_is_complete() -> None:
    station = QuietPx4Station()
    items = [takeoff(5), waypoint(10, 0, 5), waypoint(30, 0, 5), waypoint(40, 0, 5)]
    station.fly_mission(items)
    station.until(lambda: station.reached == [0, 1], 60)
    assert land_and_start(station) == 2
    station.until(lambda: station.reached == [0, 1, 2, 3], 90)
    assert land_and_start(station, *items[:3], waypoint(50, 0, 5)) == 3
    station.until(lambda: station.reached == [0, 1, 2, 3, 3], 90)
    assert land_and_start(station) == 0


def test_an_empty_mission_in_flight_ends_in_hold() -> None:
    station = QuietPx4Station()
    station.fly_mission([takeoff(5), waypoint(60, 0, 5), waypoint(90, 0, 5)])
    station.until(lambda: station.reached == [0], 60)
    station.upload_and_wait([])
    assert "No valid mission available, loitering" in station.texts()
    assert station.mode == "Hold"
    assert station.current == 0


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


# -- the start: a multicopter climbs in place to its first item (`Mission::handleTakeoff`) -------------


@pytest.mark.parametrize("first", [waypoint(40, 0, 15), takeoff(15)])
def test_a_copter_on_the_ground_climbs_to_its_first_item_before_it_moves(first: object) -> None:
    station = QuietPx4Station()
    station.fly_mission([first, waypoint(80, 0, 15)])
    station.until(lambda: station.height_m > 14, 60)
    assert place_m(station) == (pytest.approx(0, abs=1), pytest.approx(0, abs=1))
    station.until(lambda: place_m(station)[0] > 78, 60)
    assert [message.seq for message in station.of("MISSION_ITEM_REACHED")] == [0, 1]


@pytest.mark.parametrize(("item_m", "climbs_first"), [(25, True), *full_only((10.5, False), (6, False))])
def test_a_copter_in_the_air_climbs_first_only_to_a_higher_item(item_m: float, *, climbs_first: bool) -> None:
    station = QuietPx4Station()
    station.fly_mission([takeoff(10), waypoint(30, 0, 10), waypoint(200, 0, 10)])
    station.until(lambda: place_m(station)[0] > 60, 60)
    assert station.set_mode("Hold") == ACCEPTED
    station.wait(8)
    held_m = place_m(station)[0]
    station.upload_and_wait([waypoint(200, 0, item_m), waypoint(250, 0, item_m)])
    assert station.set_mode("Mission") == ACCEPTED
    station.until(lambda: place_m(station)[0] > held_m + 10, 60)
    assert (station.height_m > item_m - 1.5) is (climbs_first or item_m < 11)


def test_an_upload_in_the_mission_mode_turns_to_the_item_without_a_climb() -> None:
    station = QuietPx4Station()
    station.fly_mission([takeoff(10), waypoint(200, 0, 10)])
    station.until(lambda: place_m(station)[0] > 30, 60)
    station.upload_and_wait([waypoint(200, 0, 40), waypoint(250, 0, 40)])
    station.wait(3)
    assert place_m(station)[0] > 38
    assert station.height_m < 30


def test_a_mission_is_available_at_once_after_an_earlier_good_mission() -> None:
    station = QuietPx4Station()
    assert station.arm() == ACCEPTED
    station.upload_and_wait([takeoff(10), waypoint(40, 0, 10)])
    assert station.set_mode("Mission") == ACCEPTED
    station.until(lambda: station.height_m > 8, 60)
    assert station.set_mode("Hold") == ACCEPTED
    station.upload([waypoint(40, 0, 10), waypoint(60, 0, 10)])
    assert station.set_mode("Mission") == ACCEPTED
