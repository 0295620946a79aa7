"""The mission protocol of ArduCopter, message by message."""

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import LAT_DEG, LON_DEG, Station, acks, home_item, land, takeoff, waypoint

JUMP, RTL = mavlink.MAV_CMD_DO_JUMP, mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH


def mission(n: int) -> list[dict[str, Any]]:
    """Return n items: home, take-off and waypoints."""
    return [home_item(), takeoff(), *(waypoint(10.0 * i, 0) for i in range(2, n))]


@pytest.mark.autopilots("2 item 0")
def test_item_0_has_the_exact_position_and_the_altitude_of_home() -> None:
    station = Station()
    sent = mission(3)
    sent[0] = waypoint(5000, 5000, 77.0)
    assert station.upload(sent) == mavlink.MAV_MISSION_ACCEPTED
    home = station.download()[0]
    assert (home.x, home.y) == pytest.approx((LAT_DEG * 1e7, LON_DEG * 1e7), abs=1)
    assert (home.frame, home.z) == (0, 300.0)


@pytest.mark.autopilots("2 read-back")
@pytest.mark.parametrize(
    ("sent", "kept"),
    [
        pytest.param({"frame": 5}, {"frame": 0, "autocontinue": 1}, id="frame 5 is kept as 0"),
        pytest.param({"z": -20.3}, {"z": -20.29}, id="negative altitudes are cut toward zero"),
        pytest.param(
            {"command": RTL, "frame": 6}, {"frame": 0, "x": 0, "y": 0, "z": 0}, id="RTL has no place"
        ),
    ],
)
def test_read_back_items_have_their_stored_form(sent: dict[str, Any], kept: dict[str, Any]) -> None:
    station = Station()
    assert station.upload([home_item(), takeoff(), waypoint(10, 0) | sent]) == 0
    got = station.download()[2]
    assert {name: getattr(got, name) for name in kept} == pytest.approx(kept)


def test_a_jump_to_home_is_refused() -> None:
    station = Station()
    jump = waypoint(10, 0) | {"command": JUMP, "param1": 0}
    assert station.upload([home_item(), takeoff(), jump]) == mavlink.MAV_MISSION_ERROR


@pytest.mark.autopilots("2 error codes")
def test_a_mission_with_too_many_items_is_refused() -> None:
    station = Station()
    assert acks(station.count(651)) == [mavlink.MAV_MISSION_NO_SPACE]
    assert "Only 650 items are supported" in station.texts()
    assert acks(station.count(650)) == []


@pytest.mark.autopilots("2 MISSION_WRITE_PARTIAL_LIST")
@pytest.mark.parametrize(("start", "end"), [(3, 2), (-1, 2)], ids=["backwards", "negative"])
def test_partial_writes_of_a_bad_range_are_refused(start: int, end: int) -> None:
    station = Station()
    assert station.upload(mission(5)) == 0
    replies = station.send(mavlink.MAVLink_mission_write_partial_list_message(1, 0, start, end, 0))
    assert acks(replies) == [mavlink.MAV_MISSION_ERROR]


@pytest.mark.autopilots("MAVSDK 5 clear_mission")
def test_an_upload_of_a_home_alone_empties_the_mission() -> None:
    station = Station()
    assert station.upload(mission(3)) == 0
    assert station.upload([home_item()]) == 0
    assert station.ask(mavlink.MAVLINK_MSG_ID_MISSION_CURRENT).total == 0
    assert len(station.download()) == 1


@pytest.mark.autopilots("2 CLEAR_ALL")
def test_a_mission_can_be_cleared_in_flight_in_guided() -> None:
    station = Station()
    station.fly_mission([takeoff(), waypoint(300, 0), land(300, 0)])
    station.wait(20)
    assert station.set_mode("GUIDED") == 0
    cleared = station.send(mavlink.MAVLink_mission_clear_all_message(1, 0, 0))
    assert acks(cleared) == [mavlink.MAV_MISSION_ACCEPTED]
    assert station.download() == []
    station.wait(60)
    assert station.height_m > 15
