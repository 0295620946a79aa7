"""Take-offs, starts and short legs beside those of ArduCopter 4.6.2 and PX4 1.15.3 (docs/measured.md)."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from flown_legs import FLOWN_LEGS, GUIDED_START_LOSS_S, PX4_START_LOSS_S, START_LOSS_S, FlownLeg
from px4_station import QuietPx4Station
from station import Station, place_m, station_of, takeoff, waypoint

from swarmctl.agent.replan.travel_time import timed_track
from swarmctl.mavlink.dialects import dialect_for


@pytest.mark.parametrize("leg", FLOWN_LEGS, ids=str)
def test_a_short_leg_takes_as_long_as_on_firmware(leg: FlownLeg) -> None:
    station = station_of(params={"WPNAV_SPEED": 100.0 * leg.speed_m_s})
    corners = [waypoint(north_m, east_m) for east_m, north_m in leg.corners_m[1:]]
    station.fly_mission([takeoff(20.0), *corners])
    reached_s = []
    for seq in (6, 8):
        station.until(lambda seq=seq: seq in station.reached, 120.0)
        reached_s.append(station.now)
    assert reached_s[1] - reached_s[0] == pytest.approx(2.0 * leg.duration_s, rel=0.12)


def ardupilot() -> Station:
    return station_of(params={"WPNAV_SPEED": 1000.0})


def px4() -> Station:
    station = QuietPx4Station()
    station.set_parameter("MPC_XY_CRUISE", 10.0)
    return station


@pytest.mark.parametrize(
    ("station", "autopilot", "loss_s"), [(ardupilot, 3, START_LOSS_S), (px4, 12, PX4_START_LOSS_S)]
)
def test_a_start_from_a_stand_takes_as_long_as_on_firmware_and_as_planned(
    station: Callable[[], Station], autopilot: int, loss_s: float
) -> None:
    flown, copter = station(), dialect_for(autopilot, 2)
    flown.fly_mission([takeoff(20.0), waypoint(200.0, 0.0), waypoint(400.0, 0.0)])
    flown.until(lambda: copter.first_waypoint_seq - 1 in flown.reached, 120.0)
    begins_s, (begins_m, _) = flown.now, place_m(flown)
    track = [(0.0, 0.0), (0.0, 400.0)]
    planned = timed_track(track, 10.0, start_delay_s=copter.start_delay_s)
    for away_m in (30.0, 150.0):
        flown.until(lambda away_m=away_m: place_m(flown)[0] - begins_m >= away_m, 60.0)
        took_s = flown.now - begins_s
        assert took_s == pytest.approx(0.1 * away_m + loss_s, abs=0.5)
        assert took_s == pytest.approx(planned.at(away_m)[1], abs=0.4)


def test_a_return_starts_like_a_mission_and_a_guided_flight_faster() -> None:
    """RTL flies its leg by `AC_WPNav`, GUIDED by the position control with its higher jerk."""
    flown = ardupilot()
    flown.set_parameter("RTL_ALT", 1500)
    flown.fly(20.0)
    assert flown.reposition(200.0, 20.0) == 0
    guided_s = flown.until(lambda: place_m(flown)[0] >= 100.0, 60.0)
    assert guided_s == pytest.approx(10.0 + GUIDED_START_LOSS_S, abs=0.4)
    flown.wait(30.0)
    assert flown.set_mode("RTL") == 0
    return_s = flown.until(lambda: place_m(flown)[0] <= 100.0, 60.0)
    assert return_s == pytest.approx(10.0 + START_LOSS_S, abs=0.5)


# -- take-offs -------------------------------------------------------------------------------------------

FIRMWARE = [("ardupilot", (4.6, 8.8, 12.8), 22.7, 0.6), ("px4", (4.6, 11.3, 15.0), 24.2, 3.3)]
"""personality, seconds from arming to HEIGHTS_M, to the end of a take-off to 40 m, and its tolerance [s]"""
HEIGHTS_M = (0.5, 10.0, 20.0)


def starting(personality: str, *heights_m: float) -> Station:
    """Return a station whose vehicle begins a mission: a take-off, and a waypoint 200 m away."""
    first, *others = heights_m
    station = Station() if personality == "ardupilot" else QuietPx4Station()
    station.fly_mission([takeoff(first), *(waypoint(200.0, 0.0, z) for z in others)])
    return station


@pytest.mark.parametrize(("personality", "climbs_s", "ends_s", "within_s"), FIRMWARE)
def test_a_take_off_takes_as_long_as_on_firmware(
    personality: str, climbs_s: tuple[float, ...], ends_s: float, within_s: float
) -> None:
    station = starting(personality, 40.0, 40.0)
    begin_s = station.now
    for height_m, at_s in zip(HEIGHTS_M, climbs_s, strict=True):
        station.until(lambda height_m=height_m: station.height_m >= height_m, 30.0)
        assert station.now - begin_s == pytest.approx(at_s, abs=0.7)
    station.until(lambda: bool(station.reached), 30.0)
    assert station.now - begin_s == pytest.approx(ends_s, abs=within_s)


def test_a_px4_climbs_at_its_own_speed_after_a_low_take_off() -> None:
    station = starting("px4", 5.0, 60.0)
    station.until(lambda: station.height_m > 15.0, 60.0)
    assert station.velocity_m_s[2] > 2.0
