"""Missions of ArduCopter that are changed or shortened in flight."""

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import Station, home_item, item, land, place_m, takeoff, waypoint

ACCEPTED, FAILED = 0, 4
CURRENT = mavlink.MAVLINK_MSG_ID_MISSION_CURRENT
SET_CURRENT = mavlink.MAV_CMD_DO_SET_MISSION_CURRENT
RESTARTED = (2, "Auto mission changed, restarted command")


def restart_texts(station: Station) -> list[tuple[int, str]]:
    return [(m.severity, m.text) for m in station.of("STATUSTEXT") if m.text.startswith("Auto mission")]


def northbound(more: int = 0) -> Station:
    """Return an ArduCopter in AUTO on its way to item 2, far in the north, with more items behind it."""
    station = Station()
    station.fly_mission([takeoff(), waypoint(600, 0), *(waypoint(600, 50.0 * i) for i in range(1, more + 1))])
    station.until(lambda: place_m(station)[0] > 50, 60)
    return station


def send_some(station: Station, announced: int, items: list[dict[str, Any]]) -> list[Any]:
    replies = station.count(announced)
    for seq, fields in enumerate(items):
        replies = station.send(station.item_message(seq, fields))
    return replies


@pytest.mark.autopilots("2 upload is atomic?", "2 re-upload in AUTO", "2 abandoned upload")
def test_an_upload_abandoned_after_item_2_turns_the_vehicle() -> None:
    station = northbound(more=4)
    before_m = place_m(station)
    send_some(station, 5, [home_item(), takeoff(), waypoint(before_m[0], 500)])
    assert restart_texts(station) == [RESTARTED]
    station.wait(20)
    north_m, east_m = place_m(station)
    assert east_m > 60
    assert abs(north_m - before_m[0]) < 40
    assert station.ask(CURRENT).seq == 2


@pytest.mark.autopilots("2 re-upload in AUTO")
def test_each_changed_item_restarts_the_current_command_once() -> None:
    station = northbound(more=2)
    new = [home_item(), takeoff(), *(waypoint(300, 100.0 * i) for i in range(3))]
    assert station.upload(new) == ACCEPTED
    assert restart_texts(station) == [RESTARTED] * 3
    assert station.mode == "AUTO"


@pytest.mark.autopilots("2 shorter mission")
def test_after_a_shorter_mission_the_index_is_greater_than_the_total() -> None:
    station = Station()
    legs = [waypoint(20.0 * i, 0) for i in range(1, 4)]
    station.fly_mission([takeoff(), *legs[:2], waypoint(200, 0), waypoint(300, 0)])
    station.until(lambda: station.reached == [1, 2, 3], 60)
    assert station.upload([home_item(), takeoff(), *legs[:2]]) == ACCEPTED
    assert restart_texts(station)[-1][1] == "Auto mission changed but failed to restart command"
    station.until(lambda: place_m(station)[0] > 198, 60)
    station.wait(1)
    current = station.ask(CURRENT)
    assert (current.seq, current.total, current.mission_state) == (4, 3, 5)
    assert station.armed


@pytest.mark.autopilots("2 DO_SET_MISSION_CURRENT")
def test_setting_the_current_item_with_a_reset_restarts_the_jump_counts() -> None:
    def flown(reset: int) -> list[int]:
        station = Station()
        jump = item(mavlink.MAV_CMD_DO_JUMP, param1=2, param2=1)
        station.fly_mission([takeoff(5), waypoint(15, 0, 5), waypoint(30, 0, 5), jump, land(30, 10)])
        station.until(lambda: station.reached == [1, 2, 3, 2], 90)
        assert station.command(SET_CURRENT, 3, reset) == ACCEPTED
        station.until(lambda: not station.armed, 180)
        return station.reached

    assert flown(reset=0) == [1, 2, 3, 2, 3]
    assert flown(reset=1) == [1, 2, 3, 2, 3, 2, 3]


@pytest.mark.autopilots("2 pause/continue")
def test_an_empty_mission_cannot_be_paused() -> None:
    station = Station()
    assert station.set_mode("AUTO") == 0
    assert station.command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0) == FAILED
