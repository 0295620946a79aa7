"""ArduPlane 4.x, fixed wings. Facts from ArduPlane's sources (`ArduPlane/`, `libraries/AP_Mission/`)."""

from __future__ import annotations

import math
from collections.abc import Iterator

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.any_angle.turns import tangent_length
from swarmctl.core.geo import LatLon, LocalFrame
from swarmctl.core.mission import Approach, FlightPlan, MissionItem
from swarmctl.core.records import replace
from swarmctl.mavlink.dialects.ardupilot import HOME_PLACEHOLDER, RELATIVE, ArduPilot, modes
from swarmctl.mavlink.dialects.plan import (
    LAND,
    LAND_START,
    LOITER_TO_ALT,
    TAKEOFF,
    WAYPOINT,
    item_at,
    plane_approaches,
)

CLIMB_PITCH_DEG = 15.0
"""pitch of the take-off; ArduPlane's default is 4 degrees (`Plane::do_takeoff`)"""
BY_TANGENT = 1.0
"""param4 of LOITER_TO_ALT: the next leg begins where the vehicle leaves the circle"""
FIRST_TURN_TANGENT = math.tan(math.pi / 8.0)
"""tangent length per turn radius of the first turn; its angle is unknown, so 45 degrees are assumed"""
MIN_TURN_M, MAX_TURN_M = 1.0, 255.0
"""limits of the distance from a turn's begin to its waypoint: the field is one byte, and 0 means WP_RADIUS"""


class ArduPlane(ArduPilot):
    """Dialect of ArduPlane."""

    firmware = "ArduPlane"
    # GUIDED circles at the position and altitude where the mode was set, without a pilot's stick
    # (`ModeGuided::_enter`). LOITER changes to RTL after a loss of radio control; by default GUIDED stays.
    mode_names = modes("PLANE_MODE")
    # No mode lands at an arbitrary position: AUTO flies the landing of a mission.
    land_mode = "AUTO"
    land_command = int(mavlink.MAV_CMD_DO_LAND_START)
    # SPEED_TYPE_GROUNDSPEED would set the minimum ground speed (`Plane::do_change_speed`).
    speed_type = int(mavlink.SPEED_TYPE_AIRSPEED)
    first_seq = 1
    """AUTO resumes a mission at the item that was flown last"""
    arms_at_any_item = False
    """after a landing in AUTO, the current item is still the landing, and arming fails ("In landing
    sequence", `AP_Arming_Plane::pre_arm_checks`)"""

    def mission_items(self, plan: FlightPlan, start: LatLon | None = None) -> tuple[MissionItem, ...]:
        """Return home placeholder, take-off, waypoints, landing at the goal, and landing at home.

        Each landing begins with a DO_LAND_START. RTL leads to the landing nearest to home. A command to land
        leads to the landing nearest to the vehicle.
        """
        at_goal, at_home = plane_approaches(plan)
        # The vehicle climbs straight on and ignores the position of the item (`Plane::do_takeoff`).
        takeoff = MissionItem(TAKEOFF, RELATIVE, 0, 0, plan.takeoff_alt_m, param1=CLIMB_PITCH_DEG)
        return (
            HOME_PLACEHOLDER,
            takeoff,
            *_waypoints(plan),
            *_landing(at_goal),
            *_landing(at_home),
        )

    def as_stored(self, item: MissionItem) -> MissionItem:
        """Return an item as stored; of its parameters a waypoint keeps only param2 and param3, as bytes."""
        item = super().as_stored(item)
        if item.command != mavlink.MAV_CMD_NAV_WAYPOINT:
            return item
        radius_m, beyond_m = (float(min(max(int(p), 0), 255)) for p in (item.param2, item.param3))
        return replace(item, param1=0.0, param2=radius_m, param3=beyond_m, param4=0.0)


def _waypoints(plan: FlightPlan) -> Iterator[MissionItem]:
    """Yield the waypoints; a turn begins param2 [m] before its waypoint, for an arc inside the corner."""
    frame = LocalFrame(plan.track[0].lat_deg, plan.track[0].lon_deg)
    points = [frame.to_local(p.lat_deg, p.lon_deg) for p in plan.track]
    last = len(points) - 1
    for i, waypoint in enumerate(plan.track):
        turn_m = MIN_TURN_M
        if 0 < i < last:
            turn_m = tangent_length(points[i - 1], points[i], points[i + 1], plan.turn_radius_m)
        elif i < last:
            turn_m = FIRST_TURN_TANGENT * plan.turn_radius_m
        item = item_at(WAYPOINT, RELATIVE, waypoint, waypoint.alt_rel_m)
        yield replace(item, param2=float(math.ceil(min(max(turn_m, MIN_TURN_M), MAX_TURN_M))))


def _landing(approach: Approach) -> Iterator[MissionItem]:
    centre, final = approach.centre, approach.final
    yield item_at(LAND_START, RELATIVE, centre, centre.alt_rel_m)
    circle = item_at(LOITER_TO_ALT, RELATIVE, centre, centre.alt_rel_m)
    yield replace(circle, param2=float(round(approach.radius_m)), param4=BY_TANGENT)
    yield replace(item_at(WAYPOINT, RELATIVE, final, final.alt_rel_m), param2=MIN_TURN_M)
    yield item_at(LAND, RELATIVE, approach.touchdown, 0.0)
