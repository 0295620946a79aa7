"""A flight plan as a QGroundControl `.plan` file (JSON), which Mission Planner reads too."""

from __future__ import annotations

import json
from typing import Any

from swarmctl.core.geo import LatLon
from swarmctl.core.mission import FlightPlan, Waypoint

NAV_WAYPOINT, NAV_LAND, NAV_TAKEOFF = 16, 21, 22
FRAME_GLOBAL_RELATIVE_ALT = 3
ALTITUDE_RELATIVE = 1
"""QGroundControl's AltitudeMode"""


def plan_json(plan: FlightPlan, home: LatLon, home_alt_amsl_m: float, speed_m_s: float) -> str:
    """The text of a `.plan` file; `home` is where the vehicle takes off."""
    steps = [
        (NAV_TAKEOFF, Waypoint(*home, plan.takeoff_alt_m)),
        *((NAV_WAYPOINT, point) for point in plan.track),
        (NAV_LAND, Waypoint(plan.landing.lat_deg, plan.landing.lon_deg, 0.0)),
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
            "vehicleType": 2,  # MAV_TYPE_QUADROTOR
            "cruiseSpeed": speed_m_s,
            "hoverSpeed": speed_m_s,
            "globalPlanAltitudeMode": ALTITUDE_RELATIVE,
            "plannedHomePosition": [*home, home_alt_amsl_m],
            "items": [_item(number, *step) for number, step in enumerate(steps, start=1)],
        },
    }
    return json.dumps(content, indent=2) + "\n"


def _item(number: int, command: int, point: Waypoint) -> dict[str, Any]:
    return {
        "type": "SimpleItem",
        "autoContinue": True,
        "command": command,
        "doJumpId": number,
        "frame": FRAME_GLOBAL_RELATIVE_ALT,
        "params": [0, 0, 0, None, point.lat_deg, point.lon_deg, point.alt_rel_m],
        "AltitudeMode": ALTITUDE_RELATIVE,
        "Altitude": point.alt_rel_m,
        "AMSLAltAboveTerrain": None,
    }
