"""Missions with changes, pauses and invalid values in flight."""

from typing import Any

import pytest
from px4_station import NAN, QuietPx4Station, command_item
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import (
    ALT_M,
    Station,
    home_item,
    item,
    land,
    landing_mission,
    place_m,
    station_of,
    takeoff,
    waypoint,
)

ACCEPTED, DENIED, FAILED = 0, 2, 4
RALLY, RALLY_POINT = 2, 5100


def upload_rally(station: Station, north_m: float, z: float, frame: int = 3) -> None:
    assert station.upload([item(RALLY_POINT, north_m, 0, z, frame=frame)], RALLY) == 0


# -- a mission shorter than its index --------------------------------------------------------------------


def test_a_mission_shortened_below_its_index_on_the_ground_starts_over() -> None:
    station = Station()
    assert station.upload([home_item(), takeoff(10), *[waypoint(10 * i, 0, 10) for i in range(5)]]) == 0
    assert station.command(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, 5) == ACCEPTED
    assert station.upload([home_item(), takeoff(10), waypoint(30, 0, 10)]) == 0
    assert station.set_mode("GUIDED") == ACCEPTED
    assert station.arm() == ACCEPTED
    assert station.command(mavlink.MAV_CMD_MISSION_START) == ACCEPTED
    station.until(lambda: place_m(station)[0] > 29, 60)
    assert station.texts().count("Mission: 1 Takeoff") == 1


def test_a_mission_shortened_below_its_index_in_another_mode_starts_over() -> None:
    station = Station()
    station.fly_mission([takeoff(10), waypoint(40, 0, 10), waypoint(300, 0, 10)])
    station.until(lambda: station.current == 3, 90)
    assert station.set_mode("GUIDED") == ACCEPTED
    assert station.upload([home_item(), takeoff(20)]) == 0
    assert station.set_mode("AUTO") == ACCEPTED
    station.until(lambda: station.height_m > 19.5, 60)
    assert station.current == 1


def test_a_do_command_uploaded_at_the_current_index_is_executed() -> None:
    station = Station()
    station.fly_mission([takeoff(10), waypoint(80, 0, 10), waypoint(300, 0, 10)])
    station.until(lambda: station.current == 2, 60)
    assert station.set_mode("GUIDED") == ACCEPTED
    slower = item(mavlink.MAV_CMD_DO_CHANGE_SPEED, param1=1, param2=3)
    assert station.upload([home_item(), takeoff(10), slower, waypoint(300, 0, 10)]) == 0
    assert station.set_mode("AUTO") == ACCEPTED
    station.wait(12)
    assert station.current == 3
    assert station.speed_m_s == pytest.approx(3.0, abs=0.2)


def test_do_commands_before_a_selected_command_run_with_it() -> None:
    station = Station()
    slower = item(mavlink.MAV_CMD_DO_CHANGE_SPEED, param1=1, param2=3)
    assert station.upload([home_item(), takeoff(10), slower, waypoint(300, 0, 10)]) == 0
    station.fly(10)
    assert station.command(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, 2) == ACCEPTED
    assert station.current == 3
    assert station.set_mode("AUTO") == ACCEPTED
    station.wait(12)
    assert station.speed_m_s == pytest.approx(3.0, abs=0.2)


def test_a_condition_continues_after_a_flight_in_another_mode() -> None:
    station = Station()
    near = item(mavlink.MAV_CMD_CONDITION_DISTANCE, param1=100)
    slower = item(mavlink.MAV_CMD_DO_CHANGE_SPEED, param1=1, param2=3)
    station.fly_mission([takeoff(10), near, slower, waypoint(200, 0, 10)])
    station.until(lambda: place_m(station)[0] > 30, 60)
    assert station.set_mode("GUIDED") == ACCEPTED
    station.wait(4)
    assert station.set_mode("AUTO") == ACCEPTED
    station.until(lambda: place_m(station)[0] > 130, 60)
    assert station.speed_m_s == pytest.approx(3.0, abs=0.2)


# -- pauses ----------------------------------------------------------------------------------------------


