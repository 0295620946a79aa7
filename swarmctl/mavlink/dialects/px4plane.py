"""PX4 1.14 to 1.16, fixed wings. Facts read in its sources: `navigator/` (mission, rtl, feasibility checks),
`mavlink/mavlink_mission.cpp`, `fw_pos_control/`."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.geo import LatLon, LocalFrame
from swarmctl.core.mission import Approach, FlightPlan, MissionItem, Waypoint
from swarmctl.mavlink.dialects.plan import (
    JUMP,
    LAND,
    LAND_START,
    LOITER_TO_ALT,
    TAKEOFF,
    WAYPOINT,
    item_at,
    plane_approaches,
)
from swarmctl.mavlink.dialects.px4 import RELATIVE, Px4

NO_PLACE = int(mavlink.MAV_FRAME_MISSION)
"""the frame of what has no place; in another it is refused"""
BY_HEADING, BY_TANGENT = 1.0, 1.0
"""param1 and param4 of LOITER_TO_ALT: left only when it heads for what comes next, and along the tangent"""
ALWAYS = 1000.0
"""So often a jump is taken. How often it was outlives a flight, and the same mission again is no new one."""
BEYOND_M = 30.0
"""It turns to what comes next so far before a waypoint, and farther the faster: by what its guidance needs
(`NPFG::switchDistance`, 34 m at 15 m/s). The goal is to be flown over, so its waypoint lies behind it."""


class Px4Plane(Px4):
    """Fits `Dialect`."""

    # AUTO.LAND comes down in a circle wherever it is: a mission has to say how, and AUTO.MISSION flies that.
    land_mode = "AUTO.MISSION"
    land_command = int(mavlink.MAV_CMD_DO_LAND_START)
    lands_at_nearest = False
    speed_type = int(mavlink.SPEED_TYPE_AIRSPEED)

    def mission_items(self, plan: FlightPlan, start: LatLon | None = None) -> tuple[MissionItem, ...]:
        """Take-off, waypoints, a jump over the landing at home, that, and the landing at the goal.

        One DO_LAND_START is allowed in a mission, and the first landing of the list is the one that it
        returns to (RTL_TYPE 1), so home's is. It stands behind the waypoints because 1.14 takes all that
        comes after DO_LAND_START for the landing, and would fly on instead of returning.

        Who has landed amid its mission goes on with the next item, on the ground too, and in the mission's
        mode it is not disarmed (`MissionBase::advance_mission`, `Commander::handleAutoDisarm`): from home's
        landing a jump leads to the last item, a landing, with which one that stands is done at once.
        """
        at_goal, at_home = plane_approaches(plan)
        # It climbs out along the line to the take-off's place.
        toward = plan.track[0]
        takeoff = item_at(TAKEOFF, RELATIVE, toward, plan.takeoff_alt_m)
        waypoints = [item_at(WAYPOINT, RELATIVE, point, point.alt_rel_m) for point in _flown(plan)]
        home = list(_landing(at_home))
        jump_at = 1 + len(waypoints)
        goal = list(_landing(at_goal))
        goal_at = jump_at + 3 + len(home)
        return (
            takeoff,
            *waypoints,
            _jump(goal_at),
            MissionItem(LAND_START, NO_PLACE, 0, 0, 0.0),
            *home,
            _jump(goal_at + len(goal) - 1),
            *goal,
        )


def _jump(to: int) -> MissionItem:
    return MissionItem(JUMP, NO_PLACE, 0, 0, 0.0, param1=float(to), param2=ALWAYS)


def _flown(plan: FlightPlan) -> Iterator[Waypoint]:
    yield from plan.track[:-1]
    yield _beyond(plan)


def _beyond(plan: FlightPlan) -> Waypoint:
    """The last waypoint, moved on along its leg."""
    goal, way = plan.track[-1], plan.waypoints
    if len(way) < 2:
        return goal
    frame = LocalFrame(goal.lat_deg, goal.lon_deg)
    east_m, north_m = frame.to_local(way[-2].lat_deg, way[-2].lon_deg)
    leg_m = math.hypot(east_m, north_m)
    if leg_m < 1.0:
        return goal
    on = -BEYOND_M / leg_m
    return Waypoint(*frame.to_geodetic(on * east_m, on * north_m), goal.alt_rel_m)


def _landing(there: Approach) -> Iterator[MissionItem]:
    """It glides from where it leaves the circle: a waypoint between would keep it from leaving that at its
    height (NAV_FW_ALTL_RAD counts right before a landing)."""
    circle = item_at(LOITER_TO_ALT, RELATIVE, there.centre, there.centre.alt_rel_m)
    yield replace(circle, param1=BY_HEADING, param2=float(round(there.radius_m)), param4=BY_TANGENT)
    yield item_at(LAND, RELATIVE, there.touchdown, 0.0)
