"""The mission protocol of ArduCopter, message by message."""

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import LAT_DEG, LON_DEG, Station, acks, home_item, item, land, takeoff, waypoint

WP, LOITER_TIME, LAND = (
    mavlink.MAV_CMD_NAV_WAYPOINT,
    mavlink.MAV_CMD_NAV_LOITER_TIME,
    mavlink.MAV_CMD_NAV_LAND,
)
JUMP, SPEED, RTL = (
    mavlink.MAV_CMD_DO_JUMP,
    mavlink.MAV_CMD_DO_CHANGE_SPEED,
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH,
)
NAN = math.nan


def mission(n: int, east_m: float = 0.0) -> list[dict[str, Any]]:
    """Home, take-off and waypoints, n items."""
    return [home_item(), takeoff(), *(waypoint(10.0 * i, east_m) for i in range(2, n))]


@pytest.mark.autopilots("2 item 0", "2 count")
def test_a_download_equals_the_upload_except_home() -> None:
    station = Station()
    sent = mission(7)
    sent[0] = waypoint(5000, 5000, 77.0)
    assert station.upload(sent) == mavlink.MAV_MISSION_ACCEPTED
    kept = station.download()
    assert [(m.command, m.x, m.y, m.z) for m in kept[1:]] == [
        (f["command"], f["x"], f["y"], f["z"]) for f in sent[1:]
    ]
    home = kept[0]
    assert (home.x, home.y) == pytest.approx((LAT_DEG * 1e7, LON_DEG * 1e7), abs=1)
    assert (home.frame, home.z) == (0, 300.0)
    assert station.ask(mavlink.MAVLINK_MSG_ID_MISSION_CURRENT).total == 6


@pytest.mark.autopilots("2 read-back", "2 frame 2 on a WP")
@pytest.mark.parametrize(
    ("sent", "kept"),
    [
        pytest.param({"frame": 6}, {"frame": 3}, id="frame 6 is kept as 3"),
        pytest.param({"frame": 5}, {"frame": 0}, id="frame 5 is kept as 0"),
        pytest.param({"frame": 11}, {"frame": 10}, id="frame 11 is kept as 10"),
        pytest.param({"frame": 2}, {"frame": 0}, id="frame 2 is taken as above sea level"),
        pytest.param({"z": 20.3}, {"z": 20.29}, id="20.3 m is cut to 20.29"),
        pytest.param({"z": 33.333}, {"z": 33.33}, id="33.333 m is cut to whole cm"),
        pytest.param({"z": -20.3}, {"z": -20.29}, id="negative altitudes are cut toward zero"),
        pytest.param(
            {"param2": 4, "param3": 5, "param4": 6}, {"param2": 0, "param3": 0, "param4": 0}, id="WP p2-4"
        ),
        pytest.param({"param1": 2.7}, {"param1": 2}, id="WP p1 is cut to an integer"),
        pytest.param({"param4": NAN}, {"param4": 0}, id="NaN yaw is 0"),
        pytest.param(
            {"command": LOITER_TIME, "param3": 25}, {"param3": 1}, id="LOITER_TIME keeps the direction"
        ),
        pytest.param({"command": LAND, "param4": 0}, {"param4": 1}, id="LAND p4"),
        pytest.param(
            {"command": RTL, "frame": 6}, {"frame": 0, "x": 0, "y": 0, "z": 0}, id="RTL has no place"
        ),
        pytest.param(
            {"command": JUMP, "param1": 1, "param2": 2}, {"frame": 0, "param1": 1, "param2": 2}, id="DO_JUMP"
        ),
        pytest.param({"current": 1}, {"current": 0, "autocontinue": 1}, id="current is 0 on every item"),
    ],
)
def test_read_back_differs(sent: dict[str, Any], kept: dict[str, Any]) -> None:
    station = Station()
    assert station.upload([home_item(), takeoff(), waypoint(10, 0) | sent]) == 0
    got = station.download()[2]
    assert {name: getattr(got, name) for name in kept} == pytest.approx(kept)


