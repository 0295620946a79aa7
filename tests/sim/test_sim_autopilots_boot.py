"""From boot to ready, as observed: text on the link, times of readiness, and heartbeats."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import Station

EKF_POSITION = 16
GUIDED, STABILIZE = 4, 0


def position_estimated(station: Station) -> bool:
    return bool(station.ask(mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT).flags & EKF_POSITION)


@pytest.mark.autopilots("1.2")
def test_each_boot_sends_nine_texts_that_break_a_strict_parser() -> None:
    station = Station()
    before = station.fleet.boots()
    assert station.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1) == 0
    pieces: list[bytes] = []
    while len(pieces) < 9 and station.now < 10:
        station.now += 0.1
        pieces += [frame for _, frame in station.fleet.step(station.now) if frame[0] != 0xFD]
    assert station.fleet.boots() != before
    station.now += 5
    assert [frame for _, frame in station.fleet.step(station.now) if frame[0] != 0xFD] == []
    assert len(pieces) == 9
    assert pieces[0].startswith(b"\n\nInit ArduCopter V4.6.2")
    assert all(piece.isascii() for piece in pieces)
    strict = mavlink.MAVLink(None)
    with pytest.raises(mavlink.MAVError):
        strict.parse_buffer(b"".join(pieces))


@pytest.mark.autopilots("1.3")
def test_gps_home_and_position_come_after_10_20_and_41_seconds() -> None:
    station = Station(ready_s=41.0)
    station.wait(2.5)  # from then on a mode stays
    assert station.set_mode("GUIDED") == 0
    station.until(lambda: station.ask(mavlink.MAVLINK_MSG_ID_GPS_RAW_INT).fix_type >= 3, 60)
    assert station.now == pytest.approx(10, abs=1)
    assert "EKF3 IMU0 origin set" not in station.texts()
    station.until(lambda: station.of("HOME_POSITION") != [], 60)
    assert station.now == pytest.approx(20, abs=1)
    station.until(lambda: position_estimated(station), 60)
    assert station.now == pytest.approx(41, abs=1)
    assert "EKF3 IMU0 origin set" in station.texts()
    assert station.prearm_ok


@pytest.mark.autopilots("1.3")
def test_the_prearm_bit_asks_for_a_position_in_guided_and_in_auto_but_not_in_stabilize() -> None:
    station = Station(ready_s=41.0)
    station.wait(21)
    ready = {}
    for mode in ("STABILIZE", "GUIDED", "AUTO"):
        assert station.set_mode(mode) == 0
        ready[mode] = station.prearm_ok
    assert ready == {"STABILIZE": True, "GUIDED": False, "AUTO": False}
    assert not position_estimated(station)
    station.wait(21)
    for mode in ("STABILIZE", "GUIDED", "AUTO"):
        assert station.set_mode(mode) == 0
        assert station.prearm_ok


@pytest.mark.autopilots("1.5")
def test_the_heartbeat_shows_a_new_mode_up_to_a_second_after_the_acknowledgement() -> None:
    station = Station()
    station.wait(3)
    lags_s = []
    for tenths in range(10):
        station.wait(1.05 + tenths / 10)
        mode = STABILIZE if station.mode == "GUIDED" else GUIDED
        set_mode = mavlink.MAVLink_command_long_message(1, 0, 176, 0, 1, mode, 0, 0, 0, 0, 0)
        assert [m.get_type() for m in station.send(set_mode)] == ["COMMAND_ACK"]
        acknowledged_s, n_before = station.now, len(station.of("HEARTBEAT"))
        station.until(lambda n_before=n_before: len(station.of("HEARTBEAT")) > n_before, 2)
        assert station.of("HEARTBEAT")[-1].custom_mode == mode
        lags_s.append(station.now - acknowledged_s)
    assert min(lags_s) < 0.3
    assert 0.8 < max(lags_s) < 1.0 + 1e-6


@pytest.mark.autopilots("1.13")
def test_a_latched_failsafe_keeps_status_5_after_landing_and_disarming() -> None:
    station = Station()
    for name, value in (("BATT_FS_LOW_ACT", 1), ("BATT_LOW_VOLT", 11)):
        station.set_parameter(name, value)
    station.fly(8)
    station.set_parameter("SIM_BATT_VOLTAGE", 10.5)
    station.until(lambda: station.mode == "LAND", 20)
    station.until(lambda: not station.armed, 60)
    station.wait(30)
    assert station.height_m == 0
    assert station.heartbeat().system_status == mavlink.MAV_STATE_CRITICAL == 5
