"""The real MAVSDK, which treats PX4 in its own way, flies `python -m sim_vehicle --personality px4`."""

import math
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from mavsdk import ComponentType, Configuration, ConnectionResult, Mavsdk
from mavsdk.plugins.action import Action
from mavsdk.plugins.info import Info
from mavsdk.plugins.mission_raw import MissionRaw, MissionRawError
from mavsdk.plugins.offboard import Offboard, PositionNedYaw
from mavsdk.plugins.param import Param
from mavsdk.plugins.telemetry import FlightMode, Telemetry
from station import land, waypoint
from test_interop_mavsdk import SYSTEM_S, free_udp_port, raw_item, simulator

pytestmark = pytest.mark.interop
LIMIT_S = 30.0
PLAN = [waypoint(30, 0, 15.0), waypoint(30, 30, 20.3), land(30, 30)]


@pytest.fixture
def system() -> Iterator[Any]:
    port = free_udp_port()
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    assert mavsdk.add_any_connection(f"udpin://127.0.0.1:{port}") == ConnectionResult.SUCCESS
    arguments = ("--personality", "px4", "--speedup", "15", "--ready-s", "3", "--no-table")
    try:
        with simulator(*arguments, "--url", f"udpout:127.0.0.1:{port}"):
            found = mavsdk.first_autopilot(SYSTEM_S)
            assert found is not None
            yield found
    finally:
        mavsdk.destroy()


def until(condition: Callable[[], bool], limit_s: float = LIMIT_S) -> None:
    end_s = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < end_s, f"not within {limit_s} s"
        time.sleep(0.02)


def take_off(system: Any, height_m: float) -> Telemetry:
    """Armable without any rate being asked for; up by the parameter MAVSDK writes for it."""
    telemetry, action = Telemetry(system), Action(system)
    until(lambda: bool(telemetry.health().is_armable))
    action.set_takeoff_altitude(height_m)
    assert Param(system).get_param_float("MIS_TAKEOFF_ALT") == height_m
    action.arm()
    action.takeoff()
    until(lambda: telemetry.flight_mode() == FlightMode.HOLD and telemetry.in_air())
    until(lambda: abs(telemetry.position().relative_altitude_m - height_m) < 0.5)
    return telemetry


def start_mission(missions: MissionRaw) -> None:
    """As often as it takes: right after an upload the vehicle says no."""

    def accepted() -> bool:
        try:
            missions.start_mission()
        except MissionRawError:
            return False
        return True

    until(accepted, 5.0)


def test_takeoff_goto_offboard_mission_and_landing(system: Any) -> None:
    telemetry = take_off(system, 12.0)
    place = telemetry.position()
    Action(system).goto_location(
        place.latitude_deg + 0.0003, place.longitude_deg, place.absolute_altitude_m + 5, math.nan
    )
    until(lambda: abs(telemetry.position().latitude_deg - place.latitude_deg - 0.0003) < 2e-5)
    offboard = Offboard(system)
    offboard.set_position_ned(PositionNedYaw(10.0, 10.0, -15.0, 0.0))
    offboard.start()
    until(lambda: telemetry.flight_mode() == FlightMode.OFFBOARD)
    until(lambda: abs(telemetry.position_velocity_ned().position.east_m - 10.0) < 1.5)
    offboard.stop()
    until(lambda: telemetry.flight_mode() == FlightMode.HOLD)
    missions = MissionRaw(system)
    missions.upload_mission([raw_item(seq, fields) for seq, fields in enumerate(PLAN)])
    kept = missions.download_mission()
    assert [(item.command, item.x, item.y) for item in kept] == [
        (fields["command"], fields["x"], fields["y"]) for fields in PLAN
    ]
    start_mission(missions)
    until(lambda: not telemetry.armed())
    landed = telemetry.position()
    assert abs(landed.latitude_deg * 1e7 - PLAN[-1]["x"]) < 300


def test_versions_and_parameters_of_both_types(system: Any) -> None:
    version = Info(system).get_version()
    assert (version.flight_sw_major, version.flight_sw_minor) == (1, 15)
    parameters = Param(system)
    assert parameters.get_param_int("MAV_SYS_ID") == 1
    for value in (-1, 6, 2**31 - 1):
        parameters.set_param_int("COM_FLTMODE1", value)
        assert parameters.get_param_int("COM_FLTMODE1") == value
    parameters.set_param_float("RTL_RETURN_ALT", 22.5)
    assert parameters.get_param_float("RTL_RETURN_ALT") == 22.5
    every = parameters.get_all_params()
    assert {p.name for p in every.int_params} >= {"MAV_SYS_ID", "NAV_DLL_ACT"}
    assert {p.name for p in every.float_params} >= {"MIS_TAKEOFF_ALT", "MPC_XY_CRUISE"}
