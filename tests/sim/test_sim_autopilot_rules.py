"""Rules that a vehicle keeps under any request of a ground station, parameter or fault."""

import math
from typing import Any

import pytest
from profiles import full_only
from px4_station import QuietPx4Station
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import (
    BODY,
    BODY_OFFSET,
    LOCAL,
    OFFSET,
    Station,
    airborne_plane,
    item,
    place_m,
    setpoint,
    station_of,
    takeoff,
    waypoint,
)

from sim_vehicle.station.messages import command_long

FAILED = 4


def plane_in_guided(params: dict[str, float] | None = None) -> Station:
    station = airborne_plane(params)
    assert station.set_mode("GUIDED") == 0
    return station


# -- limits --------------------------------------------------------------------------------------------------


@pytest.mark.autopilots("MAVSDK 5 set_current_speed")
def test_a_changed_speed_holds_until_its_own_parameter_or_the_mode_changes() -> None:
    station = Station()
    station.fly(20)
    assert station.reposition(1000, 20) == 0
    assert station.command(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, 4) == 0
    station.wait(10)
    assert station.speed_m_s == pytest.approx(4.0, abs=0.2)
    station.set_parameter("RTL_ALT", 2000)
    station.wait(5)
    assert station.speed_m_s == pytest.approx(4.0, abs=0.2)
    station.set_parameter("WPNAV_SPEED", 700)
    station.wait(5)
    assert station.speed_m_s == pytest.approx(7.0, abs=0.2)


def test_a_negative_speed_restores_the_cruising_speed_of_px4() -> None:
    station = QuietPx4Station()
    station.fly_mission([takeoff(20), waypoint(2000, 0, 20)])
    station.until(lambda: station.speed_m_s > 4.5, 60)
    assert station.command(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, 3) == 0
    station.wait(5)
    assert station.speed_m_s == pytest.approx(3.0, abs=0.2)
    assert station.command(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, -1) == 0
    station.wait(5)
    assert station.speed_m_s == pytest.approx(5.0, abs=0.2)


def test_an_impossible_voltage_is_limited_and_the_vehicle_continues() -> None:
    station = QuietPx4Station(params={"BAT1_V_CHARGED": 3e38, "BAT1_N_CELLS": 12, "SDLOG_MODE": 2})
    station.wait(3)
    assert 0 < station.fleet.world.batteries.voltage_v[0] <= 1000
    assert station.of("HEARTBEAT")


# -- failsafes -----------------------------------------------------------------------------------------------


def test_a_low_battery_refuses_arming_by_its_limit() -> None:
    station = station_of(params={"SIM_BATT_VOLTAGE": 10.0})
    station.wait(1)
    assert station.set_mode("GUIDED") == 0
    assert station.arm() == FAILED
    assert "Arm: Battery 1 low voltage failsafe" in station.texts()
    station.set_parameter("SIM_BATT_VOLTAGE", 12.6)
    station.wait(1)
    assert station.arm() == 0


def test_a_recovered_battery_refuses_arming_until_the_next_boot() -> None:
    station = Station()
    station.set_mode("GUIDED")
    assert station.arm() == 0
    station.set_parameter("DISARM_DELAY", 0)
    station.set_parameter("SIM_BATT_VOLTAGE", 10.0)
    station.until(lambda: any("is low" in text for text in station.texts()), 20)
    station.set_parameter("SIM_BATT_VOLTAGE", 12.6)
    assert station.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0) == 0
    station.wait(1)
    assert station.arm() == FAILED
    assert "Arm: Battery failsafe" in station.texts()
    station.set_parameter("ARMING_CHECK", 0)
    assert station.arm() == 0


def test_a_silent_ground_station_refuses_arming() -> None:
    station = station_of(params={"FS_GCS_ENABLE": 1})
    station.beat()
    station.set_mode("GUIDED")
    station.wait(7)
    assert station.arm() == FAILED
    assert "Arm: GCS failsafe on" in station.texts()
    station.beat()
    assert station.arm() == 0


def test_a_failsafe_with_an_action_stops_the_motors_on_the_ground() -> None:
    station = station_of(params={"FS_GCS_ENABLE": 1})
    station.beat()
    station.set_mode("GUIDED")
    assert station.arm() == 0
    took_s = station.until(lambda: not station.armed, 9)
    assert took_s == pytest.approx(5, abs=0.5)
    assert station.texts()[-2:] == ["GCS Failsafe", "Disarming motors"]


