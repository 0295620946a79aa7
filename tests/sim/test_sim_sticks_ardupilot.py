"""Sticks of ArduCopter and ArduPlane: overrides, their time-out, arming, and the flight in each pilot's mode.

The numbers are those of ArduCopter 4.6.2 in software-in-the-loop, for the same inputs.
"""

import math
from collections.abc import Sequence

import pytest
from profiles import full_only
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import Station, airborne_plane, place_m, station_of

RECEIVER = [1500, 1500, 1000, 1500, 1800, 1000, 1000, 1800]
NEUTRAL = (1500, 1500, 1500, 1500)
FAILED = 4


def override(station: Station, *pulses_us: int, more: Sequence[int] = ()) -> None:
    first = [*pulses_us, *[0xFFFF] * (8 - len(pulses_us))]
    later = [*more, *[0] * (10 - len(more))]
    station.send(mavlink.MAVLink_rc_channels_override_message(1, 1, *first, *later))


def control(station: Station, x: int = 0, y: int = 0, z: int = 500, r: int = 0, target: int = 1) -> None:
    station.send(mavlink.MAVLink_manual_control_message(target, x, y, z, r, 0))


def hold(station: Station, seconds: float, *pulses_us: int) -> None:
    """Hold the sticks."""
    for _ in range(round(seconds / 0.2)):
        override(station, *pulses_us)
        station.wait(0.2)


def channels(station: Station) -> list[int]:
    message = station.ask(mavlink.MAVLINK_MSG_ID_RC_CHANNELS)
    return [getattr(message, f"chan{n}_raw") for n in range(1, 9)]


def flying(mode: str, height_m: float = 40.0) -> Station:
    station = Station()
    station.fly(height_m)
    override(station, *NEUTRAL)
    assert station.set_mode(mode) == 0
    hold(station, 2, *NEUTRAL)
    return station


# -- channels --------------------------------------------------------------------------------------------


def test_rc_channels_shows_the_receiver_and_overrides_until_rc_override_time() -> None:
    station = Station()
    assert station.ask(mavlink.MAVLINK_MSG_ID_RC_CHANNELS).chancount == 8
    assert channels(station) == RECEIVER
    override(station, 1600, 1400, 1300, 1700)
    assert channels(station) == [1600, 1400, 1300, 1700, *RECEIVER[4:]]
    station.wait(2.8)
    assert channels(station)[0] == 1600
    station.wait(0.3)
    assert channels(station) == RECEIVER


@pytest.mark.full
@pytest.mark.parametrize(("limit_s", "after_10_s"), [(0.0, 1500), (-1.0, 1600), (20.0, 1600), (5.0, 1500)])
def test_rc_override_time(limit_s: float, after_10_s: int) -> None:
    station = station_of(params={"RC_OVERRIDE_TIME": limit_s})
    override(station, 1600)
    assert channels(station)[0] == (1500 if limit_s == 0 else 1600)
    station.wait(10)
    assert channels(station)[0] == after_10_s


def test_zero_keeps_one_of_the_later_channels_and_the_value_below_the_largest_releases_it() -> None:
    station = Station()
    override(station, more=(1900, 1900))
    override(station, more=(0, 0xFFFE))
    message = station.ask(mavlink.MAVLINK_MSG_ID_RC_CHANNELS)
    assert (message.chan9_raw, message.chan10_raw) == (1900, 0)


def test_manual_control_sets_four_channels_and_32767_releases_one() -> None:
    station = Station()
    control(station, x=500, y=-500, z=250, r=1000)
    assert channels(station)[:4] == [1250, 1250, 1250, 2000]
    control(station, x=32767, y=0, z=0, r=0)
    assert channels(station) == RECEIVER
    control(station, x=500, z=-5)
    control(station, x=500, target=2)
    assert channels(station) == RECEIVER


def test_only_the_own_ground_station_has_the_sticks() -> None:
    station = Station(sysid=254)
    override(station, 1600)
    control(station, x=500)
    assert channels(station) == RECEIVER
    station.set_parameter("SYSID_MYGCS", 254)
    override(station, 1600)
    assert channels(station)[0] == 1600


