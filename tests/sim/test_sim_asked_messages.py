"""Messages that ground stations ask an ArduPilot for: requests, stream groups, values."""

import math
from typing import Any

import ardupilot_messages as firmware
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import ALT_M, LAT_DEG, Station, airborne_plane, land, station_of, takeoff, waypoint

from sim_vehicle.station.messages import command_long

STRIKES = {mavlink.MAVLINK_MSG_ID_NAMED_VALUE_INT}  # added by the simulator, for a scenario with hostiles
UNGROUPED = {"HEARTBEAT", "TIMESYNC", "STATUSTEXT", "HOME_POSITION", "GPS_GLOBAL_ORIGIN"}


def in_the_air(kind: str, **extra: Any) -> Station:
    if kind == "plane":
        return airborne_plane(up_m=30, **extra)
    station = station_of(kind, **extra)
    station.fly(20)
    return station


def answers(station: Station) -> tuple[set[int], set[int]]:
    """Request every message of the dialect; return the ids of the accepted requests, and of the answers."""
    accepted, sent = set(), set()
    for message_id in mavlink.mavlink_map:
        replies = station.send(command_long((1, 0), mavlink.MAV_CMD_REQUEST_MESSAGE, message_id))
        accepted |= {message_id for m in replies if m.get_type() == "COMMAND_ACK" and m.result == 0}
        sent |= {message_id for m in replies if m.get_msgId() == message_id}
    return accepted, sent - {mavlink.MAVLINK_MSG_ID_COMMAND_ACK}


@pytest.mark.parametrize("kind", ["copter", "plane"])
def test_requests_on_the_ground_are_answered_as_by_the_firmware(kind: str) -> None:
    station = station_of(kind)
    station.wait(3)
    accepted, sent = answers(station)
    own = firmware.PLANE_ONLY if kind == "plane" else firmware.COPTER_ONLY | firmware.NOT_IN_MANUAL
    assert accepted == firmware.KNOWN | STRIKES
    assert sent == firmware.ALWAYS | own


@pytest.mark.parametrize("kind", ["copter", "plane"])
def test_requests_in_the_air_are_answered_as_by_the_firmware(kind: str) -> None:
    accepted, sent = answers(in_the_air(kind))
    own = firmware.PLANE_ONLY if kind == "plane" else firmware.COPTER_ONLY
    assert accepted == firmware.KNOWN | STRIKES
    assert sent - firmware.TARGETS == firmware.ALWAYS | own | firmware.NOT_IN_MANUAL
    assert sent & firmware.TARGETS


@pytest.mark.parametrize("kind", ["copter", "plane"])
def test_each_group_of_streams_has_the_messages_of_the_firmware(kind: str) -> None:
    station = in_the_air(kind)
    groups = firmware.PLANE_GROUPS if kind == "plane" else firmware.GROUPS
    station.send(mavlink.MAVLink_request_data_stream_message(1, 0, mavlink.MAV_DATA_STREAM_ALL, 1, 0))
    for group, message_ids in groups.items():
        station.send(mavlink.MAVLink_request_data_stream_message(1, 0, group, 4, 1))
        seen = {m.get_msgId() for m in station.wait(1) if m.get_type() not in UNGROUPED}
        assert seen - firmware.TARGETS == message_ids - firmware.TARGETS
        station.send(mavlink.MAVLink_request_data_stream_message(1, 0, group, 4, 0))


def test_an_arduplane_streams_every_group_each_second_without_a_request() -> None:
    station = in_the_air("plane")
    seen = [m.get_msgId() for m in station.wait(5) if m.get_type() not in UNGROUPED]
    in_groups = frozenset().union(*firmware.PLANE_GROUPS.values())
    assert {message_id: seen.count(message_id) for message_id in in_groups} == dict.fromkeys(in_groups, 5)


def test_the_interval_of_a_message_is_reported_and_an_unknown_message_is_refused() -> None:
    station = station_of("plane")
    asked = mavlink.MAV_CMD_GET_MESSAGE_INTERVAL
    for message_id, result, interval_us in ((33, 0, 1_000_000), (46, 0, -1), (111, 4, 0), (4, 4, 0)):
        assert station.command(asked, message_id) == result
        assert station.of("MESSAGE_INTERVAL")[-1].interval_us == interval_us
    assert station.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 111, 1e6) == mavlink.MAV_RESULT_DENIED
    assert station.command(mavlink.MAV_CMD_REQUEST_MESSAGE, 111) == mavlink.MAV_RESULT_FAILED


# -- values --------------------------------------------------------------------------------------------------


