"""Effects of PX4's parameters, and its GPS in SYS_STATUS."""

import pytest
from px4_station import ACCEPTED, TEMPORARILY_REJECTED, Px4Station
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import takeoff, waypoint

GPS = int(mavlink.MAV_SYS_STATUS_SENSOR_GPS)
MISSION_EXCEPTED, HOLD_EXCEPTED = 1, 2


def flying_its_mission(**params: float) -> Px4Station:
    station = Px4Station(params={"COM_FAIL_ACT_T": 0.0, **params})
    station.fly_mission([takeoff(20), waypoint(300, 0, 20)])
    station.until(lambda: station.height_m > 15, 60)
    return station


@pytest.mark.parametrize(
    ("excepted", "mode", "ends_in"),
    [
        (0, "Mission", "Return"),
        (MISSION_EXCEPTED, "Mission", "Mission"),
        (HOLD_EXCEPTED, "Mission", "Return"),
        (HOLD_EXCEPTED, "Hold", "Hold"),
        (MISSION_EXCEPTED, "Hold", "Return"),
    ],
)
def test_com_rcl_except_has_the_modes_without_a_remote_control(
    excepted: int, mode: str, ends_in: str
) -> None:
    station = flying_its_mission(COM_RCL_EXCEPT=excepted)
    assert station.set_mode(mode) == ACCEPTED
    station.inject("rc_loss")
    station.wait(3.0)
    assert station.mode == ends_in


@pytest.mark.parametrize("after_s", [0.5, 3.0])
def test_com_rc_loss_t_is_the_time_limit_of_the_remote_control(after_s: float) -> None:
    station = flying_its_mission(COM_RC_LOSS_T=after_s)
    station.inject("rc_loss")
    station.wait(after_s - 0.3)
    assert station.mode == "Mission"
    station.wait(1.5)
    assert station.mode == "Return"


@pytest.mark.parametrize(("without_gps", "result"), [(1, ACCEPTED), (0, TEMPORARILY_REJECTED)])
def test_com_arm_wo_gps_allows_arming_without_gps_in_a_pilot_mode(without_gps: int, result: int) -> None:
    """COM_RC_IN_MODE 4 disables stick input, so arming requires no pilot."""
    station = Px4Station(params={"COM_ARM_WO_GPS": without_gps, "COM_RC_IN_MODE": 4})
    station.inject("gps_loss")
    station.wait(3.0)
    assert station.set_mode("Manual") == ACCEPTED
    assert station.arm() == result
    assert any("GPS fix too low" in text for text in station.texts()) is (result != ACCEPTED)


def gps_bits(station: Px4Station) -> tuple[bool, bool]:
    """Return the present and healthy bits of the GPS in the last SYS_STATUS."""
    status = station.of("SYS_STATUS")[-1]
    bits = status.onboard_control_sensors_present, status.onboard_control_sensors_health
    return bool(bits[0] & GPS), bool(bits[1] & GPS)


def test_gps_is_present_in_sys_status_while_the_estimator_uses_gps() -> None:
    station = flying_its_mission()
    assert gps_bits(station) == (True, True)
    station.inject("gps_loss:for=5")
    station.wait(2.0)
    assert gps_bits(station) == (False, False)
    station.wait(6.0)
    assert gps_bits(station) == (True, True)


def test_gps_is_absent_in_sys_status_before_the_first_fix() -> None:
    station = Px4Station(ready_s=40.0)
    station.wait(5.0)
    assert gps_bits(station)[0] is False
