"""Differences between sent items and items read back."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import plans
from sim_vehicle.conformance.assertions import equal, near
from sim_vehicle.conformance.registry import CheckFunction, check
from sim_vehicle.conformance.vehicle import VehicleUnderTest
from sim_vehicle.station.plan_items import PlanItem

PX4_PINS = "PX4 mavlink_mission.cpp, format_mavlink_mission_item"
PINS = "AUTOPILOTS 2: read-back differs"
LAND, LOITER_TIME = mavlink.MAV_CMD_NAV_LAND, mavlink.MAV_CMD_NAV_LOITER_TIME
TOLERANCE = 1e-4


@dataclass(frozen=True, slots=True)
class _ReadBack:
    """A waypoint with some changed fields, and the fields that each autopilot sends back."""

    name: str
    statement: str
    sent: Mapping[str, Any]  # fields of the `PlanItem`
    back: Mapping[str, Mapping[str, float]]  # autopilot -> fields of the received item; no other is checked
    conditions: Mapping[str, Any] = field(default_factory=dict)


def _params(*values: float) -> dict[str, float]:
    return {f"param{number}": value for number, value in enumerate(values, 1)}


_ROWS = (
    _ReadBack("relative_frame", "Frame 6 is read back as 3 on ArduPilot and as 6 on PX4.",
              {"frame": 6}, {"ardupilot": {"frame": 3}, "px4": {"frame": 6}}),
    _ReadBack("global_frame", "Frame 0 is read back as 0 on ArduPilot and as 5 on PX4.",
              {"frame": 0, "z": 600}, {"ardupilot": {"frame": 0}, "px4": {"frame": 5}}),
    _ReadBack("terrain_frame", "Frame 11 is read back as 10.",
              {"frame": 11}, {"ardupilot": {"frame": 10}}),
    _ReadBack("mission_frame", "A waypoint in frame 2 is accepted and read back in frame 0.",
              {"frame": 2, "z": 600}, {"ardupilot": {"frame": 0}},
              {"source": "AUTOPILOTS 2: frame 2 (MISSION) on a WP"}),
    _ReadBack("altitude",
              "20.3 m is read back as 20.29 m on ArduPilot (truncated to centimetres) and as 20.3 m on PX4.",
              {"z": 20.3}, {"ardupilot": {"z": 20.29}, "px4": {"z": 20.3}}),
    _ReadBack("altitude_thirds", "33.333 m is read back as 33.33 m on ArduPilot and as 33.333 m on PX4.",
              {"z": 33.333}, {"ardupilot": {"z": 33.33}, "px4": {"z": 33.333}}),
    _ReadBack("waypoint_parameters",
              "Parameters (2.7, 5, 6, 90) are read back as (2, 0, 0, 0) on ArduPilot, as (2.7, 5, 0, 90) on "
              "PX4.",
              {"params": (2.7, 5, 6, 90)},
              {"ardupilot": _params(2, 0, 0, 0), "px4": _params(2.7, 5, 0, 90)},
              {"kind": "copter", "source": f"{PINS}; {PX4_PINS}"}),
    _ReadBack("negative_yaw", "A yaw of -90 degrees is read back as 270 degrees.",
              {"params": (0, 0, 0, -90)}, {"px4": {"param4": 270}}, {"source": PX4_PINS}),
    _ReadBack("takeoff_parameters", "Parameters 1 to 3 of a take-off are read back as 0.",
              {"command": mavlink.MAV_CMD_NAV_TAKEOFF, "params": (15, 1, 2, 45)},
              {"px4": _params(0, 0, 0, 45)}, {"source": PX4_PINS}),
    _ReadBack("nan_yaw", "NaN as parameter 4 is read back as 0 on ArduPilot and as NaN on PX4.",
              {"params": (0, 0, 0, math.nan)}, {"ardupilot": {"param4": 0}, "px4": {"param4": math.nan}}),
    _ReadBack("loiter_time", "A radius of 25 m in LOITER_TIME is read back as 1, the direction.",
              {"command": LOITER_TIME, "params": (12, 0, 25, 0)},
              {"ardupilot": {"param1": 12, "param3": 1}}),
    _ReadBack("land_yaw", "Parameter 4 of LAND, sent as 0, is read back as 1.",
              {"command": LAND, "z": 0}, {"ardupilot": {"param4": 1}}, {"kind": "copter"}),
    _ReadBack("frame_without_place", "DO_CHANGE_SPEED in frame 2 is read back in frame 0.",
              {"command": mavlink.MAV_CMD_DO_CHANGE_SPEED, "x": 0, "y": 0, "z": 0, "frame": 2,
               "params": (1, 5, -1, 0)},
              {"ardupilot": {"frame": 0, "param2": 5}}, {"source": "AUTOPILOTS 2: non-position items ->0"}),
)  # fmt: skip


def _readback_check(row: _ReadBack) -> CheckFunction:
    def run(vehicle: VehicleUnderTest) -> str:
        expected = vehicle.known(**row.back)
        place = plans.current_position(vehicle)
        item: PlanItem = replace(plans.waypoint(place, 60, 40), **row.sent)
        plans.upload_or_fail(vehicle, plans.plan(vehicle, plans.takeoff(place), item))
        stored = plans.download(vehicle)[-1]
        seen = {name: getattr(stored, name) for name in expected}
        for name, value in expected.items():
            if math.isnan(value):
                equal(math.isnan(seen[name]), True, f"{name} is NaN")
            else:
                near(seen[name], value, TOLERANCE, name)
        return ", ".join(f"{name} {value:g}" for name, value in seen.items())

    return run


for _row in _ROWS:
    _only = {"dialects": tuple(_row.back)} if len(_row.back) == 1 else {}
    _conditions = {"source": PINS, **_only, **_row.conditions}
    check(f"mission.readback.{_row.name}", statement=_row.statement, **_conditions)(_readback_check(_row))


@check(
    "mission.readback.current_flag",
    dialects=("ardupilot",),
    source="AUTOPILOTS 2: current is 0 on every item",
)
def current_flag(vehicle: VehicleUnderTest) -> str:
    """The field `current` of every item is read back as 0."""
    plans.store_sample(vehicle)
    equal({item.current for item in plans.download(vehicle)}, {0}, "current")
    return "0"
