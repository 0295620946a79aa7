"""Starts and short legs of a mission, beside those of ArduCopter 4.6.2 (docs/measured.md)."""

from __future__ import annotations

import pytest
from flown_legs import FLOWN_LEGS, START_LOSS_S, FlownLeg
from station import Station, takeoff, waypoint


@pytest.mark.parametrize("leg", FLOWN_LEGS, ids=str)
def test_a_short_leg_takes_as_long_as_on_firmware(leg: FlownLeg) -> None:
    station = Station()
    station.set_parameter("WPNAV_SPEED", 100.0 * leg.speed_m_s)
    corners = [waypoint(north_m, east_m) for east_m, north_m in leg.corners_m[1:]]
    station.fly_mission([takeoff(20.0), *corners])
    reached_s = []
    for seq in (6, 8):
        station.until(lambda seq=seq: seq in station.reached, 120.0)
        reached_s.append(station.now)
    assert reached_s[1] - reached_s[0] == pytest.approx(2.0 * leg.duration_s, rel=0.12)


def test_a_start_from_a_stand_takes_as_long_as_on_firmware() -> None:
    station = Station()
    station.set_parameter("WPNAV_SPEED", 1000.0)
    station.fly_mission([takeoff(20.0), waypoint(200.0, 0.0), waypoint(400.0, 0.0)])
    reached_s = []
    for seq in (1, 2):
        station.until(lambda seq=seq: seq in station.reached, 120.0)
        reached_s.append(station.now)
    assert reached_s[1] - reached_s[0] == pytest.approx(20.0 + START_LOSS_S, abs=0.5)