@pytest.mark.autopilots("2 error codes")
@pytest.mark.parametrize(
    ("sent", "result"),
    [
        pytest.param({"command": 2999}, mavlink.MAV_MISSION_UNSUPPORTED, id="unknown command"),
        pytest.param({"frame": 9}, mavlink.MAV_MISSION_UNSUPPORTED_FRAME, id="unknown frame"),
        pytest.param({"param1": NAN}, mavlink.MAV_MISSION_INVALID_PARAM1, id="NaN p1"),
        pytest.param({"param2": NAN}, mavlink.MAV_MISSION_INVALID_PARAM2, id="NaN p2"),
        pytest.param({"z": NAN}, mavlink.MAV_MISSION_INVALID_PARAM7, id="NaN z"),
        pytest.param({"x": 1_000_000_000}, mavlink.MAV_MISSION_INVALID_PARAM5_X, id="latitude 100"),
        pytest.param({"y": 2_000_000_000}, mavlink.MAV_MISSION_INVALID_PARAM6_Y, id="longitude 200"),
        pytest.param({"command": JUMP, "param1": 99}, mavlink.MAV_MISSION_ERROR, id="jump beyond the end"),
        pytest.param({"command": JUMP, "param1": 0}, mavlink.MAV_MISSION_ERROR, id="jump to home"),
    ],
)
def test_refused_items(sent: dict[str, Any], result: int) -> None:
    station = Station()
    assert station.upload([home_item(), takeoff(), waypoint(10, 0) | sent]) == result


@pytest.mark.autopilots("2 error codes")
def test_too_many_items() -> None:
    station = Station()
    assert acks(station.count(651)) == [mavlink.MAV_MISSION_NO_SPACE]
    assert "Only 650 items are supported" in station.texts()
    assert acks(station.count(650)) == []


@pytest.mark.autopilots("2 upload is atomic?", "2 abandoned upload")
def test_an_abandoned_upload_asks_again_gives_up_and_leaves_a_mixture() -> None:
    station = Station()
    assert station.upload(mission(7)) == 0
    old = station.download()
    new = mission(5, east_m=50.0)
    station.count(5)
    for seq in range(3):
        station.send(station.item_message(seq, new[seq]))
    station.heard.clear()
    station.wait(9)
    assert [m.seq for m in station.of("MISSION_REQUEST")] == [3] * 7
    assert acks(station.heard) == [mavlink.MAV_MISSION_OPERATION_CANCELLED]
    assert "Mission upload timeout" in station.texts()
    kept = station.download()
    assert [m.y for m in kept] == [old[0].y, new[1]["y"], new[2]["y"], old[3].y, old[4].y]


@pytest.mark.autopilots("2 upload is atomic?")
def test_an_upload_refused_in_the_middle_leaves_a_mixture_too() -> None:
    station = Station()
    assert station.upload(mission(5)) == 0
    new = mission(5, east_m=50.0)
    new[3] = new[3] | {"z": NAN}
    assert station.upload(new) == mavlink.MAV_MISSION_INVALID_PARAM7
    assert [m.y == new[2]["y"] for m in station.download()][2:] == [True, False, False]


@pytest.mark.autopilots("2 wrong / duplicate item")
def test_duplicates_are_reported_and_the_upload_continues() -> None:
    station = Station()
    new = mission(4)
    station.count(4)
    replies = [m for seq in (0, 1, 1, 0, 2) for m in station.send(station.item_message(seq, new[seq]))]
    assert acks(replies) == [mavlink.MAV_MISSION_INVALID_SEQUENCE] * 2
    assert acks(station.send(station.item_message(3, new[3]))) == [mavlink.MAV_MISSION_ACCEPTED]
    assert acks(station.send(station.item_message(3, new[3]))) == [mavlink.MAV_MISSION_ERROR]
    assert len(station.download()) == 4


@pytest.mark.autopilots("2 second GCS / download during upload")
def test_a_second_ground_station_and_a_download_are_denied_during_an_upload() -> None:
    station = Station()
    other = Station(station.fleet, sysid=250)
    other.now = station.now
    station.count(4)
    assert acks(other.count(3)) == [mavlink.MAV_MISSION_DENIED]
    for sender in (station, other):
        listing = sender.send(mavlink.MAVLink_mission_request_list_message(1, 0, 0))
        assert acks(listing) == [mavlink.MAV_MISSION_DENIED]
    assert [m.seq for m in station.count(3)] == [0]  # the same one may start again


