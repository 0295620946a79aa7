"""The start of a PX4 mission: a multicopter climbs in place to its first item (`Mission::handleTakeoff`)."""

import pytest
from profiles import full_only
from px4_station import ACCEPTED, QuietPx4Station
from station import place_m, takeoff, waypoint


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
