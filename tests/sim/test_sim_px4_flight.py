"""PX4 in the air: take-off, return, landing, hold, offboard, missions, failsafes, and the fixed wing."""

import math
from itertools import pairwise
from typing import Any

import pytest
from profiles import full_only
from px4_station import ACCEPTED, NAN, TEMPORARILY_REJECTED, UNSUPPORTED, QuietPx4Station
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import ALT_M, LAT_DEG, LON_DEG, land, place_m, setpoint, takeoff, waypoint

E7 = 10_000_000
NORTH_DEG_PER_M = 1 / 111_195.0


def away_m(station: QuietPx4Station) -> float:
    return math.hypot(*place_m(station))


# -- take-off --------------------------------------------------------------------------------------------


@pytest.mark.autopilots("MAVSDK 5 takeoff", of="px4")
@pytest.mark.parametrize("altitude_m", [NAN, 5.0])
def test_takeoff_without_an_altitude_or_too_low_climbs_to_mis_takeoff_alt(altitude_m: float) -> None:
    station = QuietPx4Station(params={"MIS_TAKEOFF_ALT": 8.0})
    assert station.arm() == ACCEPTED
    assert station.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, NAN, NAN, NAN, altitude_m) == ACCEPTED
    station.until(lambda: station.mode == "Hold", 60)
    assert station.height_m == pytest.approx(8, abs=0.7)
    raised = any(text.startswith("Using minimum takeoff altitude") for text in station.texts())
    assert raised is (altitude_m == 5.0)


def test_arming_in_takeoff_mode_starts_the_take_off() -> None:
    station = QuietPx4Station()
    assert station.set_mode("Takeoff") == ACCEPTED
    station.wait(5)
    assert not station.armed
    assert station.arm() == ACCEPTED
    station.until(lambda: station.mode == "Hold", 30)
    assert station.height_m == pytest.approx(2.5, abs=0.5)


# -- disarming, landing, return --------------------------------------------------------------------------


@pytest.mark.autopilots("MAVSDK 5 RTL / land", of="px4")
def test_a_landing_slows_down_and_disarms_two_seconds_after_touchdown() -> None:
    station = QuietPx4Station()
    station.fly(20)
    assert station.command(mavlink.MAV_CMD_NAV_LAND) == ACCEPTED
    assert "Landing at current position" in station.texts()
    station.until(lambda: station.height_m < 4.5, 60)
    start_s, start_m = station.now, station.height_m
    station.wait(3.0)
    assert (start_m - station.height_m) / (station.now - start_s) == pytest.approx(
        0.7, abs=0.1
    )  # MPC_LAND_SPEED
    station.until(lambda: not station.fleet.truth().airborne[0], 30)
    touched_s = station.now
    station.until(lambda: not station.armed, 10)
    assert station.now - touched_s == pytest.approx(2.0, abs=0.3)  # COM_DISARM_LAND
    assert station.texts()[-2:] == ["Landing detected", "Disarmed by landing"]
    assert station.mode == "Hold"  # the last mode in which arming is allowed


def test_a_return_climbs_flies_home_descends_and_lands() -> None:
    station = QuietPx4Station()
    station.fly(12)
    assert station.reposition(60, 12) == ACCEPTED
    station.until(lambda: abs(place_m(station)[0] - 60) < 2, 60)
    assert station.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH) == ACCEPTED
    assert "Returning to launch" in station.texts()
    station.until(lambda: station.height_m > 29, 30)  # RTL_RETURN_ALT
    assert away_m(station) > 55
    station.until(lambda: away_m(station) < 2, 60)
    station.until(lambda: not station.armed, 120)
    assert away_m(station) < 2


