"""The geofence and the rally points in flight, as ArduCopter 4.6 uses them."""

from typing import Any

import pytest
from profiles import full_only
from px4_station import QuietPx4Station
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import Station, item, land, place_m, station_of, takeoff, waypoint

FENCE = 1


def square(half_m: float, north_m: float = 0.0, command: int = 5001) -> list[dict[str, Any]]:
    corners = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    return [item(command, north_m + a * half_m, b * half_m, param1=4, frame=3) for a, b in corners]


def notices(station: Station) -> list[tuple[int, str]]:
    return [(m.severity, m.text) for m in station.of("STATUSTEXT") if "ence" in m.text or "ecovery" in m.text]


def fenced(*fence: dict[str, Any], kind: int = 4) -> Station:
    """Return a copter on the ground with an enabled fence; `kind` has the bits of FENCE_TYPE."""
    station = Station()
    assert station.upload(list(fence) or square(100), FENCE) == 0
    station.set_parameter("FENCE_TYPE", kind)
    station.set_parameter("FENCE_ENABLE", 1)
    station.wait(1.1)
    return station


@pytest.mark.autopilots("2 fence use")
def test_a_mode_change_after_a_breach_resumes_a_mission_out_of_the_fence() -> None:
    station = fenced()
    station.fly_mission([takeoff(), waypoint(400, 0), land(400, 0)])
    station.until(lambda: station.mode == "RTL", 60)
    assert place_m(station)[0] == pytest.approx(100, abs=3)
    assert notices(station) == [(mavlink.MAV_SEVERITY_NOTICE, "Polygon fence breached")]
    assert station.set_mode("AUTO") == 0
    assert notices(station)[-1] == (mavlink.MAV_SEVERITY_INFO, "Manual recovery started")
    station.until(lambda: place_m(station)[0] > 390, 60)
    assert station.mode == "AUTO"


def test_a_return_into_the_fence_clears_the_breach_and_its_status() -> None:
    station = fenced()
    station.stream(mavlink.MAVLINK_MSG_ID_FENCE_STATUS)
    station.fly_mission([takeoff(), waypoint(400, 0), land(400, 0)])
    station.until(lambda: station.mode == "RTL", 60)
    station.wait(0.5)
    status = station.of("FENCE_STATUS")[-1]
    assert (status.breach_status, status.breach_count) == (1, 1)
    assert status.breach_type == mavlink.FENCE_BREACH_BOUNDARY
    station.until(lambda: notices(station)[-1][1] == "Fence breach cleared", 60)
    station.wait(0.5)
    status = station.of("FENCE_STATUS")[-1]
    assert (status.breach_status, status.breach_type) == (0, mavlink.FENCE_BREACH_NONE)


@pytest.mark.parametrize(
    ("kind", "name", "value", "target", "text"),
    [
        pytest.param(1, "FENCE_ALT_MAX", 30.0, (0, 0, 80), "Max Alt fence breached", id="maximum altitude"),
        pytest.param(2, "FENCE_RADIUS", 60.0, (200, 0, 20), "Circle fence breached", id="circle around home"),
        pytest.param(8, "FENCE_ALT_MIN", 10.0, (150, 0, 2), "Min Alt fence breached", id="minimum altitude"),
    ],
)
def test_a_limit_by_parameter_is_breached(
    kind: int, name: str, value: float, target: tuple[float, ...], text: str
) -> None:
    station = fenced(kind=kind)
    station.set_parameter(name, value)
    station.fly_mission([takeoff(20), waypoint(*target)])
    station.until(lambda: station.mode == "RTL", 60)
    assert notices(station)[-1] == (mavlink.MAV_SEVERITY_NOTICE, text)


@pytest.mark.parametrize(
    ("action", "mode"), [(0, "AUTO"), (2, "LAND"), (4, "BRAKE")], ids=["report only", "land", "brake"]
)
def test_the_action_of_a_breach_follows_its_parameter(action: int, mode: str) -> None:
    station = fenced()
    station.set_parameter("FENCE_ACTION", action)
    station.fly_mission([takeoff(), waypoint(400, 0)])
    station.until(lambda: any(text == "Polygon fence breached" for _, text in notices(station)), 60)
    station.wait(0.5)
    assert station.mode == mode


