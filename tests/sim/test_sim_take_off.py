"""Take-offs of copters in a mission, beside those of ArduCopter 4.6.2 and PX4 1.15.3 (docs/measured.md)."""

from __future__ import annotations

import pytest
from px4_station import QuietPx4Station
from station import Station, takeoff, waypoint

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
