"""MAVSDK's mission and mission_raw plug-ins with copters of both autopilots."""

import json
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import pytest
from mavsdk.exceptions import MavsdkError
from mavsdk.plugins.mission import MissionItem, MissionPlan
from mavsdk.plugins.telemetry import FlightMode
from mavsdk_peer import (
    COPTERS,
    MavsdkPeer,
    StreamedValues,
    Vehicle,
    connected,
    finish,
    raw_item,
    refusal,
    side_by_side,
)
from station import LAT_DEG, LON_DEG, home_item, land, takeoff, waypoint

pytestmark = [pytest.mark.interop, pytest.mark.full]
ROUTE = [takeoff(7.0), waypoint(25, 0, 7.0), waypoint(25, 25, 9.4), land(25, 25)]
# ArduPilot repeats a request after 1 s of simulated time and refuses an item that arrives twice.
SITE = ("--home", f"{LAT_DEG},{LON_DEG},300", "--speedup", "12", "--ready-s", "0")


@pytest.fixture(scope="module")
def copters() -> Iterator[MavsdkPeer]:
    with connected("--personality", "ardupilot:4,px4:4", *SITE, *COPTERS) as peer:
        yield peer


def placed(vehicle: Vehicle, route: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return a route from the vehicle's position, on ArduPilot after a home placeholder."""
    east_e7 = round((vehicle.telemetry.home().longitude_deg - LON_DEG) * 1e7)
    moved = [fields | {"x": fields["x"], "y": fields["y"] + east_e7} for fields in route]
    return moved if vehicle.px4 else [home_item(), *moved]


def upload(vehicle: Vehicle, route: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    plan = placed(vehicle, route)
    vehicle.mission_raw.upload_mission([raw_item(seq, fields) for seq, fields in enumerate(plan)])
    return plan


def until_accepted(vehicle: Vehicle, call: Callable[..., Any], *arguments: Any, but: str) -> None:
    """Repeat a call while its result is temporary; raise every other failure."""

    def accepted() -> bool:
        try:
            call(*arguments)
        except MavsdkError as error:
            if error.result.name != but:
                raise
            return False
        return True

    vehicle.until(accepted, f"no longer {but}", 10)


def start(vehicle: Vehicle, plugin: Any) -> None:
    """Start the mission, repeatedly, because PX4 refuses right after an upload."""
    until_accepted(vehicle, plugin.start_mission, but="DENIED")
    vehicle.in_mode(FlightMode.MISSION)


# -- mission_raw -----------------------------------------------------------------------------------------


@pytest.mark.autopilots("2 item 0", "2 read-back", "MAVSDK 5 mission_raw item 0", "MAVSDK 5 start_mission")
@pytest.mark.autopilots(
    "2 item 0", "2 read-back", "MAVSDK 5 mission_raw item 0", "MAVSDK 5 start_mission", of="px4"
)
@side_by_side
def test_a_raw_mission_is_stored_and_flown_to_its_landing(copters: MavsdkPeer, personality: str) -> None:
    vehicle = copters.take(personality)
    vehicle.ready()
    raw = vehicle.mission_raw
    plan = upload(vehicle, ROUTE)
    kept = raw.download_mission()
    assert [found.command for found in kept] == [fields["command"] for fields in plan]
    places = [(found.x, found.y) for found in kept]
    last = plan[-1]
    assert places[-1] == (last["x"], last["y"])
    assert kept[-2].z == pytest.approx(9.4 if vehicle.px4 else 9.39)
    progress = StreamedValues()
    raw.subscribe_mission_progress(progress, None)
    vehicle.action.arm()
    start(vehicle, raw)
    vehicle.until(lambda: vehicle.height_m > 8, "8 m high")
    vehicle.disarmed()
    assert vehicle.near(25, 25)
    assert progress.until(lambda p: p.current >= len(ROUTE) - 1).total == len(plan)
    raw.clear_mission()
    assert len(raw.download_mission()) == (0 if vehicle.px4 else 1)  # ArduPilot's home stays


def plan_of(vehicle: Vehicle) -> str:
    """Return a plan in the file format of QGroundControl."""

    def simple(command: int, frame: int, north_m: float, east_m: float, up_m: float) -> dict[str, Any]:
        return {
            "type": "SimpleItem", "autoContinue": True, "command": command, "frame": frame,
            "doJumpId": 1, "Altitude": up_m, "AltitudeMode": 1, "AMSLAltAboveTerrain": None,
            "params": [0, 0, 0, None, *vehicle.place_deg(north_m, east_m), up_m],
        }  # fmt: skip

    back = {
        "type": "SimpleItem", "autoContinue": True, "command": 20, "frame": 2, "doJumpId": 3,
        "params": [0, 0, 0, 0, 0, 0, 0],
    }  # fmt: skip
    return json.dumps(
        {
            "fileType": "Plan", "groundStation": "QGroundControl", "version": 1,
            "mission": {
                "version": 2, "firmwareType": 12 if vehicle.px4 else 3, "vehicleType": 2,
                "cruiseSpeed": 15, "hoverSpeed": 5, "globalPlanAltitudeMode": 1,
                "plannedHomePosition": [*vehicle.place_deg(0, 0), 300],
                "items": [simple(22, 3, 0, 0, 12), simple(16, 3, 25, 0, 12), back],
            },
            "geoFence": {"circles": [], "polygons": [], "version": 2},
            "rallyPoints": {"points": [[*vehicle.place_deg(-20, 0), 10]], "version": 2},
        }
    )  # fmt: skip


@side_by_side
def test_a_plan_of_qgroundcontrol_and_its_rally_point(copters: MavsdkPeer, personality: str) -> None:
    vehicle = copters.take(personality)
    vehicle.ready()
    raw = vehicle.mission_raw
    imported = raw.import_qgroundcontrol_mission_from_string(plan_of(vehicle))
    assert [found.command for found in imported.mission_items][-3:] == [22, 16, 20]
    assert len(imported.mission_items) == (3 if vehicle.px4 else 4)
    raw.upload_mission(imported.mission_items)
    (point,) = imported.rally_items
    raw.upload_rally_points([point])
    (kept,) = raw.download_rallypoints()
    assert (kept.command, kept.x, kept.y) == (5100, point.x, point.y)


# -- mission ---------------------------------------------------------------------------------------------


def to(vehicle: Vehicle, north_m: float, east_m: float, up_m: float, **fields: Any) -> MissionItem:
    return MissionItem(*vehicle.place_deg(north_m, east_m), up_m, **({"is_fly_through": True} | fields))


def test_px4_flies_a_plan_of_the_mission_plugin_and_returns(copters: MavsdkPeer) -> None:
    vehicle = copters.take("px4")
    vehicle.ready()
    mission = vehicle.mission
    mission.set_return_to_launch_after_mission(True)
    plan = [
        to(vehicle, 0, 0, 10.0, vehicle_action=MissionItem.VehicleAction.TAKEOFF),
        to(vehicle, 30, 0, 12.0, speed_m_s=6.0, gimbal_pitch_deg=-30.0, gimbal_yaw_deg=0.0,
           camera_action=MissionItem.CameraAction.TAKE_PHOTO),
        to(vehicle, 30, 30, 12.0, is_fly_through=False, loiter_time_s=2.0, yaw_deg=90.0),
        to(vehicle, 0, 30, 12.0),
    ]  # fmt: skip
    shares: list[float] = []

    def known(tell: Any) -> Any:
        def progress(result: Any, data: Any, _: Any) -> None:
            shares.append(data.progress)
            tell(result)

        return mission.upload_mission_with_progress_async(MissionPlan(plan), progress, None)

    assert finish(known)[0].name == "SUCCESS"
    assert max(shares) == pytest.approx(1.0)
    kept = mission.download_mission().mission_items
    assert len(kept) == len(plan)
    for sent, found in zip(plan, kept, strict=True):
        assert found.latitude_deg == pytest.approx(sent.latitude_deg, abs=1e-6)
        assert found.relative_altitude_m == sent.relative_altitude_m
    assert (kept[1].speed_m_s, kept[1].gimbal_pitch_deg) == (6.0, -30.0)
    assert (kept[2].loiter_time_s, kept[2].yaw_deg) == (2.0, 90.0)
    assert not mission.is_mission_finished()
    progress = StreamedValues()
    mission.subscribe_mission_progress(progress, None)
    vehicle.action.arm()
    start(vehicle, mission)
    vehicle.until(lambda: vehicle.offset_m()[0] > 15, "15 m north")
    mission.pause_mission()
    vehicle.in_mode(FlightMode.HOLD)
    vehicle.until(lambda: vehicle.ground_speed_m_s < 0.3, "standing")
    start(vehicle, mission)
    vehicle.until(lambda: vehicle.near(30, 30, 1.5), "at the corner")
    mission.set_current_mission_item(1)
    vehicle.until(lambda: vehicle.near(30, 0), "back at the first corner")
    mission.set_current_mission_item(3)
    vehicle.until(mission.is_mission_finished, "finished")
    assert progress.until(lambda p: p.current == p.total).total == len(plan)
    vehicle.in_mode(FlightMode.RETURN_TO_LAUNCH)
    vehicle.disarmed()
    assert vehicle.near(0, 0)
    mission.clear_mission()
    assert mission.download_mission().mission_items == []


@pytest.mark.autopilots("2 error codes", "MAVSDK 5 mission_raw item 0")
def test_ardupilot_accepts_plain_waypoints_of_the_mission_plugin(copters: MavsdkPeer) -> None:
    """MAVSDK sends unset values as NaN, so ArduPilot refuses its take-off, landing and return."""
    vehicle = copters.take("ardupilot")
    vehicle.take_off(10.0)
    mission = vehicle.mission
    start_item = to(vehicle, 0, 0, 10.0, vehicle_action=MissionItem.VehicleAction.TAKEOFF)
    assert refusal(mission.upload_mission, MissionPlan([start_item])) == "INVALID_ARGUMENT"
    route = [(0, 0), (25, 0), (25, 25), (0, 25)]  # the first is home
    plan = MissionPlan([to(vehicle, *place, 12.0) for place in route])
    until_accepted(vehicle, mission.upload_mission, plan, but="BUSY")  # for a moment, with the refused one
    start(vehicle, mission)
    vehicle.until(lambda: vehicle.near(25, 0, 4), "at the first waypoint")
    mission.pause_mission()
    vehicle.in_mode(FlightMode.HOLD)
    vehicle.until(lambda: vehicle.ground_speed_m_s < 0.3, "standing")
    start(vehicle, mission)
    vehicle.until(lambda: vehicle.near(0, 25), "at the last one")
    vehicle.until(mission.is_mission_finished, "finished", 10)
    assert refusal(mission.download_mission) == "UNSUPPORTED"  # it does not support the frame of home
    vehicle.action.return_to_launch()
    vehicle.disarmed()


# -- planes ----------------------------------------------------------------------------------------------