def test_a_failsafe_without_an_action_leaves_the_motors_on() -> None:
    station = Station()
    station.set_mode("GUIDED")
    assert station.arm() == 0
    station.set_parameter("DISARM_DELAY", 0)
    station.set_parameter("SIM_BATT_VOLTAGE", 10.0)  # BATT_FS_LOW_ACT 0
    station.until(lambda: any("is low" in text for text in station.texts()), 20)
    station.wait(1)
    assert station.armed


def outside_its_fence(params: dict[str, float], *points: dict[str, Any]) -> Station:
    """Return a station of a plane in GUIDED that has just left its fence, a circle of 300 m, to the north."""
    station = plane_in_guided({"FENCE_TYPE": 2, "FENCE_RADIUS": 300} | params)
    assert station.upload(list(points), mavlink.MAV_MISSION_TYPE_FENCE) == 0
    assert station.reposition(700, 60) == 0
    station.wait(1)
    station.set_parameter("FENCE_ENABLE", 1)
    station.until(lambda: any("breached" in text for text in station.texts()), 60)
    return station


@pytest.mark.parametrize("params", [{}, *full_only({"FENCE_ACTION": 1}), {"FENCE_ACTION": 8}])
def test_a_plane_returns_from_a_fence_by_default_and_without_autoland(params: dict[str, float]) -> None:
    station = outside_its_fence(params)
    station.wait(1)
    assert station.mode == "RTL"


def test_a_plane_goes_to_the_fences_return_point_in_guided() -> None:
    point = item(mavlink.MAV_CMD_NAV_FENCE_RETURN_POINT, 0, 150, 0, frame=0)
    station = outside_its_fence({"FENCE_ACTION": 7}, point)
    station.wait(60)
    assert station.mode == "GUIDED"
    assert math.dist(place_m(station), (0, 150)) == pytest.approx(60, abs=15)  # WP_LOITER_RAD
    assert station.height_m == pytest.approx((-10 + 2 + 100 - 2) / 2, abs=3)


def test_a_plane_without_a_return_point_flies_home_at_the_requested_altitude() -> None:
    station = outside_its_fence({"FENCE_ACTION": 6, "FENCE_RET_ALT": 80})
    station.wait(60)
    assert station.mode == "GUIDED"
    assert abs(place_m(station)[0]) < 75
    assert station.height_m == pytest.approx(80, abs=3)


@pytest.mark.parametrize(
    ("start_m", "altitude_m", "end_m"), [(160, 100, 100), *full_only((50, 100, 100), (160, -1, 160))]
)
def test_a_plane_returns_at_its_altitude_from_above_and_below(
    start_m: float, altitude_m: float, end_m: float
) -> None:
    station = plane_in_guided({"RTL_ALTITUDE": altitude_m})
    assert station.reposition(200, start_m) == 0
    station.until(lambda: abs(station.height_m - start_m) < 2, 90)
    assert station.set_mode("RTL") == 0
    station.wait(60)
    assert station.height_m == pytest.approx(end_m, abs=4)


def test_the_time_of_a_breach_counts_from_the_boot() -> None:
    station = Station()
    station.wait(100)
    assert station.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1) == 0
    station.wait(5)
    station.set_parameter("FENCE_ALT_MAX", 15)
    station.set_parameter("FENCE_ACTION", 0)
    station.set_parameter("FENCE_ENABLE", 1)
    assert station.ask(mavlink.MAVLINK_MSG_ID_FENCE_STATUS).breach_time == 0
    station.set_mode("GUIDED")
    assert station.arm() == 0
    assert station.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 20) == 0
    station.until(lambda: any("breached" in text for text in station.texts()), 60)
    boot_ms = station.ask(mavlink.MAVLINK_MSG_ID_SYSTEM_TIME).time_boot_ms
    assert station.ask(mavlink.MAVLINK_MSG_ID_FENCE_STATUS).breach_time == pytest.approx(boot_ms, abs=200)


# -- set-points ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("frame", "turns"), [(LOCAL, False), (OFFSET, False), (BODY, True), (BODY_OFFSET, True)]
)
def test_a_yaw_in_a_body_frame_is_relative_to_the_heading(frame: int, turns: bool) -> None:
    station = Station()
    station.fly(20)
    assert station.command(mavlink.MAV_CMD_CONDITION_YAW, 90, 0, 1, 0) == 0
    station.wait(5)
    station.send(setpoint((0, 0, -20 if frame == LOCAL else 0), yaw=math.radians(30), frame=frame))
    station.wait(6)
    yaw_deg = math.degrees(station.ask(mavlink.MAVLINK_MSG_ID_ATTITUDE).yaw)
    assert yaw_deg == pytest.approx(120 if turns else 30, abs=2)


