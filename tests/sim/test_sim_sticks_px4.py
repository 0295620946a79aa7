"""Manual control of PX4: joystick modes, the pilot's modes, taking over and the loss; Follow Target.

The numbers are those of PX4 1.15.3 in software-in-the-loop, for the same inputs.
"""

import math

import pytest
from profiles import full_only
from px4_station import ACCEPTED, TEMPORARILY_REJECTED, QuietPx4Station
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import ALT_M, LAT_DEG, LON_DEG, place_m, setpoint

CENTRE = (0, 0, 500, 0)


def control(station: QuietPx4Station, x: int, y: int, z: int, r: int, target: int = 1) -> None:
    station.send(mavlink.MAVLink_manual_control_message(target, x, y, z, r, 0))


def hold(station: QuietPx4Station, seconds: float, *axes: int) -> None:
    for _ in range(round(seconds * 10)):
        control(station, *axes)
        station.wait(0.1)


def flying(mode: str, **params: float) -> QuietPx4Station:
    station = QuietPx4Station(params=params)
    station.fly(20)
    hold(station, 1, *CENTRE)
    assert station.set_mode(mode) == ACCEPTED
    hold(station, 2, *CENTRE)
    assert station.mode == mode
    return station


# -- input -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("params", "target", "accepted"),
    [
        ({}, 1, True),
        ({}, 0, True),
        ({}, 2, False),
        *[({"COM_RC_IN_MODE": m}, 1, m in (1, 2, 3)) for m in range(4)],
    ],
)
def test_com_rc_in_mode_selects_the_joystick(
    params: dict[str, float], target: int, *, accepted: bool
) -> None:
    station = QuietPx4Station(params=params)
    assert station.set_mode("Position") == ACCEPTED
    for _ in range(5):
        control(station, *CENTRE, target=target)
        station.wait(0.1)
    assert (station.arm() == ACCEPTED) is accepted


def test_the_first_joystick_selects_position_before_anybody_has_chosen_a_mode() -> None:
    station = QuietPx4Station()
    hold(station, 0.5, *CENTRE)
    assert station.mode == "Position"
    assert station.set_mode("Hold") == ACCEPTED
    hold(station, 0.5, *CENTRE)
    assert station.mode == "Hold"


@pytest.mark.parametrize(
    ("mode", "throttle", "refusal"),
    [
        ("Manual", 0, None),
        ("Manual", 150, "high throttle"),
        ("Stabilized", 500, "high throttle"),
        ("Altitude", 590, None),
        ("Altitude", 650, "throttle above center"),
        ("Position", 650, "throttle above center"),
    ],
)
def test_the_throttle_can_prevent_arming(mode: str, throttle: int, refusal: str | None) -> None:
    station = QuietPx4Station()
    assert station.set_mode(mode) == ACCEPTED
    hold(station, 0.5, 0, 0, throttle, 0)
    assert station.arm() == (TEMPORARILY_REJECTED if refusal else ACCEPTED)
    assert refusal is None or f"Arming denied: {refusal}" in station.texts()


def test_rc_overrides_show_in_rc_channels_and_are_no_manual_control() -> None:
    station = QuietPx4Station()
    pulses_us = [1600, 1500, 1400, 1500, *[0xFFFF] * 4, *[0] * 10]
    assert station.set_mode("Position") == ACCEPTED
    station.send(mavlink.MAVLink_rc_channels_override_message(1, 1, *pulses_us))
    message = station.ask(mavlink.MAVLINK_MSG_ID_RC_CHANNELS)
    assert (message.chancount, message.chan1_raw, message.chan5_raw) == (4, 1600, 0xFFFF)
    assert station.arm() == TEMPORARILY_REJECTED


# -- flight ----------------------------------------------------------------------------------------------


def test_position_takes_off_flies_brakes_and_holds() -> None:
    station = QuietPx4Station()
    hold(station, 0.5, *CENTRE)
    assert station.arm() == ACCEPTED
    hold(station, 8, 0, 0, 1000, 0)
    assert station.velocity_m_s[2] == pytest.approx(3.0, abs=0.3)
    hold(station, 3, *CENTRE)
    held_m = station.height_m
    hold(station, 1, 1000, 0, 500, 0)
    assert 1.5 < station.velocity_m_s[0] < 5.5
    hold(station, 5, 1000, 0, 500, 0)
    assert station.velocity_m_s[0] == pytest.approx(9.5, abs=1.0)
    hold(station, 6, *CENTRE)
    stopped_m = place_m(station)
    hold(station, 4, *CENTRE)
    assert math.dist(place_m(station), stopped_m) < 0.5
    assert station.height_m == pytest.approx(held_m, abs=0.5)
    hold(station, 1, 0, 0, 500, 1000)
    yaw_rate = math.degrees(station.ask(mavlink.MAVLINK_MSG_ID_ATTITUDE).yawspeed)
    assert yaw_rate == pytest.approx(150, abs=3)