@pytest.mark.parametrize(
    ("north_m", "highest_m"),
    [*full_only((0, 5), (3, 5)), (8, 8), (12, 30)],  # there; twice NAV_ACC_RAD; a cone of 45 deg; beyond
)
def test_a_return_within_rtl_min_dist_climbs_to_a_cone(north_m: float, highest_m: float) -> None:
    station = QuietPx4Station()
    station.fly(5)
    assert station.reposition(north_m, 5) == ACCEPTED
    station.wait(15)
    assert station.set_mode("Return") == ACCEPTED
    assert station.highest_m() == pytest.approx(highest_m, abs=0.7)


def test_a_negative_rtl_land_delay_keeps_a_return_over_home() -> None:
    station = QuietPx4Station(params={"RTL_LAND_DELAY": -1.0})
    station.fly(20)
    assert station.set_mode("Return") == ACCEPTED
    station.wait(40)
    assert station.armed
    assert station.height_m == pytest.approx(10, abs=1.0)  # RTL_DESCEND_ALT


# -- guided flight ----------------------------------------------------------------------------------------


@pytest.mark.autopilots("1.17", "MAVSDK 5 goto_location", of="px4")
def test_a_reposition_as_command_long_is_flown_in_hold() -> None:
    station = QuietPx4Station()
    station.fly(10)
    place = (LAT_DEG + 30 * NORTH_DEG_PER_M, LON_DEG, ALT_M + 20)
    assert station.command(mavlink.MAV_CMD_DO_REPOSITION, -1, 1, 0, NAN, *place) == ACCEPTED
    station.until(lambda: abs(place_m(station)[0] - 30) < 1.5 and station.height_m > 19, 60)
    assert station.mode == "Hold"


def test_a_reposition_needs_its_flag_and_a_target_inside_the_fence() -> None:
    station = QuietPx4Station(params={"GF_MAX_HOR_DIST": 50.0})
    station.fly(10)
    far = (LAT_DEG + 200 * NORTH_DEG_PER_M, LON_DEG, ALT_M + 10)
    assert station.command(mavlink.MAV_CMD_DO_REPOSITION, -1, 0, 0, NAN, *far) == UNSUPPORTED
    assert station.command(mavlink.MAV_CMD_DO_REPOSITION, -1, 1, 0, NAN, *far) == ACCEPTED
    assert "Reposition is outside geofence" in station.texts()
    station.wait(20)
    assert away_m(station) < 3


def test_a_change_of_altitude_keeps_the_position() -> None:
    station = QuietPx4Station()
    station.fly(10)
    assert station.command(mavlink.MAV_CMD_DO_CHANGE_ALTITUDE, ALT_M + 25) == ACCEPTED
    station.until(lambda: station.height_m > 24, 30)
    assert away_m(station) < 2


def test_an_orbit_circles_a_point() -> None:
    station = QuietPx4Station()
    station.fly(10)
    orbit = (20.0, 4.0, 0, NAN, LAT_DEG, LON_DEG, ALT_M + 10)
    assert station.command(mavlink.MAV_CMD_DO_ORBIT, *orbit) == ACCEPTED
    assert station.mode == "Orbit"
    station.wait(20)
    distances, angles = [], []
    for _ in range(40):
        station.wait(0.5)
        distances.append(away_m(station))
        angles.append(math.atan2(place_m(station)[1], place_m(station)[0]))
    assert min(distances) > 17
    assert max(distances) < 24
    turned = sum(math.remainder(b - a, 2 * math.pi) for a, b in pairwise(angles))
    assert turned > 2.5  # clockwise, at about 4 m/s on 20 m


def test_a_pilots_mode_is_not_available_in_the_air_without_a_pilot() -> None:
    station = QuietPx4Station()
    station.fly(10)
    assert station.set_mode("Position") == TEMPORARILY_REJECTED
    assert "Switching to Position is currently not available" in station.texts()
    assert station.mode == "Hold"


