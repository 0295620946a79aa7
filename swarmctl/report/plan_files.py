"""Flight plans as QGroundControl `.plan` files (JSON), for QGroundControl and Mission Planner."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from swarmctl.core.geo import LatLon
from swarmctl.core.mission import Approach, FlightPlan, Waypoint

NAV_WAYPOINT, NAV_LAND, NAV_TAKEOFF, NAV_LOITER_TO_ALT, DO_LAND_START = 16, 21, 22, 31, 189
QUADROTOR, FIXED_WING = 2, 1
"""MAV_TYPE"""
Params = tuple[float, float, float, float | None]
NO_PARAMS: Params = (0, 0, 0, None)
PlanItem = tuple[int, Waypoint, Params]
"""MAV_CMD, position, param1 to param4"""
FRAME_GLOBAL_RELATIVE_ALT = 3
ALTITUDE_RELATIVE = 1
"""QGroundControl's AltitudeMode"""


def plan_json(plan: FlightPlan, home: LatLon, home_alt_amsl_m: float, speed_m_s: float) -> str:
    """Return the text of a `.plan` file; `home` is the take-off position."""
    touchdown = Waypoint(plan.landing.lat_deg, plan.landing.lon_deg, 0.0)
    steps: list[PlanItem] = [
        (NAV_TAKEOFF, Waypoint(*home, plan.takeoff_alt_m), NO_PARAMS),
        *((NAV_WAYPOINT, point, NO_PARAMS) for point in plan.track),
        *([(NAV_LAND, touchdown, NO_PARAMS)] if plan.approach is None else _landing(plan.approach)),
    ]
    content = {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "swarmctl",
        "geoFence": {"version": 2, "circles": [], "polygons": []},
        "rallyPoints": {"version": 2, "points": []},
        "mission": {
            "version": 2,
            "firmwareType": 3,  # MAV_AUTOPILOT_ARDUPILOTMEGA
            "vehicleType": QUADROTOR if plan.approach is None else FIXED_WING,
            "cruiseSpeed": speed_m_s,
            "hoverSpeed": speed_m_s,
            "globalPlanAltitudeMode": ALTITUDE_RELATIVE,
            "plannedHomePosition": [*home, home_alt_amsl_m],
            "items": [_item(number, *step) for number, step in enumerate(steps, start=1)],
        },
    }
    return json.dumps(content, indent=2) + "\n"


def _landing(approach: Approach) -> Iterator[PlanItem]:
    yield DO_LAND_START, approach.centre, NO_PARAMS
    yield NAV_LOITER_TO_ALT, approach.centre, (1, approach.radius_m, 0, 1)
    yield NAV_WAYPOINT, approach.final, NO_PARAMS
    yield NAV_LAND, approach.touchdown, NO_PARAMS


def _item(number: int, command: int, point: Waypoint, params: Params) -> dict[str, Any]:
    return {
        "type": "SimpleItem",
        "autoContinue": True,
        "command": command,
        "doJumpId": number,
        "frame": FRAME_GLOBAL_RELATIVE_ALT,
        "params": [*params, point.lat_deg, point.lon_deg, point.alt_rel_m],
        "AltitudeMode": ALTITUDE_RELATIVE,
        "Altitude": point.alt_rel_m,
        "AMSLAltAboveTerrain": None,
    }