@pytest.mark.parametrize(
    ("throttle", "climb_m_s"), [(250, -0.35), *full_only((0, -1.5), (540, 0.0), (1000, 3.0))]
)
def test_altitude_leans_and_climbs(throttle: int, climb_m_s: float) -> None:
    station = flying("Altitude")
    hold(station, 2.5, 1000, 0, throttle, 0)
    pitch_deg = math.degrees(station.ask(mavlink.MAVLINK_MSG_ID_ATTITUDE).pitch)
    assert pitch_deg == pytest.approx(-35, abs=1)
    assert station.velocity_m_s[2] == pytest.approx(climb_m_s, abs=0.15)


@pytest.mark.full
def test_a_leaning_copter_sinks_in_stabilized() -> None:
    station = flying("Stabilized")
    hold(station, 2, 1000, 0, 500, 0)
    assert station.velocity_m_s[2] < -1.0
    hold(station, 2, 0, 0, 700, 0)
    assert station.velocity_m_s[2] > 2.0


@pytest.mark.full
def test_a_plane_banks_and_climbs_in_altitude() -> None:
    station = QuietPx4Station("plane")
    assert station.arm() == ACCEPTED
    nowhere = [math.nan] * 6
    assert station.command(mavlink.MAV_CMD_NAV_TAKEOFF, *nowhere, ALT_M + 60) == ACCEPTED
    station.until(lambda: station.height_m > 55, 90)
    hold(station, 1, *CENTRE)
    assert station.set_mode("Altitude") == ACCEPTED
    hold(station, 4, -1000, 1000, 500, 0)
    roll_deg = math.degrees(station.ask(mavlink.MAVLINK_MSG_ID_ATTITUDE).roll)
    assert roll_deg == pytest.approx(50, abs=2)  # FW_R_LIM
    assert station.velocity_m_s[2] == pytest.approx(3.0, abs=0.5)  # FW_T_CLMB_R_SP


# -- taking over and loss --------------------------------------------------------------------------------


@pytest.mark.parametrize(("override", "takes_over"), [(1, True), (0, False), (2, False)])
def test_moving_sticks_take_over_from_an_auto_mode(override: int, *, takes_over: bool) -> None:
    station = flying("Hold", COM_RC_OVERRIDE=override)
    hold(station, 0.5, 20, 0, 500, 0)  # slower than COM_RC_STICK_OV
    assert station.mode == "Hold"
    hold(station, 0.3, 900, 0, 500, 0)
    assert station.mode == ("Position" if takes_over else "Hold")
    assert ("Pilot took over using sticks" in station.texts()) is takes_over


def test_lost_setpoints_return_the_vehicle_to_its_pilot() -> None:
    station = QuietPx4Station()
    station.fly(15)
    station.hold(setpoint((0, 0, -15)), 1)
    assert station.set_mode("Offboard") == ACCEPTED
    for _ in range(20):
        control(station, *CENTRE)
        station.wait(0.1)
    assert station.mode == "Position"  # COM_OBL_RC_ACT 0


# -- Follow Target ---------------------------------------------------------------------------------------


def follow(station: QuietPx4Station, north_m: float, speed_m_s: float = 0.0, up_m: float = 0.0) -> None:
    lat = round((LAT_DEG + north_m / 111_195) * 1e7)
    nothing, unknown = [math.nan] * 3, [1.0, math.nan, math.nan, math.nan]
    velocity = [speed_m_s, 0.0, 0.0]
    station.send(
        mavlink.MAVLink_follow_target_message(
            0, 1, lat, round(LON_DEG * 1e7), ALT_M + up_m, velocity, nothing, unknown, nothing, nothing, 0
        )
    )


def test_follow_target_keeps_its_place_behind_a_moving_target() -> None:
    station = QuietPx4Station(params={"FLW_TGT_DST": 10.0, "FLW_TGT_HT": 12.0})
    station.fly(12)
    assert station.set_mode("Follow Target") == ACCEPTED
    before_m = place_m(station)
    station.wait(5)
    assert math.dist(place_m(station), before_m) < 0.5  # no target yet
    for step in range(30):
        follow(station, 20 + 3.0 * step, speed_m_s=3.0)
        station.wait(1.0)
    north_m, east_m = place_m(station)
    assert north_m == pytest.approx(20 + 3.0 * 30 - 10, abs=2.5)
    assert east_m == pytest.approx(0, abs=1.5)
    assert station.height_m == pytest.approx(12, abs=0.7)
    assert station.ask(mavlink.MAVLINK_MSG_ID_ATTITUDE).yaw == pytest.approx(0, abs=0.15)
    station.wait(3.0)  # STALE_S: the last place counts
    station.wait(10)
    assert place_m(station)[0] == pytest.approx(20 + 3.0 * 30 + 3 * 2 - 10, abs=5)


@pytest.mark.full
def test_follow_target_holds_a_height_above_the_target() -> None:
    station = QuietPx4Station(params={"FLW_TGT_ALT_M": 2})
    station.fly(10)
    assert station.set_mode("Follow Target") == ACCEPTED
    for _ in range(15):
        follow(station, 0, up_m=15)
        station.wait(1.0)
    assert station.height_m == pytest.approx(15 + 8, abs=0.7)