# -- offboard --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("action", "mode"),
    [(0, "Position"), (1, "Altitude"), (2, "Stabilized"), (3, "Return"), (4, "Land"), (5, "Hold")],
)
def test_com_obl_rc_act_is_the_reaction_to_lost_setpoints(action: int, mode: str) -> None:
    station = QuietPx4Station(params={"COM_OBL_RC_ACT": action, "COM_OF_LOSS_T": 1.0})
    station.fly(10)
    station.hold(setpoint((0, 0, -10)), 1.5)
    assert station.set_mode("Offboard") == ACCEPTED
    station.hold(setpoint((0, 0, -10)), 2)
    station.wait(0.7)
    assert station.mode == "Offboard"
    station.wait(0.6)
    assert station.mode == mode
    assert "Failsafe activated" in station.texts()


# -- missions --------------------------------------------------------------------------------------------


def test_a_landing_inside_a_mission_does_not_disarm() -> None:
    """`Commander::handleAutoDisarm` does not disarm in mission mode before the end of the mission."""
    station = QuietPx4Station()
    station.fly_mission([takeoff(10), land(30, 20), waypoint(60, 20, 10)])
    station.until(lambda: station.current == 2, 240)
    station.wait(10)
    assert station.armed
    assert station.set_mode("Hold") == ACCEPTED
    station.until(lambda: not station.armed, 10)


# -- failsafes -------------------------------------------------------------------------------------------


def test_a_lost_ground_station_causes_a_hold_and_then_the_failsafe() -> None:
    station = QuietPx4Station(params={"COM_DL_LOSS_T": 6})
    station.fly(10)
    station.beat()
    station.set_parameter("NAV_DLL_ACT", 2)
    station.wait(5.5)
    assert station.texts().count("Failsafe activated") == 0
    station.wait(1.0)
    assert "Failsafe activated: entering Hold for 5 seconds" in station.texts()
    assert station.mode == "Hold"
    station.wait(5.0)
    assert station.mode == "Return"
    assert station.heartbeat().system_status == mavlink.MAV_STATE_CRITICAL
    station.beat()
    station.wait(0.5)
    assert "GCS connection regained" in station.texts()


def test_a_mode_chosen_during_the_hold_takes_over() -> None:
    station = QuietPx4Station(params={"COM_DL_LOSS_T": 6})
    station.fly(10)
    station.beat()
    station.set_parameter("NAV_DLL_ACT", 2)
    station.until(lambda: any("entering Hold" in text for text in station.texts()), 10)
    station.upload_and_wait([waypoint(50, 0), waypoint(100, 0)])
    assert station.set_mode("Mission") == ACCEPTED
    station.wait(8)
    assert station.mode == "Mission"


def test_a_warning_during_the_hold_does_not_end_the_hold() -> None:
    station = QuietPx4Station(params={"COM_DL_LOSS_T": 2, "BAT_LOW_THR": 0.5, "BAT_CRIT_THR": 0.1})
    station.fly(10)
    station.beat()
    station.set_parameter("NAV_DLL_ACT", 2)
    station.until(lambda: any("entering Hold" in text for text in station.texts()), 10)
    station.inject("battery_sag:sag_v=0,at_most=0.3")
    station.wait(2)
    assert "Low battery level" in station.texts()
    station.until(lambda: station.mode == "Return", 5)


@pytest.mark.autopilots("2 fence use", of="px4")
@pytest.mark.parametrize(("action", "mode"), [(1, "Mission"), (2, "Hold"), (3, "Return"), (5, "Land")])
def test_gf_action_is_the_reaction_to_a_breach_of_the_fence_around_home(action: int, mode: str) -> None:
    station = QuietPx4Station(params={"GF_ACTION": action, "GF_MAX_HOR_DIST": 30.0, "COM_FAIL_ACT_T": 0.0})
    station.fly_mission([takeoff(10), waypoint(150, 0, 10), waypoint(150, 10, 10)])
    station.until(lambda: place_m(station)[0] > 31, 60)
    station.wait(1.0)
    assert station.mode == mode
    assert "Failsafe activated" in station.texts()


