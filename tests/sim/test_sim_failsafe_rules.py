"""ArduPilot's failsafes by mode and by parameter, and its arming checks."""

import pytest
from profiles import full_only
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import Station, airborne_plane, home_item, land, landing_mission, station_of, takeoff, waypoint

FAILED = int(mavlink.MAV_RESULT_FAILED)
FORCE = 21196


def start_station(kind: str = "copter", *, ready_s: float = 0.0, **params: float) -> Station:
    return station_of(kind, params, ready_s=ready_s)


def plane(mode: str, **params: float) -> Station:
    """Return a station with the vehicle in the air, in that mode."""
    station = airborne_plane(params)
    if mode == "AUTO":
        station.upload([home_item(), waypoint(5000, 0, 60)])
    assert station.set_mode(mode) == 0
    return station


# -- the battery ---------------------------------------------------------------------------------------------


def test_a_low_battery_before_arming_leaves_the_failsafe_ready() -> None:
    station = start_station(BATT_LOW_VOLT=11.5, BATT_FS_LOW_ACT=2, BATT_LOW_TIMER=2, SIM_BATT_VOLTAGE=11.0)
    station.wait(15)
    assert not any("is low" in text for text in station.texts())
    assert station.heartbeat().system_status == mavlink.MAV_STATE_STANDBY
    station.set_parameter("SIM_BATT_VOLTAGE", 12.6)
    station.wait(1)
    station.fly(20)
    station.set_parameter("SIM_BATT_VOLTAGE", 10.5)
    assert station.until(lambda: station.mode == "RTL", 10) >= 2


def test_the_worse_of_two_battery_limits_counts() -> None:
    station = start_station(BATT_LOW_VOLT=11.5, BATT_FS_LOW_ACT=2, BATT_CRT_VOLT=11.0, BATT_FS_CRT_ACT=1)
    station.fly(20)
    station.set_parameter("SIM_BATT_VOLTAGE", 10.5)
    station.until(lambda: station.mode != "GUIDED", 15)
    assert station.mode == "LAND"
    assert not any("is low" in text for text in station.texts())


@pytest.mark.parametrize(
    ("action", "lands", "mode"),
    [
        (2, True, "AUTO"),
        (2, False, "RTL"),
        # actions of quadplanes
        (4, True, "AUTO"),
        (5, True, "GUIDED"),
        (6, True, "AUTO"),
        (7, True, "RTL"),
    ],
)
def test_a_low_battery_of_a_plane_starts_its_mission_landing_or_a_return(
    action: int, *, lands: bool, mode: str
) -> None:
    station = start_station("plane", BATT_LOW_VOLT=11.5, BATT_FS_LOW_ACT=action, BATT_LOW_TIMER=1)
    station.upload(landing_mission()[: None if lands else 3])
    station.set_mode("TAKEOFF")
    assert station.arm() == 0
    station.until(lambda: station.height_m > 45, 60)
    station.set_mode("GUIDED")
    station.set_parameter("SIM_BATT_VOLTAGE", 11.0)
    station.until(lambda: any("is low" in text for text in station.texts()), 10)
    station.wait(1)
    assert station.mode == mode


@pytest.mark.parametrize(("kind", "is_watched"), [("copter", True), ("plane", False)])
def test_the_voltage_is_watched_by_default_on_a_copter_only(*, kind: str, is_watched: bool) -> None:
    station = start_station(kind, BATT_LOW_TIMER=1)
    assert station.set_mode({"copter": "GUIDED", "plane": "TAKEOFF"}[kind]) == 0
    assert station.arm() == 0
    if kind == "copter":
        assert station.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 20) == 0
    station.until(lambda: station.height_m > 15, 60)
    station.set_parameter("SIM_BATT_VOLTAGE", 10.0)
    station.wait(5)
    assert any("is low" in text for text in station.texts()) == is_watched


def test_failsafes_do_not_interrupt_a_mission_landing() -> None:
    station = start_station("plane", BATT_LOW_VOLT=11.5, BATT_FS_LOW_ACT=1, BATT_LOW_TIMER=1, FS_LONG_ACTN=1)
    station.fly_plane_mission([home_item(), takeoff(50), waypoint(0, 600, 40), land(0, 0)])
    station.until(lambda: station.current == 3, 200)
    station.wait(1)
    station.set_parameter("SIM_BATT_VOLTAGE", 11.0)
    station.inject("rc_loss")
    station.wait(8)
    assert any("is low" in text for text in station.texts())
    assert station.mode == "AUTO"
    station.until(lambda: station.height_m < 0.1, 100)


