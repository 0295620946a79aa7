"""ArduPlane 4.x, fixed wings. Facts read in its sources (`ArduPlane/`, `libraries/AP_Mission/`)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.any_angle.turns import tangent
from swarmctl.core.geo import LatLon, LocalFrame
from swarmctl.core.mission import Approach, FlightPlan, MissionItem
from swarmctl.mavlink.dialects.ardupilot import HOME, RELATIVE, ArduPilot, modes
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
"""of the take-off; without it 4 degrees are taken (`Plane::do_takeoff`)"""
BY_TANGENT = 1.0
"""param4 of LOITER_TO_ALT: the next leg begins where the circle is left"""
FIRST_TURN = math.tan(math.pi / 8.0)
"""of a turn by 45 degrees: from where it comes to its first waypoint is not known"""
LEAST_TURN_M, MOST_TURN_M = 1.0, 255.0
"""how far before a waypoint it may be told to turn off: a byte, of which 0 is WP_RADIUS"""


class ArduPlane(ArduPilot):
    """Fits `Dialect`."""

    # GUIDED circles where it was entered, at that altitude, with nobody at a stick (`ModeGuided::_enter`).
    # LOITER does so too, but is left for RTL when the radio control is lost, which GUIDED is not by default.
    mode_names = modes("PLANE_MODE")
    # There is no mode that lands anywhere: a mission has to say how, and AUTO flies that.
    land_mode = "AUTO"
    land_command = int(mavlink.MAV_CMD_DO_LAND_START)
    # SPEED_TYPE_GROUNDSPEED would set the least speed over ground (`Plane::do_change_speed`).
    speed_type = int(mavlink.SPEED_TYPE_AIRSPEED)
    first_seq = 1
    """AUTO goes on where the mission was left"""
    arms_anywhere = False
    """Disarmed in AUTO it stays in its landing ("In landing sequence", `AP_Arming_Plane::pre_arm_checks`)."""

    def mission_items(self, plan: FlightPlan, start: LatLon | None = None) -> tuple[MissionItem, ...]:
        """Home placeholder, take-off, waypoints, the landing at the goal, and that at home.

        The last is flown only when it returns: RTL looks for the DO_LAND_START that is nearest to home. As
        each landing begins with one, an order to land leads to that which is nearest to the vehicle.
        """
        at_goal, at_home = plane_approaches(plan)
        # It climbs straight on whatever the place says (`Plane::do_takeoff`).
        takeoff = MissionItem(TAKEOFF, RELATIVE, 0, 0, plan.takeoff_alt_m, param1=CLIMB_PITCH_DEG)
        return (
            HOME,
            takeoff,
            *_waypoints(plan),
            *_landing(at_goal),
            *_landing(at_home),
        )

    def as_stored(self, item: MissionItem) -> MissionItem:
        """Of the parameters of a waypoint bytes of param2 and param3 are kept, its radii."""
        item = super().as_stored(item)
        if item.command != mavlink.MAV_CMD_NAV_WAYPOINT:
            return item
        radius_m, beyond_m = (float(min(max(int(p), 0), 255)) for p in (item.param2, item.param3))
        return replace(item, param1=0.0, param2=radius_m, param3=beyond_m, param4=0.0)


def _waypoints(plan: FlightPlan) -> Iterator[MissionItem]:
    """Each with how far before it the turn begins (param2), so that it is an arc inside the corner."""
    frame = LocalFrame(plan.track[0].lat_deg, plan.track[0].lon_deg)
    points = [frame.to_local(p.lat_deg, p.lon_deg) for p in plan.track]
    last = len(points) - 1
    for i, waypoint in enumerate(plan.track):
        turn_m = LEAST_TURN_M
        if 0 < i < last:
            turn_m = tangent(points[i - 1], points[i], points[i + 1], plan.turn_radius_m)
        elif i < last:
            turn_m = FIRST_TURN * plan.turn_radius_m
        item = item_at(WAYPOINT, RELATIVE, waypoint, waypoint.alt_rel_m)
        yield replace(item, param2=float(math.ceil(min(max(turn_m, LEAST_TURN_M), MOST_TURN_M))))


def _landing(there: Approach) -> Iterator[MissionItem]:
    yield item_at(LAND_START, RELATIVE, there.centre, there.centre.alt_rel_m)
    circle = item_at(LOITER_TO_ALT, RELATIVE, there.centre, there.centre.alt_rel_m)
    yield replace(circle, param2=float(round(there.radius_m)), param4=BY_TANGENT)
    yield replace(item_at(WAYPOINT, RELATIVE, there.final, there.final.alt_rel_m), param2=LEAST_TURN_M)
    yield item_at(LAND, RELATIVE, there.touchdown, 0.0)
