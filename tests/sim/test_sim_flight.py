"""Whole flights in virtual time: missions by mode, and stops on request."""

import math

import pytest
from profiles import full_only
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import Station, home_item, item, land, place_m, station_of, takeoff, waypoint


def test_a_waypoint_on_a_straight_line_is_passed_at_full_speed() -> None:
    station = Station()
    station.stream(mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT)
    station.fly_mission([takeoff(), waypoint(100, 100), waypoint(200, 200), land(200, 200)])
    speeds: list[float] = []

    def watch() -> bool:
        if 70.0 < place_m(station)[0] < 130.0:
            last = station.of("GLOBAL_POSITION_INT")[-1]
            speeds.append(math.hypot(last.vx, last.vy) / 100)
        return place_m(station)[0] > 130.0

    station.until(watch)
    assert min(speeds) > 9.5


@pytest.mark.autopilots("1.8", "2 item 0", "MAVSDK 5 mission_raw item 0")
def test_a_plan_without_a_home_placeholder_silently_loses_its_take_off() -> None:
    station = Station()
    assert station.upload([takeoff(), waypoint(100, 0), land(100, 0)]) == mavlink.MAV_MISSION_ACCEPTED
    assert [m.command for m in station.download()] == [16, 16, 21]
    assert station.set_mode("GUIDED") == 0
    assert station.arm() == 0
    assert station.command(mavlink.MAV_CMD_MISSION_START) == mavlink.MAV_RESULT_FAILED
    assert "Auto: Missing Takeoff Cmd" in station.texts()


@pytest.mark.autopilots("1.8")
def test_auto_is_refused_on_the_ground_with_the_mission_past_its_take_off() -> None:
    # Landed by hand in the middle of a mission, still armed.
    station = Station()
    station.fly_mission([takeoff(5), waypoint(300, 0, 5), land(300, 0)])
    station.until(lambda: station.reached == [1])
    assert station.set_mode("LOITER") == 0
    station.until(lambda: station.height_m == 0, 30)
    assert station.armed
    assert station.set_mode("AUTO") == mavlink.MAV_RESULT_FAILED
    assert station.texts()[-1] == "Auto: Missing Takeoff Cmd"


@pytest.mark.autopilots("MAVSDK 3 replace mid-flight")
def test_a_swap_in_flight_by_hold_upload_set_current_and_auto() -> None:
    station = Station()
    station.fly_mission([takeoff(), waypoint(300, 0), land(300, 0)])
    station.until(lambda: place_m(station)[0] > 100)
    assert station.set_mode("GUIDED") == 0
    assert station.upload([home_item(), takeoff(), waypoint(100, 100), waypoint(0, 100), land(0, 100)]) == 0
    assert not any("restart" in text for text in station.texts())
    assert station.command(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, 2) == 0
    assert station.set_mode("AUTO") == 0
    assert station.ask(mavlink.MAVLINK_MSG_ID_MISSION_CURRENT).seq == 2
    station.until(lambda: not station.armed)
    assert station.reached == [1, 2, 3]
    assert place_m(station) == pytest.approx((0, 100), abs=1.0)


@pytest.mark.autopilots("1.7")
def test_auto_options_3_allows_arming_and_flying_in_auto() -> None:
    station = station_of(params={"AUTO_OPTIONS": 3})
    assert station.upload([home_item(), takeoff(10), land(0, 0)]) == 0
    assert station.set_mode("AUTO") == 0
    assert station.arm() == 0
    station.until(lambda: station.height_m > 8, 30)


def test_hold_time_speed_change_delay_and_jump_are_flown() -> None:
    station = Station()
    station.fly_mission(
        [
            takeoff(10),
            item(mavlink.MAV_CMD_DO_CHANGE_SPEED, param1=1, param2=4.0),
            waypoint(60, 0, 10, param1=5),
            waypoint(60, 30, 10),
            item(mavlink.MAV_CMD_DO_JUMP, param1=3, param2=1),
            item(mavlink.MAV_CMD_NAV_LOITER_TIME, 60, 30, 10, param1=7),
            item(mavlink.MAV_CMD_CONDITION_DELAY, param1=2),
            item(mavlink.MAV_CMD_DO_CHANGE_SPEED, param1=1, param2=8.0),
            item(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH),
        ]
    )
    fastest_m_s = 0.0

    def watch() -> bool:
        nonlocal fastest_m_s
        if 6 not in station.reached:
            fastest_m_s = max(fastest_m_s, station.speed_m_s)
        return not station.armed

    station.until(watch)
    # what is done on the way is reported too, but not the landing that ends it
    assert station.reached == [1, 2, 3, 4, 3, 4, 6, 7, 8]
    assert 3.9 < fastest_m_s < 4.2
    assert place_m(station) == pytest.approx((0, 0), abs=1.0)