# -- arming and modes ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("mode", "pulses_us", "refusal"),
    [
        ("STABILIZE", (1500, 1500, 1100, 1500), "Throttle too high"),
        ("ALT_HOLD", (1500, 1500, 1500, 1500), "Throttle (RC3) is not neutral"),
        ("LOITER", (1500, 1500, 1650, 1500), "Throttle too high"),
        ("GUIDED", (1500, 1500, 1650, 1500), "Throttle (RC3) is not neutral"),
        ("STABILIZE", (1600, 1500, 1000, 1500), "Roll (RC1) is not neutral"),
        ("GUIDED", (1500, 1500, 1000, 1400), "Yaw (RC4) is not neutral"),
        ("STABILIZE", (1515, 1490, 1020, 1500), None),
    ],
)
def test_arming_needs_the_sticks_at_rest(mode: str, pulses_us: Sequence[int], refusal: str | None) -> None:
    station = Station()
    station.set_mode(mode)
    override(station, *pulses_us)
    assert station.arm() == (FAILED if refusal else 0)
    assert refusal is None or f"Arm: {refusal}" in station.texts()


def test_a_copter_on_the_ground_does_not_leap_into_a_manual_mode() -> None:
    station = Station()
    station.set_mode("GUIDED")
    assert station.arm() == 0
    override(station, 1500, 1500, 1700, 1500)
    assert station.set_mode("STABILIZE") == FAILED
    assert "Mode change to STABILIZE failed: throttle too high" in station.texts()
    override(station, 1500, 1500, 1000, 1500)
    assert station.set_mode("STABILIZE") == 0


@pytest.mark.full
def test_a_raised_throttle_delays_the_automatic_disarming() -> None:
    station = Station()
    station.set_mode("ALT_HOLD")
    assert station.arm() == 0
    hold(station, 15, *NEUTRAL)
    assert station.armed
    station.wait(14)  # 3 s until the override ends, and DISARM_DELAY
    assert not station.armed


def test_overrides_replace_a_failed_receiver_and_their_end_is_a_radio_failsafe() -> None:
    station = flying("LOITER")
    station.set_parameter("SIM_RC_FAIL", 1)
    hold(station, 5, *NEUTRAL)
    assert station.mode == "LOITER"
    station.wait(1.3)  # RC_FS_TIMEOUT
    assert station.mode == "RTL"


def test_a_receiver_that_fails_after_an_override_counts_until_its_own_failure() -> None:
    station = flying("LOITER")
    station.wait(0.5)
    station.set_parameter("SIM_RC_FAIL", 1)
    station.wait(0.6)
    assert station.mode == "LOITER"
    station.wait(0.7)
    assert station.mode == "RTL"


@pytest.mark.full
@pytest.mark.parametrize("throttle", [500, -5])  # the sticks of a negative throttle are ignored
def test_manual_control_counts_as_a_heartbeat_of_the_ground_station(throttle: int) -> None:
    station = flying("LOITER")
    for name, value in (("FS_GCS_ENABLE", 1), ("FS_OPTIONS", 0)):
        station.set_parameter(name, value)
    for _ in range(80):
        control(station, z=throttle)
        station.wait(0.1)
    assert station.mode == "LOITER"
    station.wait(7)
    assert station.mode == "RTL"


# -- copter ----------------------------------------------------------------------------------------------


def test_stabilize_takes_off_climbs_and_falls_by_its_throttle() -> None:
    station = Station()
    assert station.arm() == 0
    hold(station, 4, 1500, 1500, 1400, 1500)
    assert station.height_m < 0.1
    hold(station, 5, 1500, 1500, 1700, 1500)
    assert station.velocity_m_s[2] == pytest.approx(8.5, abs=1.0)
    assert station.height_m == pytest.approx(32, abs=8)
    hold(station, 2, 1500, 1500, 1000, 1500)
    assert station.velocity_m_s[2] == pytest.approx(-8, abs=3)


@pytest.mark.parametrize(
    ("throttle_us", "climb_m_s"),
    [(1000, -2.5), (1800, 1.3), *full_only((1200, -1.45), (1450, 0.0), (1500, 0.0), (2000, 2.5))],
)
def test_alt_hold_climbs_by_the_throttle_outside_its_deadzone(throttle_us: int, climb_m_s: float) -> None:
    station = flying("ALT_HOLD")
    hold(station, 3, 1500, 1500, throttle_us, 1500)
    assert station.velocity_m_s[2] == pytest.approx(climb_m_s, abs=0.12)


@pytest.mark.parametrize(
    ("roll_us", "pitch_us", "lean_deg"),
    [(2000, 1000, (22, -20.5)), *full_only((1500, 1000, (0, -30)), (1750, 1500, (14.4, 0)))],
)
def test_alt_hold_leans_up_to_angle_max(roll_us: int, pitch_us: int, lean_deg: tuple[float, float]) -> None:
    station = flying("ALT_HOLD")
    hold(station, 2, roll_us, pitch_us, 1500, 1500)
    attitude = station.ask(mavlink.MAVLINK_MSG_ID_ATTITUDE)
    assert math.degrees(attitude.roll) == pytest.approx(lean_deg[0], abs=1)
    assert math.degrees(attitude.pitch) == pytest.approx(lean_deg[1], abs=1)