# -- the position --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("action", "begun_in", "ends_in"),
    [
        (0, "GUIDED", "GUIDED"),
        *full_only((1, "GUIDED", "LAND"), (2, "GUIDED", "ALT_HOLD")),
        (2, "RTL", "ALT_HOLD"),
        *full_only((3, "GUIDED", "LAND"), (1, "ALT_HOLD", "ALT_HOLD")),
        (2, "STABILIZE", "STABILIZE"),
        (3, "ALT_HOLD", "LAND"),
    ],
)
def test_the_action_of_a_lost_position_follows_parameter_and_mode(
    action: int, begun_in: str, ends_in: str
) -> None:
    station = start_station(FS_EKF_ACTION=action)
    station.fly(80)
    station.inject("gps_loss")
    station.wait(7)
    assert station.set_mode(begun_in) == 0
    station.wait(2)
    assert station.mode == ends_in
    assert "EKF Failsafe" in station.texts()


def test_a_lost_position_without_a_remote_control_lands() -> None:
    station = start_station(FS_EKF_ACTION=2, FS_OPTIONS=4)
    station.fly(40)
    station.inject("rc_loss")
    station.until(lambda: "Radio Failsafe - Continuing Guided Mode" in station.texts(), 3)
    station.inject("gps_loss")
    station.until(lambda: station.mode == "LAND", 12)


def test_without_a_threshold_the_position_is_not_watched() -> None:
    station = start_station(FS_EKF_THRESH=0)
    station.fly(40)
    station.inject("gps_loss")
    station.wait(20)
    gps = station.ask(mavlink.MAVLINK_MSG_ID_GPS_RAW_INT)
    assert (gps.fix_type, gps.satellites_visible) == (mavlink.GPS_FIX_TYPE_NO_FIX, 0)
    assert station.mode == "GUIDED"
    assert "EKF Failsafe" not in station.texts()


def test_a_return_without_remote_control_lands_despite_its_final_height() -> None:
    station = start_station(RTL_ALT_FINAL=500, RTL_LOIT_TIME=1000)
    station.fly(20)
    station.inject("rc_loss")
    station.until(lambda: station.mode == "RTL", 5)
    station.until(lambda: not station.armed, 120)


# -- links ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("parameter", "value", "mode"),
    [
        *full_only(("FS_GCS_ENABLE", 4, "LAND")),
        ("FS_GCS_ENABLE", 5, "LAND"),
        *full_only(("FS_GCS_ENABLE", 7, "BRAKE"), ("FS_THR_ENABLE", 3, "LAND"), ("FS_THR_ENABLE", 4, "RTL")),
        ("FS_THR_ENABLE", 5, "LAND"),
        ("FS_THR_ENABLE", 7, "BRAKE"),
        ("BATT_FS_LOW_ACT", 4, "LAND"),
        *full_only(("BATT_FS_LOW_ACT", 7, "BRAKE")),
    ],
)
def test_the_action_of_a_failsafe_follows_its_parameter(parameter: str, value: float, mode: str) -> None:
    station = start_station("copter", **{parameter: value, "BATT_LOW_VOLT": 11.5, "BATT_LOW_TIMER": 1})
    station.fly(20)
    if parameter == "FS_GCS_ENABLE":
        station.beat()
    elif parameter == "FS_THR_ENABLE":
        station.inject("rc_loss")
    else:
        station.set_parameter("SIM_BATT_VOLTAGE", 11.0)
    station.until(lambda: station.mode == mode, 10)


def test_a_brake_or_land_without_a_position_lands() -> None:
    station = start_station(FS_THR_ENABLE=7)
    station.fly(80)
    station.inject("gps_loss")
    station.set_mode("ALT_HOLD")
    station.until(lambda: not station.fleet.vehicles[0].position_known(station.now), 10)
    station.inject("rc_loss")
    station.until(lambda: station.mode == "LAND", 5)


@pytest.mark.parametrize(
    ("options", "mode", "ends_in", "text"),
    [
        (16, "ALT_HOLD", "ALT_HOLD", "GCS Failsafe - Continuing Pilot Control"),
        (16, "LOITER", "LOITER", "GCS Failsafe - Continuing Pilot Control"),
        (16, "GUIDED", "RTL", "GCS Failsafe"),
        (0, "ALT_HOLD", "RTL", "GCS Failsafe"),
        (2, "AUTO", "AUTO", "GCS Failsafe - Continuing Auto Mode"),
        (16, "AUTO", "RTL", "GCS Failsafe"),
    ],
)
def test_fs_options_lets_a_copter_continue_without_a_ground_station(
    options: int, mode: str, ends_in: str, text: str
) -> None:
    station = start_station(FS_GCS_ENABLE=1, FS_OPTIONS=options)
    station.fly_mission([takeoff(60), waypoint(2000, 0, 60)])
    station.until(lambda: station.height_m > 59, 60)
    station.beat()
    assert station.set_mode(mode) == 0
    station.wait(6)
    assert station.mode == ends_in
    assert text in station.texts()


@pytest.mark.parametrize(("watched", "mode"), [(0, "GUIDED"), (1, "RTL")])
def test_a_watched_remote_control_is_lost_after_a_second(watched: int, mode: str) -> None:
    station = start_station(FS_THR_ENABLE=watched)
    station.fly(20)
    station.inject("rc_loss")
    station.wait(0.9)
    assert station.mode == "GUIDED"
    station.wait(0.4)
    assert station.mode == mode
    assert station.fleet.vehicles[0].failsafes.rc_lost == bool(watched)