def test_each_battery_limit_has_its_reaction() -> None:
    params = {"COM_LOW_BAT_ACT": 3, "COM_FAIL_ACT_T": 0.0, "BAT1_CAPACITY": 250.0}
    station = QuietPx4Station(
        params={**params, "BAT_LOW_THR": 0.5, "BAT_CRIT_THR": 0.4, "BAT_EMERGEN_THR": 0.3}
    )
    station.fly(30)
    station.until(lambda: "Low battery level" in station.texts(), 600)
    assert station.mode == "Hold"
    station.until(lambda: "Critical battery level" in station.texts(), 600)
    assert station.mode == "Return"


@pytest.mark.parametrize(
    ("least", "share", "answer", "text"),
    [
        (-1.0, 0.45, ACCEPTED, "Low battery"),  # a low battery is no reason
        (-1.0, 0.35, TEMPORARILY_REJECTED, "Critical battery"),
        (0.6, 0.55, TEMPORARILY_REJECTED, "Low battery"),
        (0.2, 0.25, ACCEPTED, "Emergency battery level"),
        (0.2, 0.15, TEMPORARILY_REJECTED, "Emergency battery level"),
    ],
)
def test_com_arm_bat_min_is_the_lowest_charge_for_arming(
    least: float, share: float, answer: int, text: str
) -> None:
    params = {"COM_ARM_BAT_MIN": least, "BAT_LOW_THR": 0.5, "BAT_CRIT_THR": 0.4, "BAT_EMERGEN_THR": 0.3}
    station = QuietPx4Station(params=params)
    station.inject(f"battery_sag:sag_v=0,at_most={share}")
    station.wait(1.0)
    assert station.arm() == answer
    assert (f"Preflight Fail: {text}" in station.texts()) is (answer != ACCEPTED)


BATTERY = {"COM_LOW_BAT_ACT": 2, "BAT_LOW_THR": 0.5, "BAT_CRIT_THR": 0.4, "BAT_EMERGEN_THR": 0.1}


def charge_state(station: QuietPx4Station) -> int:
    return int(station.ask(mavlink.MAVLINK_MSG_ID_BATTERY_STATUS).charge_state)


def test_an_empty_battery_ends_every_flight() -> None:
    station = QuietPx4Station(params=BATTERY)
    for _ in range(2):
        station.fly(10)
        station.inject("battery_sag:sag_v=0,at_most=0.3,for=3")
        station.until(lambda: station.mode == "Land", 10)
        station.wait(5)  # the battery is full again, and the landing goes on
        assert station.heartbeat().system_status == mavlink.MAV_STATE_CRITICAL
        assert charge_state(station) == mavlink.MAV_BATTERY_CHARGE_STATE_CRITICAL
        station.until(lambda: not station.armed, 60)
        station.wait(1)
        assert charge_state(station) == mavlink.MAV_BATTERY_CHARGE_STATE_OK
    assert station.texts().count("Critical battery level") == 2


@pytest.mark.parametrize(
    ("share", "level"),
    [
        (0.6, mavlink.MAV_BATTERY_CHARGE_STATE_OK),
        (0.45, mavlink.MAV_BATTERY_CHARGE_STATE_LOW),
        (0.3, mavlink.MAV_BATTERY_CHARGE_STATE_CRITICAL),
        (0.05, mavlink.MAV_BATTERY_CHARGE_STATE_EMERGENCY),
    ],
)
def test_the_charge_state_follows_the_battery_on_the_ground(share: float, level: int) -> None:
    station = QuietPx4Station(params=BATTERY)
    station.inject(f"battery_sag:sag_v=0,at_most={share},for=3")
    station.wait(2)
    assert charge_state(station) == level
    station.wait(3)
    assert charge_state(station) == mavlink.MAV_BATTERY_CHARGE_STATE_OK


def test_a_battery_critical_at_arming_causes_no_failsafe() -> None:
    station = QuietPx4Station(params={**BATTERY, "COM_ARM_BAT_MIN": 0.2})
    station.inject("battery_sag:sag_v=0,at_most=0.3")
    station.wait(2)
    station.fly(10)
    station.wait(5)
    assert station.mode == "Hold"
    station.inject("battery_sag:sag_v=0,at_most=0.05")
    station.until(lambda: station.mode == "Land", 10)