def test_the_yaw_stick_turns_at_pilot_y_rate() -> None:
    station = flying("ALT_HOLD")
    hold(station, 1, 1500, 1500, 1500, 2000)
    rate = station.ask(mavlink.MAVLINK_MSG_ID_ATTITUDE).yawspeed
    assert math.degrees(rate) == pytest.approx(202.5, abs=3)
    hold(station, 1, 1500, 1500, 1500, 1500)
    assert station.ask(mavlink.MAVLINK_MSG_ID_ATTITUDE).yawspeed == pytest.approx(0, abs=0.02)


@pytest.mark.full
def test_alt_hold_drifts_with_the_wind_and_loiter_does_not() -> None:
    drifts_m = {}
    for mode in ("ALT_HOLD", "LOITER"):
        station = flying(mode)
        for name, value in (("SIM_WIND_SPD", 6), ("SIM_WIND_DIR", 0)):
            station.set_parameter(name, value)
        before_m = place_m(station)
        hold(station, 10, *NEUTRAL)
        drifts_m[mode] = place_m(station)[0] - before_m[0]
    assert drifts_m["ALT_HOLD"] < -10
    assert drifts_m["LOITER"] == pytest.approx(0, abs=2)


@pytest.mark.parametrize("mode", ["LOITER", *full_only("POSHOLD")])
def test_loiter_flies_by_the_sticks_brakes_and_holds(mode: str) -> None:
    station = flying(mode)
    start_m = place_m(station)
    hold(station, 1, 1500, 1000, 1500, 1500)
    assert 1.5 < station.velocity_m_s[0] < 6  # no leap
    hold(station, 6, 1500, 1000, 1500, 1500)
    assert station.velocity_m_s[0] == pytest.approx(11.5, abs=2)
    hold(station, 8, *NEUTRAL)
    held_m = place_m(station)
    hold(station, 5, *NEUTRAL)
    assert math.dist(place_m(station), held_m) < 0.3
    assert held_m[0] - start_m[0] > 60
    assert station.height_m == pytest.approx(40, abs=1)
    hold(station, 4, 1500, 1500, 2000, 1500)
    assert station.velocity_m_s[2] == pytest.approx(2.5, abs=0.1)
    assert math.dist(place_m(station), held_m) < 0.5


# -- plane -----------------------------------------------------------------------------------------------


def test_fbwb_banks_climbs_and_sets_the_airspeed() -> None:
    station = airborne_plane()
    override(station, *NEUTRAL)
    assert station.set_mode("FBWB") == 0
    hold(station, 5, 2000, 1500, 1500, 1500)
    assert math.degrees(station.ask(mavlink.MAVLINK_MSG_ID_ATTITUDE).roll) == pytest.approx(45, abs=1)
    hold(station, 6, 1500, 2000, 2000, 1500)
    hud = station.ask(mavlink.MAVLINK_MSG_ID_VFR_HUD)
    assert hud.climb == pytest.approx(2.0, abs=0.3)
    assert hud.airspeed == pytest.approx(22, abs=1)


@pytest.mark.full
def test_a_plane_glides_without_its_remote_control() -> None:
    station = airborne_plane()
    override(station, 1500, 1500, 2000, 1500)
    assert station.set_mode("FBWA") == 0
    for name, value in (("FS_LONG_ACTN", 2), ("FS_SHORT_ACTN", 2), ("SIM_RC_FAIL", 1)):
        station.set_parameter(name, value)
    station.wait(12)
    assert station.mode == "FBWA"
    assert station.ask(mavlink.MAVLINK_MSG_ID_VFR_HUD).throttle == 0
    assert station.velocity_m_s[2] < -0.3


@pytest.mark.full
def test_fbwa_climbs_only_with_power() -> None:
    station = airborne_plane()
    override(station, 1500, 2000, 2000, 1500)
    assert station.set_mode("FBWA") == 0
    before_m = station.height_m
    hold(station, 8, 1500, 2000, 2000, 1500)
    assert station.height_m > before_m + 20
    top_m = station.height_m
    hold(station, 20, 1500, 1500, 1000, 1500)
    assert station.height_m < top_m
