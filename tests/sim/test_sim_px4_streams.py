"""Messages that only PX4 streams, the sources of its home and origin, and the count of its flights."""

import math

import pytest
from px4_station import ACCEPTED, Px4Station
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import ALT_M, LAT_DEG, LON_DEG, Station

FLIGHT_INFORMATION = mavlink.MAVLINK_MSG_ID_FLIGHT_INFORMATION
ORIGIN = mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN


def test_flight_information_has_the_count_and_the_start_of_flights() -> None:
    station = Px4Station()
    station.wait(5)
    before = station.ask(FLIGHT_INFORMATION)
    assert (before.arming_time_utc, before.takeoff_time_utc) == (0, 0)
    station.fly(10)
    flying = station.ask(FLIGHT_INFORMATION)
    assert flying.arming_time_utc == pytest.approx(5e6, abs=2e5)
    assert flying.arming_time_utc < flying.takeoff_time_utc < flying.time_boot_ms * 1000
    assert flying.flight_uuid == before.flight_uuid
    assert station.command(mavlink.MAV_CMD_NAV_LAND) == ACCEPTED
    station.until(lambda: not station.armed, 60)
    after = station.ask(FLIGHT_INFORMATION)
    assert (after.arming_time_utc, after.takeoff_time_utc) == (0, 0)
    assert after.flight_uuid == before.flight_uuid + 1


def test_ground_truth_and_odometry_agree_with_the_true_position() -> None:
    station = Px4Station()
    station.fly(15)
    station.wait(10)
    truth = station.fleet.truth()
    hil = station.ask(mavlink.MAVLINK_MSG_ID_HIL_STATE_QUATERNION)
    assert hil.lat * 1e-7 == pytest.approx(float(truth.lat_deg[0]), abs=2e-7)
    assert hil.lon * 1e-7 == pytest.approx(float(truth.lon_deg[0]), abs=2e-7)
    assert hil.alt / 1000 == pytest.approx(ALT_M + 15, abs=1)
    local = station.ask(mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED)
    odometry = station.ask(mavlink.MAVLINK_MSG_ID_ODOMETRY)
    assert (odometry.x, odometry.y, odometry.z) == (local.x, local.y, local.z)
    assert odometry.frame_id == odometry.child_frame_id == mavlink.MAV_FRAME_LOCAL_NED
    assert math.hypot(*odometry.q) == pytest.approx(1, abs=1e-5)
    assert odometry.pose_covariance[0] > 0
    assert math.isnan(odometry.pose_covariance[1])
    outputs = station.ask(mavlink.MAVLINK_MSG_ID_ACTUATOR_OUTPUT_STATUS)
    assert outputs.active == 4
    assert all(1100 < pulse < 1900 for pulse in outputs.actuator[:4])


def set_origin(station: Station, north_deg: float = 0.001) -> list[int]:
    """Return the latitudes of the reported origins."""
    message = mavlink.MAVLink_set_gps_global_origin_message(
        1, round((LAT_DEG + north_deg) * 1e7), round(LON_DEG * 1e7), 290_000
    )
    return [m.latitude for m in station.send(message) if m.get_msgId() == ORIGIN]


def test_the_origin_moves_and_local_coordinates_with_it() -> None:
    station = Px4Station()
    station.wait(2)
    assert set_origin(station) == [round((LAT_DEG + 0.001) * 1e7)]
    local = station.ask(mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED)
    assert local.x == pytest.approx(-111.2, abs=1)
    assert local.z == pytest.approx(-10, abs=1)
    assert set_origin(station, 90.0) == [round((LAT_DEG + 0.001) * 1e7)]  # off the earth: reported, not used
    home = station.ask(mavlink.MAVLINK_MSG_ID_HOME_POSITION)
    assert home.latitude == pytest.approx(LAT_DEG * 1e7, abs=30)
    assert (home.x, home.z) == pytest.approx((-111.2, -10), abs=1)


def test_ardupilot_accepts_only_the_first_origin() -> None:
    station = Station(ready_s=41.0)
    station.wait(5)
    assert set_origin(station) == [round((LAT_DEG + 0.001) * 1e7)]
    assert set_origin(station, 0.002) == []
    station.wait(30)
    home = station.ask(mavlink.MAVLINK_MSG_ID_HOME_POSITION)
    assert home.latitude == pytest.approx(LAT_DEG * 1e7, abs=30)