@pytest.mark.parametrize("enabled_again", [False, True])
def test_a_new_limit_counts_after_the_next_enabling_of_the_fence(enabled_again: bool) -> None:
    station = fenced(kind=4)
    station.set_parameter("FENCE_ALT_MAX", 15)
    station.set_parameter("FENCE_TYPE", 5)
    if enabled_again:
        station.set_parameter("FENCE_ENABLE", 0)
        station.set_parameter("FENCE_ENABLE", 1)
    assert station.set_mode("GUIDED") == 0
    assert station.arm() == 0
    assert station.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 20) == 0
    station.wait(20)
    assert ("Max Alt fence breached" in station.texts()) == enabled_again


def test_an_overruled_breach_of_the_circle_acts_again_20_m_farther_out() -> None:
    station = fenced(kind=2)
    station.set_parameter("FENCE_RADIUS", 60.0)
    station.set_parameter("WPNAV_SPEED", 600.0)
    station.fly_mission([takeoff(), waypoint(400, 0)])
    station.until(lambda: station.mode == "RTL", 60)
    assert station.set_mode("AUTO") == 0
    overruled_s = station.now
    station.wait(0.2)
    station.until(lambda: station.mode == "RTL", 60)
    assert station.now - overruled_s > 10  # time without another reaction
    assert 105 < place_m(station)[0] < 150
    texts = [text for _, text in notices(station)]
    assert texts == ["Circle fence breached", "Manual recovery started", "Circle fence breached"]


def test_a_vehicle_100_m_beyond_the_fence_lands_for_every_action() -> None:
    station = fenced(kind=2)
    station.set_parameter("FENCE_ENABLE", 0)
    station.set_parameter("FENCE_RADIUS", 60.0)
    station.fly_mission([takeoff(), waypoint(400, 0)])
    station.until(lambda: place_m(station)[0] > 165, 60)
    station.set_parameter("FENCE_ENABLE", 1)
    station.wait(0.5)
    assert station.mode == "LAND"


def test_a_return_stays_under_the_fence() -> None:
    station = fenced(kind=1)
    station.set_parameter("FENCE_ALT_MAX", 20.0)  # FENCE_MARGIN: 2 m
    station.set_parameter("RTL_ALT", 6000)
    station.fly_mission([takeoff(10), waypoint(100, 0, 10)])
    station.until(lambda: place_m(station)[0] > 98, 60)
    assert station.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH) == 0
    assert station.highest_m() == pytest.approx(18.0, abs=0.5)
    assert not any("breached" in text for _, text in notices(station))


@pytest.mark.parametrize(
    ("north_m", "slope", "highest_m"),
    [(0, 3.0, 5.0), (3, 3.0, 9.0), *full_only((30, 3.0, 15.0), (0, 0.0, 15.0), (3, 0.4, 15.0))],
)
def test_a_return_close_to_home_climbs_to_the_cone_of_rtl_cone_slope(
    north_m: float, slope: float, highest_m: float
) -> None:
    station = station_of(params={"RTL_CONE_SLOPE": slope, "WPNAV_RADIUS": 20})
    station.fly_mission([takeoff(5), waypoint(north_m, 0, 5)])
    station.wait(30.0)
    assert place_m(station)[0] == pytest.approx(north_m, abs=0.5)
    assert station.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH) == 0
    assert station.highest_m() == pytest.approx(highest_m, abs=1.6)  # 0.5 m of position is 1.5 m of cone


def test_px4_stores_and_ignores_a_fence_without_home_inside() -> None:
    station = QuietPx4Station()
    station.wait(1.0)
    assert station.upload(square(50, north_m=300), FENCE) == 0
    assert station.texts()[-1] == "Geofence invalid, doesn't contain Home position"
    station.fly_mission([takeoff(10), waypoint(60, 0, 10), waypoint(0, 0, 10)])
    station.until(lambda: "Mission finished, loitering" in station.texts(), 120)


@pytest.mark.autopilots("2 fence use", "MAVSDK 5 geofence", of="px4")
def test_px4_holds_at_the_edge_of_its_fence() -> None:
    station = QuietPx4Station(params={"GF_ACTION": 2})
    station.wait(1.0)
    assert station.upload(square(80), FENCE) == 0
    station.fly_mission([takeoff(10), waypoint(300, 0, 10)])
    station.until(lambda: station.mode == "Hold", 60)
    station.wait(20)
    assert 75 < place_m(station)[0] < 110