def test_a_flight_of_a_copter_is_reported_from_truth_estimate_and_target() -> None:
    station = station_of("copter", wind={"speed_m_s": 5.0, "from_deg": 270.0})
    station.fly_mission([takeoff(), waypoint(150, 0), land(150, 0)])
    station.until(lambda: station.speed_m_s > 8, 60)
    truth = station.fleet.truth()
    attitude, hud = station.ask(mavlink.MAVLINK_MSG_ID_ATTITUDE), station.ask(mavlink.MAVLINK_MSG_ID_VFR_HUD)
    for message_id in (mavlink.MAVLINK_MSG_ID_SIMSTATE, mavlink.MAVLINK_MSG_ID_SIM_STATE):
        state = station.ask(message_id)
        assert (state.roll, state.pitch, state.yaw) == pytest.approx(
            (attitude.roll, attitude.pitch, attitude.yaw), abs=1e-6
        )
        lat, lon = (state.lat, state.lng) if hasattr(state, "lng") else (state.lat_int, state.lon_int)
        assert (lat, lon) == pytest.approx((truth.lat_deg[0] * 1e7, truth.lon_deg[0] * 1e7), abs=2)
    assert math.hypot(state.vn, state.ve) == pytest.approx(truth.speed_m_s[0], abs=0.01)
    assert state.alt == pytest.approx(truth.alt_amsl_m[0], abs=0.01)
    second = station.ask(mavlink.MAVLINK_MSG_ID_AHRS2)
    assert second.altitude == pytest.approx(hud.alt, abs=0.01)
    assert (second.lat, second.lng) == pytest.approx((lat, lon), abs=2)
    terrain = station.ask(mavlink.MAVLINK_MSG_ID_TERRAIN_REPORT)
    assert (terrain.terrain_height, terrain.pending) == (ALT_M, 0)
    assert terrain.current_height == pytest.approx(truth.height_m[0], abs=0.01)
    motors = station.ask(mavlink.MAVLINK_MSG_ID_ESC_TELEMETRY_1_TO_4)
    battery = station.ask(mavlink.MAVLINK_MSG_ID_BATTERY_STATUS)
    assert sum(motors.current) == pytest.approx(battery.current_battery, abs=4)
    assert motors.voltage == pytest.approx([battery.voltages[0] / 10] * 4, abs=1)
    summary = station.ask(mavlink.MAVLINK_MSG_ID_HIGH_LATENCY2)
    assert (summary.latitude, summary.longitude) == pytest.approx((lat, lon), abs=2)
    assert summary.groundspeed == pytest.approx(hud.groundspeed * 5, abs=1)
    assert (summary.windspeed, summary.wind_heading) == (25, 135)
    assert summary.target_distance * 10 == pytest.approx(150 - (lat * 1e-7 - LAT_DEG) * 111_160, abs=11)
    assert (summary.target_altitude, summary.custom_mode) == (ALT_M + 20, 3)


def test_the_attitude_target_leads_the_attitude() -> None:
    station = in_the_air("copter")
    assert station.ask(mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET).q == pytest.approx([1, 0, 0, 0], abs=1e-3)
    assert station.reposition(1000, 20) == 0
    station.wait(0.1)
    target = station.ask(mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET)
    pitch_rad = math.asin(2 * (target.q[0] * target.q[2] - target.q[3] * target.q[1]))
    assert pitch_rad < station.ask(mavlink.MAVLINK_MSG_ID_ATTITUDE).pitch < 0
    assert target.thrust == pytest.approx(
        station.ask(mavlink.MAVLINK_MSG_ID_VFR_HUD).throttle / 100, abs=0.01
    )


def test_the_item_reached_last_is_kept_until_a_reboot() -> None:
    station = station_of("copter")
    reached = mavlink.MAVLINK_MSG_ID_MISSION_ITEM_REACHED
    assert station.ask(reached).seq == 65_535
    station.fly_mission([takeoff(), waypoint(20, 0), land(20, 0)])
    station.until(lambda: bool(station.of("MISSION_ITEM_REACHED")), 120)
    announced = station.of("MISSION_ITEM_REACHED")[-1].seq
    assert station.ask(reached).seq == announced >= 1
    station.until(lambda: not station.armed, 120)
    assert station.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1) == 0
    station.wait(5)
    assert station.ask(reached).seq == 65_535


def test_the_airflow_of_a_plane_follows_the_wind() -> None:
    station = in_the_air("plane", wind={"speed_m_s": 8.0, "from_deg": 0.0})
    air, hud = station.ask(mavlink.MAVLINK_MSG_ID_AIRSPEED), station.ask(mavlink.MAVLINK_MSG_ID_VFR_HUD)
    assert air.airspeed == pytest.approx(hud.airspeed)
    assert air.raw_press == pytest.approx(hud.airspeed**2 / 1.9936, rel=1e-5)
    angles = station.ask(mavlink.MAVLINK_MSG_ID_AOA_SSA)
    assert 1 < angles.AOA < 15
    assert abs(angles.SSA) < 2  # from the track it would be more than 20