@pytest.mark.parametrize(("lost_before", "mode"), [(True, "Hold"), (False, "Return")])
def test_a_remote_control_lost_before_arming_does_not_count(*, lost_before: bool, mode: str) -> None:
    station = QuietPx4Station(params={"NAV_RCL_ACT": 2, "COM_FAIL_ACT_T": 0.0})
    if lost_before:
        station.inject("rc_loss")
        station.wait(1)
    station.fly(10)
    station.inject("rc_loss")
    station.wait(2)
    assert station.mode == mode


def terminated_by_command(station: QuietPx4Station) -> None:
    assert station.command(mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 1) == ACCEPTED


def terminated_by_failsafe(station: QuietPx4Station) -> None:
    station.beat()
    station.set_parameter("NAV_DLL_ACT", 5)
    station.until(lambda: not station.armed, 10)


@pytest.mark.parametrize("terminate", [terminated_by_command, terminated_by_failsafe])
def test_a_terminated_flight_stays_terminated_until_the_next_boot(terminate: Any) -> None:
    station = QuietPx4Station(params={"COM_DL_LOSS_T": 2, "COM_FAIL_ACT_T": 0.0})
    station.fly(20)
    terminate(station)
    station.wait(10)
    assert not station.armed
    assert station.height_m < 0.1
    assert station.mode == "Termination"
    assert station.heartbeat().system_status == mavlink.MAV_STATE_FLIGHT_TERMINATION
    station.set_parameter("NAV_DLL_ACT", 0)
    assert station.set_mode("Hold") == TEMPORARILY_REJECTED
    assert station.arm() == TEMPORARILY_REJECTED
    assert station.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1) == ACCEPTED
    station.wait(5)
    assert station.mode == "Hold"
    assert station.heartbeat().system_status == mavlink.MAV_STATE_STANDBY


def test_a_disarming_failsafe_does_not_terminate() -> None:
    station = QuietPx4Station(params={"COM_DL_LOSS_T": 2, "COM_FAIL_ACT_T": 0.0})
    station.fly(20)
    station.beat()
    station.set_parameter("NAV_DLL_ACT", 6)
    station.until(lambda: not station.armed, 10)
    assert station.mode == "Hold"


@pytest.mark.parametrize("rate_deg_s", [10.0, 45.0])
def test_mpc_yawrauto_max_is_the_turn_rate(rate_deg_s: float) -> None:
    station = QuietPx4Station(params={"MPC_YAWRAUTO_MAX": rate_deg_s})
    station.fly(20)
    east = (round(LAT_DEG * E7), round((LON_DEG + 0.01) * E7), ALT_M + 20)
    assert station.command_int(mavlink.MAV_CMD_DO_REPOSITION, 5, *east, -1, 1, 0, NAN) == ACCEPTED
    station.wait(1.5)
    turned_deg = math.degrees(station.ask(mavlink.MAVLINK_MSG_ID_ATTITUDE).yaw)
    assert turned_deg == pytest.approx(1.5 * rate_deg_s, rel=0.15)


# -- fixed wing ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("radius_m", [60.0, *full_only(120.0)])
def test_a_plane_returns_to_a_circle_of_rtl_loiter_rad(radius_m: float) -> None:
    station = QuietPx4Station("plane", params={"RTL_LOITER_RAD": radius_m})
    assert station.arm() == ACCEPTED
    assert station.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, NAN, NAN, NAN, ALT_M + 50) == ACCEPTED
    station.until(lambda: station.mode == "Hold", 120)
    assert station.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH) == ACCEPTED
    station.wait(60)
    away = []
    for _ in range(40):
        station.wait(1.0)
        away.append(away_m(station))
    assert min(away) == pytest.approx(radius_m, abs=5)
    assert max(away) == pytest.approx(radius_m, abs=5)