@pytest.mark.parametrize("final_cm", [*full_only(500), 2000])  # below and above the height it comes at
def test_a_return_with_a_final_height_ends_there_and_does_not_land(final_cm: int) -> None:
    station = station_of(params={"RTL_ALT_FINAL": final_cm, "RTL_LOIT_TIME": 2000})
    station.fly(15)
    assert station.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH) == 0
    station.wait(60)
    assert station.armed
    assert station.height_m == pytest.approx(final_cm / 100, abs=0.3)
    assert place_m(station) == pytest.approx((0, 0), abs=1.0)


@pytest.mark.autopilots("MAVSDK 5 RTL / land")
def test_landing_is_slow_below_ten_metres() -> None:
    station = Station()
    station.fly(20)
    assert station.command(mavlink.MAV_CMD_NAV_LAND) == 0
    fast_s = station.until(lambda: station.height_m < 10.5)
    assert fast_s == pytest.approx(9.5 / 1.5, abs=1.5)  # WPNAV_SPEED_DN
    slow_s = station.until(lambda: not station.armed)
    assert slow_s == pytest.approx(9 / 0.5 + 1.5, abs=2.5)  # LAND_SPEED


@pytest.mark.autopilots("1.6")
@pytest.mark.parametrize("mode", ["LOITER", "CIRCLE", "ALT_HOLD", "POSHOLD", "STABILIZE"])
def test_a_copter_in_a_pilot_mode_without_sticks_sinks_to_the_ground(mode: str) -> None:
    station = Station()
    station.fly(20)
    assert station.set_mode(mode) == 0
    station.until(lambda: station.height_m == 0, 15)
    station.wait(0.2)
    (hit,) = [text for text in station.texts() if text.startswith("SIM Hit ground at")]
    assert mode == "STABILIZE" or hit == "SIM Hit ground at 2.50 m/s"


def test_the_leg_after_an_interrupted_one_begins_at_rest() -> None:
    # `AC_WPNav::set_wp_destination`: it begins at the place where the vehicle can stop.
    station = Station()
    station.fly_mission([takeoff(), waypoint(600, 0), waypoint(600, 300), land(0, 300)])
    station.until(lambda: place_m(station)[0] > 100)
    begun_m = place_m(station)[0]
    assert station.command(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, 3) == 0
    speeds_m_s = []

    def turns() -> bool:
        position = station.ask(mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT)
        speeds_m_s.append(math.hypot(position.vx, position.vy) / 100)
        return place_m(station)[1] > 10

    station.until(turns, 60)
    assert (max(speeds_m_s) > 9, min(speeds_m_s) < 1.5) == (True, True)
    assert place_m(station)[0] - begun_m > 15, "the copter stops ahead"


def test_a_change_far_ahead_does_not_disturb_the_current_leg() -> None:
    station = Station()
    items = [waypoint(600 + 100 * i, 0) for i in range(5)]
    station.fly_mission([takeoff(), *items])
    station.until(lambda: place_m(station)[0] > 100)
    for index, is_seen in ((6, False), (5, False), (4, True)):
        n_before = station.texts().count("Auto mission changed, restarted command")
        station.send(mavlink.MAVLink_mission_write_partial_list_message(1, 1, index, index, 0))
        station.send(station.item_message(index, waypoint(600, 50.0 * index)))
        n_after = station.texts().count("Auto mission changed, restarted command")
        assert (n_after - n_before) == is_seen


@pytest.mark.autopilots("2 DO_SET_MISSION_CURRENT")
def test_a_restart_in_flight_leads_through_the_take_off_to_item_2() -> None:
    station = Station()
    set_current = mavlink.MAV_CMD_DO_SET_MISSION_CURRENT
    station.fly_mission([takeoff(), waypoint(300, 0), waypoint(0, 300)])
    station.until(lambda: place_m(station)[0] > 50)
    assert station.command(set_current, 3) == 0
    assert station.command(set_current, 0) == 0
    station.wait(1)
    assert station.current == 2
