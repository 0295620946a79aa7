"""Real autopilots in software that a station, a failsafe or an operator takes off their routes."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import pytest
from firmware import Airfield
from flown_cells import NS, Flown
from namespaces import Process
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from recorded import effects, events
from udp_relay import Radio

COPTER, PX4 = "arducopter", "px4"
PAIR = [COPTER] * 2
CELLS = 10
FLIGHT_S = 400.0
OFF_PLAN_M = 12.0
LANDED_M = 3.0
NOTICED_S = 15.0
"""time in which the program notices another mission on an ArduPilot"""
BRAKE, LAND = 17, 9
PX4_HOLD, PX4_LAND = 4 << 16 | 3 << 24, 4 << 16 | 6 << 24
FAILED = 1


def assert_arrived(field: Airfield, one: Flown) -> None:
    assert one.account["outcome"] == "arrived", one
    assert one.furthest_m < OFF_PLAN_M, one
    assert field.distance_from_goal_m(one.name) < LANDED_M, one


def orders_after(run: Path, name: str, since_s: float) -> list[dict[str, Any]]:
    """Return what the agent had sent to its vehicle after a time."""
    kinds = ("Command", "SwapMission", "SetSpeed")
    return [one for kind in kinds for one in effects(run, kind, name) if one["log_time_ns"] / NS > since_s]


def assert_released(field: Airfield, name: str, since_s: float, within_s: float) -> None:
    """Check that the program let the vehicle go soon, and has ordered nothing since."""
    released_s = [one["log_time_ns"] / NS for one in effects(field.run, "Release", name)]
    assert released_s, f"{name} was not released"
    assert since_s < released_s[0] < since_s + within_s
    assert not orders_after(field.run, name, released_s[0])


def end_of(flight: Process) -> int:
    return flight.ended(within_s=FLIGHT_S)


@pytest.mark.parametrize(
    ("kind", "hold", "land"),
    [
        pytest.param(COPTER, BRAKE, LAND, marks=pytest.mark.firmware(COPTER), id=COPTER),
        pytest.param(PX4, PX4_HOLD, PX4_LAND, marks=pytest.mark.firmware(PX4), id=PX4),
    ],
)
def test_another_stations_mode(field_of: Any, kind: str, hold: int, land: int) -> None:
    with field_of([kind] * 2, cells=CELLS) as field:
        flight, witness, sysid = field.fly(), field.witness, field.sysids["uav1"]
        field.await_column("uav1", 3)
        since_s = time.time()
        witness.set_mode(sysid, hold)
        field.await_column("uav2", 7)
        assert witness[sysid].mode == hold
        witness.set_mode(sysid, land)
        assert end_of(flight) == FAILED
        assert_released(field, "uav1", since_s, within_s=5.0)
        assert_arrived(field, field.flown(uav1=since_s)["uav2"])


@pytest.mark.firmware(COPTER)
def test_another_stations_mission(field_of: Any) -> None:
    with field_of(PAIR, cells=CELLS) as field:
        flight, witness, grid = field.fly(), field.witness, field.scenario.grid
        field.await_column("uav1", 3)
        since_s = time.time()
        # A row of the area that no plan of this vehicle would land in.
        place = grid.centre((0, 6))
        waypoint, land = mavlink.MAV_CMD_NAV_WAYPOINT, mavlink.MAV_CMD_NAV_LAND
        takeoff = mavlink.MAV_CMD_NAV_TAKEOFF
        home = (waypoint, *place, 0.0)
        witness.upload(
            1, [home, (takeoff, 0.0, 0.0, 40.0), *[(waypoint, *place, 40.0)] * 2, (land, *place, 0.0)]
        )
        assert end_of(flight) == FAILED
        assert_released(field, "uav1", since_s, within_s=NOTICED_S)
        assert field.distance_from_m("uav1", place) < LANDED_M
        assert_arrived(field, field.flown(uav1=since_s)["uav2"])


@pytest.mark.firmware(COPTER)
def test_an_autopilot_that_ends_in_flight(field_of: Any) -> None:
    """It starts anew on the ground, on another port, and must stay there."""
    with field_of(PAIR, cells=CELLS) as field:
        flight = field.fly()
        field.await_column("uav1", 3)
        since_s = time.time()
        field.end("uav1")
        field.start("uav1")
        assert end_of(flight) == FAILED
        seen = field.witness[1]
        assert len(seen.armed_at_s) == 1, "armed again"
        assert not seen.is_armed
        assert_arrived(field, field.flown(uav1=since_s)["uav2"])
        assert not orders_after(field.run, "uav1", since_s + 60.0)


@pytest.mark.firmware(COPTER)
def test_an_outage_that_the_failsafe_notices(field_of: Any) -> None:
    """The vehicles return after 10 s by themselves, and the program leaves them to it."""
    radio = Radio()
    with field_of(PAIR, radio, cells=CELLS, policy={"lost_link": "return"}) as field:
        flight = field.fly()
        field.await_column("uav1", 3)
        since_s = time.time()
        radio.cut_for(26.0)
        assert end_of(flight) == FAILED
        assert {one["vehicle"] for one in events(field.run, "LinkRestored")} == {*field.sysids}
        for name, one in field.flown(uav1=since_s, uav2=since_s).items():
            assert_released(field, name, since_s, within_s=32.0)
            assert one.furthest_m < OFF_PLAN_M, one
            assert field.distance_from_start_m(name) < LANDED_M, one


@pytest.mark.firmware(COPTER)
def test_a_recall(field_of: Any) -> None:
    with field_of([COPTER] * 3, cells=CELLS) as field:
        flight = field.fly()
        field.await_column("uav1", 3)
        since_s = time.time()
        field.swarmctl("abort", "return", "--all")
        end_of(flight)
        for name, one in field.flown(uav1=since_s, uav2=since_s, uav3=since_s).items():
            assert one.furthest_m < OFF_PLAN_M, one
            assert field.distance_from_start_m(name) < LANDED_M, one


@pytest.mark.firmware(COPTER)
@pytest.mark.parametrize(
    ("parameter", "value"), [("SIM_BATT_VOLTAGE", 10.0), ("FENCE_ALT_MAX", 30.0)], ids=["battery", "fence"]
)
def test_a_failsafe(field_of: Any, parameter: str, value: float) -> None:
    """A vehicle with a low battery, and one above its fence, return by themselves."""
    with field_of(PAIR, cells=CELLS) as field:
        flight = field.fly()
        field.await_column("uav1", 3)
        since_s = time.time()
        field.witness.set_parameter(1, parameter, value)
        assert end_of(flight) == FAILED
        assert field.distance_from_start_m("uav1") < LANDED_M
        assert_arrived(field, field.flown(uav1=since_s)["uav2"])