def paused() -> Station:
    station = Station()
    station.fly_mission([takeoff(10), waypoint(150, 0, 10), waypoint(200, 0, 10), waypoint(0, 0, 10)])
    station.until(lambda: place_m(station)[0] > 20, 60)
    assert station.command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0) == ACCEPTED
    station.wait(6)
    return station


def test_selecting_a_command_during_a_pause_resumes_the_mission() -> None:
    station = paused()
    assert station.command(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, 3) == ACCEPTED
    state = station.ask(mavlink.MAVLINK_MSG_ID_MISSION_CURRENT).mission_state
    assert state == mavlink.MISSION_STATE_ACTIVE
    station.until(lambda: station.current == 4, 90)


def test_a_new_mission_during_a_pause_is_flown_after_the_pause() -> None:
    station = paused()
    here = place_m(station)[0]
    assert station.upload([home_item(), takeoff(10), waypoint(0, 90, 10), waypoint(0, 0, 10)]) == 0
    station.wait(15)
    assert place_m(station)[0] == pytest.approx(here, abs=0.5)
    state = station.ask(mavlink.MAVLINK_MSG_ID_MISSION_CURRENT).mission_state
    assert state == mavlink.MISSION_STATE_PAUSED
    assert station.command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 1) == ACCEPTED
    station.until(lambda: station.current == 3, 90)


def test_a_vehicle_flies_to_a_deleted_command_after_a_pause() -> None:
    station = Station()
    station.fly_mission([takeoff(10), waypoint(20, 0, 10), waypoint(120, 0, 10)])
    station.until(lambda: station.current == 3 and place_m(station)[0] > 40, 60)
    assert station.command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0) == ACCEPTED
    station.wait(6)
    assert station.upload([home_item(), takeoff(10)]) == 0
    assert station.command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 1) == ACCEPTED
    station.until(lambda: place_m(station)[0] > 119, 60)


# -- invalid and zero numbers ----------------------------------------------------------------------------


@pytest.mark.parametrize("command", [16, 19, 93, 112, 178])
def test_px4_continues_after_a_nan_hold_delay_or_type_of_speed(command: int) -> None:
    station = QuietPx4Station()
    waits = item(command, 20, 0, 10.0, param1=NAN, param2=3.0, frame=6 if command in (16, 19) else 2)
    station.fly_mission([takeoff(10), waits, waypoint(40, 0, 10.0)])
    station.until(lambda: place_m(station)[0] > 38, 90)


def test_px4_flies_to_a_zero_altitude_and_arducopter_keeps_its_altitude() -> None:
    copter, px4 = Station(), QuietPx4Station()
    copter.fly_mission([takeoff(15), waypoint(60, 0, 0.0), waypoint(100, 0, 15.0)])
    copter.until(lambda: copter.current == 3, 90)
    assert copter.height_m == pytest.approx(15, abs=2.0)  # the altitude before this leg
    px4.fly_mission([takeoff(15), waypoint(60, 0, 0.0)])
    px4.until(lambda: place_m(px4)[0] > 50, 90)
    px4.wait(20)
    assert px4.height_m < 1.0


# -- rally points ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("frame", "z", "expected_m"), [(0, ALT_M + 40.0, 40.0), (3, 5.0, 15.0)])
def test_arducopter_returns_at_the_higher_of_rally_point_and_return_altitude(
    frame: int, z: float, expected_m: float
) -> None:
    station = Station()
    upload_rally(station, 60.0, z, frame)
    assert station.parameter("RALLY_TOTAL") == 1
    station.fly(10)
    assert station.reposition(100, 10) == ACCEPTED
    station.wait(25)
    assert station.set_mode("RTL") == ACCEPTED
    assert station.highest_m() == pytest.approx(expected_m, abs=0.7)
    assert place_m(station)[0] == pytest.approx(60, abs=1.5)


def test_px4_counts_its_return_altitude_from_the_rally_point() -> None:
    station = QuietPx4Station(params={"RTL_RETURN_ALT": 20.0, "RTL_CONE_ANG": 0})
    upload_rally(station, 60.0, 12.0, 3)
    station.fly(10)
    assert station.reposition(110, 10) == ACCEPTED
    station.wait(30)
    assert station.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH) == ACCEPTED
    assert station.highest_m() == pytest.approx(32, abs=1.0)


