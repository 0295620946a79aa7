"""Differences between sent items and items read back."""

import math
from dataclasses import replace
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import plans
from sim_vehicle.conformance.assertions import equal, near
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.vehicle import VehicleUnderTest, known_behaviour
from sim_vehicle.station.plan_items import PlanItem

PX4_PINS = "PX4 mavlink_mission.cpp, format_mavlink_mission_item"
PINS = "AUTOPILOTS 2: read-back differs"


def _point(vehicle: VehicleUnderTest, **changes: Any) -> PlanItem:
    return replace(plans.waypoint(plans.current_position(vehicle), 60, 40), **changes)


@check("mission.readback.relative_frame", source=PINS)
def relative_frame(vehicle: VehicleUnderTest) -> str:
    """Frame 6 is read back as 3 on ArduPilot and as 6 on PX4."""
    expected = known_behaviour(vehicle, ardupilot=3, px4=6)
    equal(plans.store_and_read(vehicle, _point(vehicle, frame=6)).frame, expected, "frame")
    return f"6 -> {expected}"


@check("mission.readback.global_frame", source=PINS)
def global_frame(vehicle: VehicleUnderTest) -> str:
    """Frame 0 is read back as 0 on ArduPilot and as 5 on PX4."""
    expected = known_behaviour(vehicle, ardupilot=0, px4=5)
    equal(plans.store_and_read(vehicle, _point(vehicle, frame=0, z=600)).frame, expected, "frame")
    return f"0 -> {expected}"


@check("mission.readback.terrain_frame", dialects=("ardupilot",), source=PINS)
def terrain_frame(vehicle: VehicleUnderTest) -> str:
    """Frame 11 is read back as 10."""
    equal(plans.store_and_read(vehicle, _point(vehicle, frame=11)).frame, 10, "frame")
    return "11 -> 10"


@check(
    "mission.readback.mission_frame",
    dialects=("ardupilot",),
    source="AUTOPILOTS 2: frame 2 (MISSION) on a WP",
)
def mission_frame(vehicle: VehicleUnderTest) -> str:
    """A waypoint in frame 2 is accepted and read back in frame 0."""
    equal(plans.store_and_read(vehicle, _point(vehicle, frame=2, z=600)).frame, 0, "frame")
    return "2 -> 0"


@check("mission.readback.altitude", source=PINS)
def altitude(vehicle: VehicleUnderTest) -> str:
    """20.3 m is read back as 20.29 m on ArduPilot (truncated to centimetres) and as 20.3 m on PX4."""
    expected = known_behaviour(vehicle, ardupilot=20.29, px4=20.3)
    near(plans.store_and_read(vehicle, _point(vehicle, z=20.3)).z, expected, 1e-3, "z")
    return f"20.3 -> {expected}"


@check("mission.readback.altitude_thirds", source=PINS)
def altitude_thirds(vehicle: VehicleUnderTest) -> str:
    """33.333 m is read back as 33.33 m on ArduPilot and as 33.333 m on PX4."""
    expected = known_behaviour(vehicle, ardupilot=33.33, px4=33.333)
    near(plans.store_and_read(vehicle, _point(vehicle, z=33.333)).z, expected, 5e-4, "z")
    return f"33.333 -> {expected}"


@check("mission.readback.waypoint_parameters", kind="copter", source=f"{PINS}; {PX4_PINS}")
def waypoint_parameters(vehicle: VehicleUnderTest) -> str:
    """Parameters (2.7, 5, 6, 90) are read back as (2, 0, 0, 0) on ArduPilot, as (2.7, 5, 0, 90) on PX4."""
    sent = (2.7, 5.0, 6.0, 90.0)
    expected = known_behaviour(vehicle, ardupilot=(2.0, 0.0, 0.0, 0.0), px4=(2.7, 5.0, 0.0, 90.0))
    item = plans.store_and_read(vehicle, _point(vehicle, params=sent))
    for number, value in enumerate((item.param1, item.param2, item.param3, item.param4)):
        near(value, expected[number], 1e-5, f"param{number + 1}")
    return f"{sent} -> {expected}"


