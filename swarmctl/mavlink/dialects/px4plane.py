"""PX4 1.14 to 1.16, fixed wings.

Facts read in PX4's sources: `navigator/` (mission, rtl, feasibility checks), `mavlink/mavlink_mission.cpp`,
`fw_pos_control/`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.geo import LatLon, LocalFrame
from swarmctl.core.mission import Approach, FlightPlan, MissionItem, Waypoint
from swarmctl.core.records import replace
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

NO_POSITION_FRAME = int(mavlink.MAV_FRAME_MISSION)
"""frame of items without a position; PX4 refuses such items in any other frame"""
BY_HEADING, BY_TANGENT = 1.0, 1.0
"""param1 and param4 of LOITER_TO_ALT: leave the circle towards the next item, along the tangent"""
JUMP_REPEATS = 1000.0
"""number of repeats of a jump; PX4 counts repeats across flights and uploads of the same mission"""
BEYOND_M = 30.0
"""Distance of the last waypoint beyond the goal, so that the vehicle overflies the goal. PX4 turns before it
reaches a waypoint, at a distance that grows with speed (`NPFG::switchDistance`, 34 m at 15 m/s)."""


class Px4Plane(Px4):
    """Dialect of PX4 fixed wings."""

    firmware = "PX4 plane"
    # AUTO.LAND circles down wherever the vehicle is; AUTO.MISSION flies the landing of a mission.
    land_mode = "AUTO.MISSION"
    land_command = int(mavlink.MAV_CMD_DO_LAND_START)
    lands_at_nearest = False
    speed_type = int(mavlink.SPEED_TYPE_AIRSPEED)

    def mission_items(self, plan: FlightPlan, start: LatLon | None = None) -> tuple[MissionItem, ...]:
        """Return take-off, waypoints, a jump over the landing at home, that landing, and the goal's landing.

        A mission may have only one DO_LAND_START. A return (RTL_TYPE 1) leads to the first landing, so home's
        landing comes before the goal's. All landings come after the waypoints: PX4 1.14 treats all items
        after DO_LAND_START as the landing, so a return would also fly waypoints there.

        After a landing PX4 continues with the next item, even on the ground, and does not disarm in mission
        mode (`MissionBase::advance_mission`, `Commander::handleAutoDisarm`). So a jump leads from home's
        landing to the last NAV_LAND. A vehicle on the ground completes this item at once.
        """
        at_goal, at_home = plane_approaches(plan)
        # The vehicle climbs along the line to the take-off item's position.
        takeoff = item_at(TAKEOFF, RELATIVE, plan.track[0], plan.takeoff_alt_m)
        waypoints = [item_at(WAYPOINT, RELATIVE, point, point.alt_rel_m) for point in _waypoints(plan)]
        home = list(_landing(at_home))
        jump_at = 1 + len(waypoints)
        goal = list(_landing(at_goal))
        goal_at = jump_at + 3 + len(home)
        return (
            takeoff,
            *waypoints,
            _jump(goal_at),
            MissionItem(LAND_START, NO_POSITION_FRAME, 0, 0, 0.0),
            *home,
            _jump(goal_at + len(goal) - 1),
            *goal,
        )


def _jump(target: int) -> MissionItem:
    return MissionItem(JUMP, NO_POSITION_FRAME, 0, 0, 0.0, param1=float(target), param2=JUMP_REPEATS)


def _waypoints(plan: FlightPlan) -> Iterator[Waypoint]:
    yield from plan.track[:-1]
    yield _beyond(plan)


def _beyond(plan: FlightPlan) -> Waypoint:
    """Return the last waypoint, moved forward along its leg by BEYOND_M."""
    goal, waypoints = plan.track[-1], plan.waypoints
    if len(waypoints) < 2:
        return goal
    frame = LocalFrame(goal.lat_deg, goal.lon_deg)
    east_m, north_m = frame.to_local(waypoints[-2].lat_deg, waypoints[-2].lon_deg)
    leg_m = math.hypot(east_m, north_m)
    if leg_m < 1.0:
        return goal
    scale = -BEYOND_M / leg_m
    return Waypoint(*frame.to_geodetic(scale * east_m, scale * north_m), goal.alt_rel_m)


def _landing(approach: Approach) -> Iterator[MissionItem]:
    """Yield circle and landing; the vehicle glides from the point where it leaves the circle.

    With a waypoint between circle and landing the vehicle would not leave the circle at the circle's altitude
    (NAV_FW_ALTL_RAD applies only directly before a landing).
    """
    circle = item_at(LOITER_TO_ALT, RELATIVE, approach.centre, approach.centre.alt_rel_m)
    yield replace(circle, param1=BY_HEADING, param2=float(round(approach.radius_m)), param4=BY_TANGENT)
    yield item_at(LAND, RELATIVE, approach.touchdown, 0.0)