def test_arduplane_circles_at_the_altitude_of_its_rally_point() -> None:
    station = station_of("plane")
    upload_rally(station, 300.0, 140.0)
    assert station.set_mode("TAKEOFF") == ACCEPTED
    assert station.arm() == ACCEPTED
    station.wait(30)
    assert station.set_mode("RTL") == ACCEPTED
    station.wait(90)
    assert station.height_m == pytest.approx(140, abs=5)


# -- commands --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("items", [(2, 5), (0, 2), (1, 0), (NAN, 0)])
def test_arducopter_refuses_to_start_part_of_a_mission(items: tuple[float, float]) -> None:
    station = Station()
    assert station.upload([home_item(), takeoff(10), waypoint(50, 0, 10)]) == 0
    assert station.set_mode("GUIDED") == ACCEPTED
    assert station.arm() == ACCEPTED
    assert station.command(mavlink.MAV_CMD_MISSION_START, *items) == DENIED
    assert station.mode == "GUIDED"


def test_px4_starts_at_the_requested_item() -> None:
    station = QuietPx4Station()
    station.upload_and_wait([takeoff(10), waypoint(200, 0, 10.0), waypoint(30, 0, 10.0)])
    assert station.command(mavlink.MAV_CMD_MISSION_START, 3) == DENIED
    assert station.command(mavlink.MAV_CMD_MISSION_START, 2, 2) == ACCEPTED
    assert station.current == 2


def test_px4_flies_a_return_as_the_last_item_in_its_mode_without_a_report() -> None:
    station = QuietPx4Station()
    rtl = command_item(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    station.fly_mission([takeoff(10), waypoint(30, 0, 10.0), rtl])
    assert station.mode == "Mission"
    station.until(lambda: station.mode == "Return", 90)
    station.until(lambda: not station.armed, 200)
    assert {message.seq for message in station.of("MISSION_ITEM_REACHED")} == {0, 1}
    assert station.current == 2
    assert place_m(station)[0] == pytest.approx(0, abs=3)


def test_arduplane_jumps_to_its_landing_sequence_on_request() -> None:
    station = station_of("plane")
    station.fly_plane_mission(landing_mission())
    station.until(lambda: station.current == 2, 90)
    station.wait(10)
    assert station.set_mode("RTL") == ACCEPTED
    assert station.command(mavlink.MAV_CMD_DO_LAND_START) == ACCEPTED
    assert (station.mode, station.current) == ("AUTO", 4)
    assert "Landing sequence start" in station.texts()
    station.until(lambda: station.current == 5, 200)


def test_arduplane_without_a_landing_sequence_reports_that() -> None:
    station = station_of("plane")
    assert station.upload([home_item(), takeoff(60), waypoint(500, 0, 60)]) == 0
    assert station.command(mavlink.MAV_CMD_DO_LAND_START) == FAILED
    assert station.texts()[-1] == "Unable to start landing sequence"


# -- changes of ArduCopter's mission in flight ---------------------------------------------------------

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
    assert station.current == 2


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
    current = station.ask(mavlink.MAVLINK_MSG_ID_MISSION_CURRENT)
    assert (current.seq, current.total, current.mission_state) == (4, 3, 5)
    assert station.armed


@pytest.mark.autopilots("2 DO_SET_MISSION_CURRENT")
def test_setting_the_current_item_with_a_reset_restarts_the_jump_counts() -> None:
    def flown(reset: int) -> list[int]:
        station = Station()
        jump = item(mavlink.MAV_CMD_DO_JUMP, param1=2, param2=1)
        station.fly_mission([takeoff(5), waypoint(15, 0, 5), waypoint(30, 0, 5), jump, land(30, 10)])
        station.until(lambda: station.reached == [1, 2, 3, 2], 90)
        assert station.command(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, 3, reset) == ACCEPTED
        station.until(lambda: not station.armed, 180)
        return station.reached

    assert flown(reset=0) == [1, 2, 3, 2, 3]
    assert flown(reset=1) == [1, 2, 3, 2, 3, 2, 3]


@pytest.mark.autopilots("2 pause/continue")
def test_an_empty_mission_cannot_be_paused() -> None:
    station = Station()
    assert station.set_mode("AUTO") == 0
    assert station.command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0) == FAILED