@check("mission.readback.negative_yaw", dialects=("px4",), source=PX4_PINS)
def negative_yaw(vehicle: VehicleUnderTest) -> str:
    """A yaw of -90 degrees is read back as 270 degrees."""
    near(plans.store_and_read(vehicle, _point(vehicle, params=(0, 0, 0, -90.0))).param4, 270.0, 1e-3, "yaw")
    return "-90 -> 270"


@check("mission.readback.takeoff_parameters", dialects=("px4",), source=PX4_PINS)
def takeoff_parameters(vehicle: VehicleUnderTest) -> str:
    """Parameters 1 to 3 of a take-off are read back as 0."""
    item = _point(vehicle, command=mavlink.MAV_CMD_NAV_TAKEOFF, params=(15, 1, 2, 45))
    seen = plans.store_and_read(vehicle, item)
    equal((seen.param1, seen.param2, seen.param3), (0.0, 0.0, 0.0), "param1 to param3")
    near(seen.param4, 45.0, 1e-3, "yaw")
    return "0, 0, 0, 45"


@check("mission.readback.nan_yaw", source=PINS)
def nan_yaw(vehicle: VehicleUnderTest) -> str:
    """NaN as parameter 4 is read back as 0 on ArduPilot and as NaN on PX4."""
    keeps_nan = known_behaviour(vehicle, ardupilot=False, px4=True)
    value = plans.store_and_read(vehicle, _point(vehicle, params=(0, 0, 0, math.nan))).param4
    equal(math.isnan(value), keeps_nan, "NaN kept")
    return f"NaN -> {value:g}"


@check("mission.readback.loiter_time", dialects=("ardupilot",), source=PINS)
def loiter_time(vehicle: VehicleUnderTest) -> str:
    """A radius of 25 m in LOITER_TIME is read back as 1, the direction."""
    item = _point(vehicle, command=mavlink.MAV_CMD_NAV_LOITER_TIME, params=(12, 0, 25, 0))
    seen = plans.store_and_read(vehicle, item)
    equal((seen.param1, seen.param3), (12.0, 1.0), "param1, param3")
    return "25 -> 1"


@check("mission.readback.land_yaw", dialects=("ardupilot",), kind="copter", source=PINS)
def land_yaw(vehicle: VehicleUnderTest) -> str:
    """Parameter 4 of LAND, sent as 0, is read back as 1."""
    equal(
        plans.store_and_read(vehicle, _point(vehicle, command=mavlink.MAV_CMD_NAV_LAND, z=0)).param4,
        1.0,
        "param4",
    )
    return "0 -> 1"


@check(
    "mission.readback.current_flag",
    dialects=("ardupilot",),
    source="AUTOPILOTS 2: current is 0 on every item",
)
def current_flag(vehicle: VehicleUnderTest) -> str:
    """The field `current` of every item is read back as 0."""
    plans.upload_or_fail(vehicle, plans.sample_plan(vehicle))
    equal({item.current for item in plans.download(vehicle)}, {0}, "current")
    return "0"


@check(
    "mission.readback.frame_without_place",
    dialects=("ardupilot",),
    source="AUTOPILOTS 2: non-position items ->0",
)
def frame_without_place(vehicle: VehicleUnderTest) -> str:
    """DO_CHANGE_SPEED in frame 2 is read back in frame 0."""
    item = PlanItem(mavlink.MAV_CMD_DO_CHANGE_SPEED, frame=mavlink.MAV_FRAME_MISSION, params=(1, 5, -1, 0))
    seen = plans.store_and_read(vehicle, item)
    equal((seen.frame, seen.param2), (0, 5.0), "frame, param2")
    return "2 -> 0"