@pytest.mark.autopilots("2 requests")
def test_legacy_float_items_are_taken_and_given() -> None:
    station = Station()
    station.count(2)
    station.send(station.item_message(0, home_item()))
    legacy = mavlink.MAVLink_mission_item_message(1, 0, 1, 3, WP, 0, 1, 0, 0, 0, 0, 46.05, 14.51, 12.0, 0)
    assert acks(station.send(legacy)) == [0]
    (got,) = station.send(mavlink.MAVLink_mission_request_message(1, 0, 1, 0))
    assert got.get_type() == "MISSION_ITEM"
    assert (got.x, got.y, got.z) == pytest.approx((46.05, 14.51, 12.0), abs=1e-5)


def test_an_item_beyond_the_end_cannot_be_read() -> None:
    station = Station()
    assert station.upload(mission(3)) == 0
    replies = station.send(mavlink.MAVLink_mission_request_int_message(1, 0, 3, 0))
    assert [m.count for m in replies if m.get_type() == "MISSION_COUNT"] == [3]
    assert acks(replies) == [mavlink.MAV_MISSION_ERROR]


@pytest.mark.autopilots("2 MISSION_WRITE_PARTIAL_LIST")
@pytest.mark.parametrize(
    ("start", "end", "requested"),
    [(2, 3, [2, 3]), (5, 5, [5]), (6, 6, None), (3, 2, None), (-1, 2, None)],
    ids=["inside", "appended at the end", "beyond the end", "backwards", "negative"],
)
def test_partial_writes(start: int, end: int, requested: list[int] | None) -> None:
    station = Station()
    assert station.upload(mission(5)) == 0
    replies = station.send(mavlink.MAVLink_mission_write_partial_list_message(1, 0, start, end, 0))
    if requested is None:
        assert acks(replies) == [mavlink.MAV_MISSION_ERROR]
        return
    for seq in requested:
        assert [m.seq for m in replies if m.get_type() == "MISSION_REQUEST"] == [seq]
        replies = station.send(station.item_message(seq, waypoint(99, 99, 9)))
    assert acks(replies) == [0]
    kept = station.download()
    assert [seq for seq, m in enumerate(kept) if m.z == 9] == requested
    assert len(kept) == max(5, end + 1)


def test_part_of_a_list_cannot_be_asked_for() -> None:
    station = Station()
    assert station.upload(mission(5)) == 0
    assert station.send(mavlink.MAVLink_mission_request_partial_list_message(1, 0, 2, 4, 0)) == []


@pytest.mark.autopilots("2 CLEAR_ALL")
def test_clearing_is_refused_while_the_mission_is_flown_but_an_empty_upload_is_not() -> None:
    station = Station()
    clear = mavlink.MAVLink_mission_clear_all_message(1, 0, 0)
    station.fly_mission([takeoff(), waypoint(300, 0), land(300, 0)])
    station.wait(20)
    assert acks(station.send(clear)) == [mavlink.MAV_MISSION_ERROR]
    assert acks(station.count(0)) == [mavlink.MAV_MISSION_ACCEPTED]
    assert station.set_mode(4) == 0
    assert acks(station.send(clear)) == [mavlink.MAV_MISSION_ACCEPTED]
    assert station.download() == []
    station.wait(60)
    assert station.height_m > 15


@pytest.mark.autopilots("2 types 2 / 3 / 255")
@pytest.mark.parametrize(("kind", "result"), [(1, 0), (3, 3), (255, 3)], ids=["fence", "type 3", "all"])
def test_clearing_other_types_leaves_the_mission(kind: int, result: int) -> None:
    station = Station()
    assert station.upload(mission(4)) == 0
    assert acks(station.send(mavlink.MAVLink_mission_clear_all_message(1, 0, kind))) == [result]
    assert len(station.download()) == 4


@pytest.mark.autopilots("2 types 2 / 3 / 255")
def test_there_are_no_rally_points() -> None:
    station = Station()
    (reply,) = station.send(mavlink.MAVLink_mission_request_list_message(1, 0, 2))
    assert (reply.get_type(), reply.count, reply.mission_type) == ("MISSION_COUNT", 0, 2)


def test_the_mission_survives_a_reboot_and_speed_items_their_values() -> None:
    station = Station()
    assert station.upload([*mission(3), item(SPEED, param1=1, param2=7.5)]) == 0
    assert station.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1) == 0
    station.wait(5)
    kept = station.download()
    assert [m.command for m in kept] == [WP, mavlink.MAV_CMD_NAV_TAKEOFF, WP, SPEED]
    assert kept[3].param2 == 7.5
