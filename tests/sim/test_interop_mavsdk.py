"""MAVSDK with copters of both autopilots: the plug-ins action and mission_raw."""

import math
from collections.abc import Iterator, Sequence
from typing import Any

import pytest
from mavsdk.exceptions import MavsdkError
from mavsdk.plugins.action import OrbitYawBehavior
from mavsdk.plugins.mission_raw import MissionItem
from mavsdk.plugins.telemetry import FlightMode, LandedState
from mavsdk_peer import COPTERS, MavsdkPeer, Vehicle, connected, refusal, side_by_side
from station import LAT_DEG, LON_DEG, home_item, land, takeoff, waypoint

pytestmark = pytest.mark.interop
ROUTE = [takeoff(7.0), waypoint(25, 0, 7.0), waypoint(25, 25, 9.4), land(25, 25)]
# ArduPilot repeats a request after 1 s of simulated time and refuses an item that arrives twice.
SITE = ("--home", f"{LAT_DEG},{LON_DEG},300", "--speedup", "12", "--ready-s", "0")


@pytest.fixture(scope="module")
def fast() -> Iterator[MavsdkPeer]:
    with connected("--personality", "mixed", "--speedup", "25", *COPTERS) as peer:
        yield peer


@pytest.fixture(scope="module")
def slow() -> Iterator[MavsdkPeer]:
    """Connect at a speed that the transfers of MAVSDK allow."""
    with connected("--personality", "mixed", *SITE, *COPTERS) as peer:
        yield peer


# -- action ----------------------------------------------------------------------------------------------


@pytest.mark.autopilots("1.14", "MAVSDK 5 goto_location", "MAVSDK 5 set_current_speed", "MAVSDK 5 hold")
@pytest.mark.autopilots(
    "1.14", "MAVSDK 5 goto_location", "MAVSDK 5 set_current_speed", "MAVSDK 5 hold", of="px4"
)
@side_by_side
def test_takeoff_goto_speed_orbit_hold_return_and_landing(fast: MavsdkPeer, personality: str) -> None:
    vehicle = fast.take(personality)
    action, telemetry = vehicle.action, vehicle.telemetry
    vehicle.take_off(8.0)
    vehicle.until(lambda: telemetry.landed_state() == LandedState.IN_AIR, "in the air", 10)
    assert telemetry.in_air()
    assert refusal(action.disarm) == ("COMMAND_DENIED" if vehicle.px4 else "FAILED")
    up_m = telemetry.position().absolute_altitude_m
    action.goto_location(*vehicle.place_deg(40, 0), up_m + 4, math.nan)
    vehicle.until(lambda: vehicle.near(40, 0), "40 m north")
    vehicle.until(lambda: abs(vehicle.height_m - 12) < 1, "12 m high")
    if not vehicle.px4:
        assert refusal(action.set_current_speed, -1.0) == "FAILED"
    action.goto_location(*vehicle.place_deg(40, 60), up_m + 4, 90.0)
    action.set_current_speed(2.0)
    vehicle.until(lambda: vehicle.near(40, 20), "20 m east")
    assert vehicle.ground_speed_m_s == pytest.approx(2.0, abs=0.4)
    if vehicle.px4:
        orbit(vehicle)
    action.hold()
    vehicle.in_mode(FlightMode.HOLD)
    vehicle.until(lambda: vehicle.ground_speed_m_s < 0.3, "standing")
    action.return_to_launch()
    vehicle.in_mode(FlightMode.RETURN_TO_LAUNCH)
    vehicle.disarmed()
    assert vehicle.near(0, 0, 2.0)
    vehicle.until(lambda: telemetry.landed_state() == LandedState.ON_GROUND, "on the ground", 10)


def orbit(vehicle: Vehicle) -> None:
    """Wait for an orbit with a radius of 15 m around a point 20 m north."""
    centre = vehicle.place_deg(60, 20)
    height_m = vehicle.telemetry.position().absolute_altitude_m
    vehicle.action.do_orbit(15.0, 4.0, OrbitYawBehavior.HOLD_FRONT_TO_CIRCLE_CENTER, *centre, height_m)
    for place in ((75, 20), (60, 5), (45, 20)):
        vehicle.until(lambda place=place: vehicle.near(*place, 4.0), f"round to {place}")
    assert vehicle.mode not in (FlightMode.HOLD, FlightMode.MISSION)


# -- mission_raw -----------------------------------------------------------------------------------------


def placed(vehicle: Vehicle, route: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return a route from the vehicle's position, on ArduPilot after a home placeholder."""
    east_e7 = round((vehicle.telemetry.home().longitude_deg - LON_DEG) * 1e7)
    moved = [fields | {"x": fields["x"], "y": fields["y"] + east_e7} for fields in route]
    return moved if vehicle.px4 else [home_item(), *moved]


def upload(vehicle: Vehicle, route: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    plan = placed(vehicle, route)
    items = [
        MissionItem(seq=seq, current=int(seq == 0), autocontinue=1, mission_type=0, **fields)
        for seq, fields in enumerate(plan)
    ]
    vehicle.mission_raw.upload_mission(items)
    return plan


def start(vehicle: Vehicle, plugin: Any) -> None:
    """Start the mission, repeatedly, because PX4 refuses right after an upload."""

    def accepted() -> bool:
        try:
            plugin.start_mission()
        except MavsdkError as error:
            if error.result.name != "DENIED":
                raise
            return False
        return True

    vehicle.until(accepted, "started", 10)
    vehicle.in_mode(FlightMode.MISSION)


@pytest.mark.full
@pytest.mark.autopilots("2 item 0", "2 read-back", "MAVSDK 5 mission_raw item 0", "MAVSDK 5 start_mission")
@pytest.mark.autopilots(
    "2 item 0", "2 read-back", "MAVSDK 5 mission_raw item 0", "MAVSDK 5 start_mission", of="px4"
)
@side_by_side
def test_a_raw_mission_is_stored_and_flown_to_its_landing(slow: MavsdkPeer, personality: str) -> None:
    vehicle = slow.take(personality)
    vehicle.ready()
    raw = vehicle.mission_raw
    plan = upload(vehicle, ROUTE)
    kept = raw.download_mission()
    assert [found.command for found in kept] == [fields["command"] for fields in plan]
    places = [(found.x, found.y) for found in kept]
    last = plan[-1]
    assert places[-1] == (last["x"], last["y"])
    assert kept[-2].z == pytest.approx(9.4 if vehicle.px4 else 9.39)
    progress: list[Any] = []
    raw.subscribe_mission_progress(lambda update, _: progress.append(update), None)
    vehicle.action.arm()
    start(vehicle, raw)
    vehicle.until(lambda: vehicle.height_m > 8, "8 m high")
    vehicle.disarmed()
    assert vehicle.near(25, 25)
    last = next(update for update in progress if update.current >= len(ROUTE) - 1)
    assert last.total == len(plan)
    raw.clear_mission()
    assert len(raw.download_mission()) == (0 if vehicle.px4 else 1)  # ArduPilot's home stays
