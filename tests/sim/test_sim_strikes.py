"""Strikes against Eq. 1: cells in range, frequency of hits, and reports of the vehicle."""

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import LAT_DEG, LON_DEG, Station, land, station_of, takeoff, waypoint

from sim_vehicle.physics.threats import Threats

STRENGTH = (0.6, 0.3, 0.1)
ENTRIES = 4000


@pytest.mark.parametrize(
    ("cell", "strength"),
    [((2, 2), 0.6), ((2, 3), 0.3), ((1, 2), 0.3), ((3, 3), 0.1), ((1, 1), 0.1), ((2, 4), 0.0), ((4, 2), 0.0)],
)
def test_the_share_of_struck_entries_is_the_firing_strength(cell: tuple[int, int], strength: float) -> None:
    # Eq. 1, within four standard deviations of the binomial
    threats = Threats(5, 5, 50.0, STRENGTH, [(2, 2)])
    rng = np.random.default_rng(11)
    hits = sum(len(threats.fire(*cell, rng)) for _ in range(ENTRIES))
    deviation = math.sqrt(ENTRIES * strength * (1 - strength))
    assert abs(hits - ENTRIES * strength) <= 4 * deviation


def test_every_hostile_in_reach_fires_independently() -> None:
    threats = Threats(3, 3, 50.0, (1.0, 0.9, 0.8), [(r, c) for r in range(3) for c in range(3)])
    rng = np.random.default_rng(5)
    hits = [len(threats.fire(1, 1, rng)) for _ in range(500)]
    assert np.mean(hits) == pytest.approx(1 + 4 * 0.9 + 4 * 0.8, abs=0.2)


def test_cells_count_north_and_east_from_the_south_west_corner() -> None:
    threats = Threats(3, 4, 50.0, STRENGTH, [])
    places = np.array([[0.0, 0, 9], [199.9, 0, 9], [0, 149.9, 9], [60, 110, 9], [-0.1, 5, 9], [5, 150.0, 9]])
    cells = [(int(row), int(col)) for col, row in threats.cells(places.T).T]
    assert [cell if threats.contains(*cell) else None for cell in cells] == [
        (0, 0), (0, 3), (2, 0), (2, 1), None, None,
    ]  # fmt: skip


def area_station(firing_strength: tuple[float, float, float]) -> Station:
    """Return a vehicle 25 m south of the middle of column 0; cell (3, 0) of 50 m is hostile."""
    origin_lat_deg, origin_lon_deg = LAT_DEG + 25 / 111_195, LON_DEG - 25 / 77_450
    area = {"origin_lat_deg": origin_lat_deg, "origin_lon_deg": origin_lon_deg}
    area |= {"rows": 6, "cols": 6, "cell_size_m": 50.0}
    extra = {"area": area, "firing_strength": firing_strength, "hostiles": [[3, 0]]}
    return station_of(**extra)


def test_a_crossing_gets_one_strike_for_each_cell_entered_and_continues() -> None:
    # certain hits from the own cell, nearly certain ones from its neighbours
    station = area_station((1.0, 0.999, 0.998))
    station.stream(mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT)
    station.fly_mission([takeoff(), waypoint(290, 0), land(290, 0)])
    station.until(lambda: not station.armed)
    last = station.of("NAMED_VALUE_INT")[-1]
    assert (last.name, last.value) == ("strikes", 3)
    strikes = [m for m in station.of("STATUSTEXT") if m.text.startswith("STRIKE")]
    assert [m.text for m in strikes] == [
        "STRIKE 1 over 2,0 from 3,0",
        "STRIKE 2 over 3,0 from 3,0",
        "STRIKE 3 over 4,0 from 3,0",
    ]
    assert {m.severity for m in strikes} == {mavlink.MAV_SEVERITY_WARNING}
    assert station.fleet.truth().strikes.tolist() == [3]


def over_a_hostile() -> Station:
    """Return a vehicle on the ground in a hostile cell."""
    area = {"origin_lat_deg": LAT_DEG - 0.0002, "origin_lon_deg": LON_DEG - 0.0002}
    area |= {"rows": 3, "cols": 3, "cell_size_m": 50.0}
    return station_of(area=area, firing_strength=(1.0, 0.5, 0.1), hostiles=[[0, 0]])


def test_a_vehicle_on_the_ground_is_not_fired_at() -> None:
    station = over_a_hostile()
    station.wait(5)
    assert station.fleet.truth().strikes.tolist() == [0]
    station.fly(5)  # lifting off is entering the cell
    assert station.fleet.truth().strikes.tolist() == [1]


def test_strikes_are_sent_with_any_stream_unless_they_are_stopped() -> None:
    station, strikes = over_a_hostile(), mavlink.MAVLINK_MSG_ID_NAMED_VALUE_INT

    def counts(seconds: float) -> int:
        return sum(m.get_type() == "NAMED_VALUE_INT" for m in station.wait(seconds))

    assert counts(5) == 0
    station.stream(mavlink.MAVLINK_MSG_ID_ATTITUDE)
    assert counts(5) == pytest.approx(5, abs=1)
    assert station.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, strikes, -1) == 0
    station.stream(mavlink.MAVLINK_MSG_ID_VFR_HUD)
    assert counts(5) == 0
    station.stream(strikes, hz=2)
    assert counts(5) == pytest.approx(10, abs=1)
    assert station.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1) == 0
    station.wait(5)
    station.stream(mavlink.MAVLINK_MSG_ID_ATTITUDE)  # no interval has been set since the boot
    assert counts(5) == pytest.approx(5, abs=1)
