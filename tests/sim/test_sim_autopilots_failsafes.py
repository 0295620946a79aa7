"""ArduCopter's reactions to failures in flight and their delays, injected by parameters."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import Station, station_of, takeoff, waypoint


def wait_beating(station: Station, seconds: float, sysid: int) -> None:
    station.codec.srcSystem = sysid
    for _ in range(round(seconds)):
        station.beat()
        station.wait(1)


@pytest.mark.autopilots("1.20")
def test_a_gps_loss_in_auto_lands_the_copter_after_8_seconds() -> None:
    station = Station()
    station.fly_mission([takeoff(), waypoint(300, 0), waypoint(300, 300)])
    station.until(lambda: station.height_m > 19, 30)
    station.set_parameter("SIM_GPS_DISABLE", 1)
    assert station.until(lambda: station.mode == "LAND", 20) == pytest.approx(8, abs=1)
    assert "EKF Failsafe" in station.texts()
    station.until(lambda: not station.armed, 60)


@pytest.mark.autopilots("1.20")
def test_a_low_battery_returns_after_10_seconds() -> None:
    station = station_of(params={"BATT_LOW_VOLT": 11, "BATT_FS_LOW_ACT": 2})
    station.fly_mission([takeoff(), waypoint(500, 0)])
    station.until(lambda: station.height_m > 19, 30)
    station.set_parameter("SIM_BATT_VOLTAGE", 10.5)
    assert station.until(lambda: station.mode == "RTL", 20) == pytest.approx(10, abs=1)


@pytest.mark.autopilots("1.15")
def test_the_ground_station_failsafe_is_off_by_default() -> None:
    station = Station()
    station.beat()
    station.fly(10)
    station.wait(60)
    assert station.mode == "GUIDED"


@pytest.mark.autopilots("1.15")
def test_only_sysid_mygcs_keeps_the_ground_station_failsafe_quiet() -> None:
    station = station_of(params={"FS_GCS_ENABLE": 1})
    station.beat()
    station.set_mode("GUIDED")
    station.arm()
    station.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 20)
    wait_beating(station, 10, sysid=254)
    assert station.mode == "RTL"
    assert station.heartbeat().system_status == mavlink.MAV_STATE_CRITICAL
    wait_beating(station, 3, sysid=255)
    assert station.heartbeat().system_status != mavlink.MAV_STATE_CRITICAL