@pytest.mark.parametrize(
    ("long_action", "mode", "at_short", "at_long"),
    [
        *full_only((0, "MANUAL", "CIRCLE", "RTL")),
        (0, "FBWA", "CIRCLE", "RTL"),
        *full_only((0, "CIRCLE", "CIRCLE", "RTL")),
        (0, "LOITER", "LOITER", "RTL"),
        (0, "GUIDED", "GUIDED", "GUIDED"),
        *full_only((0, "AUTO", "AUTO", "AUTO"), (1, "GUIDED", "GUIDED", "RTL")),
        (1, "AUTO", "AUTO", "RTL"),
        (2, "MANUAL", "CIRCLE", "FBWA"),
        *full_only((2, "GUIDED", "GUIDED", "FBWA"), (5, "GUIDED", "GUIDED", "RTL")),
    ],
)
def test_a_plane_without_a_remote_control_acts_in_two_stages(
    long_action: int, mode: str, at_short: str, at_long: str
) -> None:
    station = plane(mode, FS_LONG_ACTN=long_action)
    station.inject("rc_loss")
    station.wait(1.3)
    assert station.mode == at_short
    station.wait(4.5)
    assert station.mode == at_short
    station.wait(0.5)
    assert station.mode == at_long
    assert f"RC Long Failsafe On: {at_long}" in station.texts()


@pytest.mark.parametrize(
    ("short_action", "mode", "at_short"),
    [(1, "GUIDED", "CIRCLE"), (2, "MANUAL", "FBWA"), (3, "MANUAL", "MANUAL"), (4, "MANUAL", "FBWB")],
)
def test_the_short_failsafe_of_a_plane_follows_its_parameter(
    short_action: int, mode: str, at_short: str
) -> None:
    station = plane(mode, FS_SHORT_ACTN=short_action)
    station.inject("rc_loss")
    station.wait(2)
    assert station.mode == at_short


def test_without_a_short_failsafe_the_long_one_counts_from_the_last_frame() -> None:
    station = plane("MANUAL", FS_SHORT_ACTN=3, FS_LONG_TIMEOUT=3)
    station.inject("rc_loss")
    assert station.until(lambda: station.mode == "RTL", 10) == pytest.approx(3, abs=0.2)


def test_a_plane_resumes_its_mode_when_the_remote_control_returns_in_time() -> None:
    station = plane("FBWB")
    station.inject("rc_loss:for=3")
    station.until(lambda: station.mode == "CIRCLE", 3)
    station.until(lambda: station.mode == "FBWB", 5)
    assert station.texts()[-2:] == ["RC Short Failsafe: switched to CIRCLE", "Short Failsafe Cleared"]


@pytest.mark.parametrize(("mode", "ends_in"), [("MANUAL", "RTL"), ("GUIDED", "GUIDED")])
def test_a_plane_without_a_ground_station_returns_from_pilot_modes(mode: str, ends_in: str) -> None:
    station = plane(mode, FS_GCS_ENABL=1)
    station.beat()
    station.wait(6)
    assert station.mode == ends_in
    assert f"GCS Failsafe On: {ends_in}" in station.texts()


def test_a_plane_without_a_throttle_failsafe_ignores_a_lost_remote_control() -> None:
    station = plane("MANUAL", THR_FAILSAFE=0)
    station.inject("rc_loss")
    station.wait(8)
    assert station.mode == "MANUAL"


# -- arming --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["copter", "plane"])
def test_a_lost_remote_control_refuses_arming(kind: str) -> None:
    station = start_station(kind)
    station.inject("rc_loss:for=5")
    station.set_mode("GUIDED")
    station.wait(2)
    assert station.arm() == FAILED
    assert "Arm: Radio failsafe on" in station.texts()
    station.wait(5)
    assert station.arm() == 0


def test_a_copter_forced_to_arm_without_a_remote_control_stays_armed() -> None:
    station = start_station()
    station.inject("rc_loss")
    station.set_mode("GUIDED")
    station.wait(2)
    assert station.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1, FORCE) == 0
    station.wait(3)
    assert station.armed


@pytest.mark.parametrize(
    ("kind", "mode", "params", "refusal"),
    [
        ("copter", "GUIDED", {}, "Need Position Estimate"),
        ("copter", "STABILIZE", {}, None),
        ("copter", "STABILIZE", {"FENCE_ENABLE": 1}, "Fence enabled, need position estimate"),
        ("plane", "GUIDED", {}, None),
    ],
)
def test_a_needed_position_cannot_be_replaced_by_force(
    kind: str, mode: str, params: dict[str, float], refusal: str | None
) -> None:
    station = start_station(kind, ready_s=41.0, **params)
    station.wait(5)
    assert station.set_mode(mode) == 0
    assert station.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1, FORCE) == (FAILED if refusal else 0)
    assert station.armed is (refusal is None)
    assert refusal is None or f"Arm: {refusal}" in station.texts()