def test_px4_counts_a_yaw_in_a_body_frame_from_north() -> None:
    station = QuietPx4Station()
    station.hold(setpoint(velocity=(0, 0, -1), yaw=1.0), 2)
    assert station.set_mode("Offboard") == 0
    assert station.arm() == 0
    station.hold(setpoint(velocity=(0, 0, -1), yaw=1.0, frame=BODY), 10)
    assert station.height_m > 3
    assert station.ask(mavlink.MAVLINK_MSG_ID_ATTITUDE).yaw == pytest.approx(1.0, abs=0.05)


# -- accepted senders and times ---------------------------------------------------------------------------


def test_with_sysid_enforce_only_messages_of_the_ground_station_count() -> None:
    station = Station(sysid=42)
    assert station.set_mode("GUIDED") == 0
    station.set_parameter("SYSID_ENFORCE", 1)
    request = mavlink.MAVLink_param_request_read_message(1, 1, b"RTL_ALT", -1)
    arm = command_long((1, 0), mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    count = mavlink.MAVLink_mission_count_message(1, 0, 1, 0)
    for message in (request, arm, count):
        assert station.send(message) == []
    assert not station.armed
    station.codec = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    assert station.arm() == 0


def test_late_acknowledgements_are_sent_at_their_time() -> None:
    station = Station()
    station.inject("slow_ack:delay_s=10,for=1")
    station.wait(0.2)
    station.send(command_long((1, 0), mavlink.MAV_CMD_GET_HOME_POSITION))
    station.wait(1.5)
    station.inject("slow_ack:delay_s=1")
    station.wait(0.1)
    version = mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES
    station.send(command_long((1, 0), version))
    took_s = station.until(lambda: version in [m.command for m in station.of("COMMAND_ACK")], 20)
    assert took_s == pytest.approx(1.0, abs=0.2)
    station.until(lambda: mavlink.MAV_CMD_GET_HOME_POSITION in [m.command for m in station.of("COMMAND_ACK")])
    assert station.now == pytest.approx(10.2, abs=0.3)


def test_the_greatest_time_stamp_does_not_stop_the_telemetry() -> None:
    station = Station()
    station.send(mavlink.MAVLink_setup_signing_message(1, 1, list(range(32)), 2**64 - 1))
    frames = [frame for _, frame in station.fleet.step(3.0)]
    assert frames
    assert all(frame[2] == 1 and frame[-12:-6] == b"\xff" * 6 for frame in frames)


# -- one vehicle, one state ----------------------------------------------------------------------------------


def test_a_copter_with_an_empty_battery_falls_out_of_the_sky() -> None:
    station = Station()
    station.fly(50)
    station.set_parameter("BATT_CAPACITY", 60)
    station.until(lambda: bool(station.fleet.truth().crashed[0]), 60)
    station.wait(1)
    assert not station.armed
    assert "Crash: Disarming" in station.texts()


@pytest.mark.parametrize(
    ("personality", "name"), [("ardupilot", "AIRSPEED_STALL"), ("px4", "FW_AIRSPD_STALL")]
)
def test_the_stall_speed_follows_its_parameter(personality: str, name: str) -> None:
    made = [station_of("plane", {name: stall_m_s}, personality=personality) for stall_m_s in (6.0, 9.5)]
    assert [station.fleet.world.dynamics.stall_m_s[0] for station in made] == [6.0, 9.5]


@pytest.mark.parametrize("slew_cdeg_s", [1000.0, 6000.0])
def test_atc_slew_yaw_is_the_turn_rate(slew_cdeg_s: float) -> None:
    station = station_of(params={"ATC_SLEW_YAW": slew_cdeg_s})
    station.fly(20)
    before_deg = math.degrees(station.ask(mavlink.MAVLINK_MSG_ID_ATTITUDE).yaw)
    assert station.command(mavlink.MAV_CMD_CONDITION_YAW, 170, 0, 1, 1) == 0
    station.wait(2.0)
    turned_deg = math.degrees(station.ask(mavlink.MAVLINK_MSG_ID_ATTITUDE).yaw) - before_deg
    assert turned_deg == pytest.approx(2.0 * slew_cdeg_s / 100, rel=0.15)
