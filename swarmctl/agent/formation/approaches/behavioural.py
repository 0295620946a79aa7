"""Behavioural approach: a member's velocity is made of four behaviours, without a leader.

| behaviour | velocity |
|---|---|
| collision avoidance | away from near members |
| threat avoidance | down the gradient of P_s, but never back along the route |
| formation keeping | toward the place relative to the members' common reference, and its turn |
| goal seeking | along the route, and back to it |

The weighted sum follows Balch and Arkin, "Behavior-based formation control for multirobot teams", IEEE
Transactions on Robotics and Automation 14 (1998): motor schemas, with the unit centre as the reference.
With `null_space` each behaviour acts only across the directions of the more important ones, after Antonelli,
Arrichiello and Chiaverini, "The null-space-based behavioral control for autonomous robotic systems",
Intelligent Service Robotics 1 (2008). There each task is one direction: n, with its velocity along n. The
projection fades in with the task, so the velocity has no jump where a task begins.

Both end with `place_keeping.keep_separation`: no weight brings two members nearer than the separation.
"""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from swarmctl.agent.formation.approaches.base import (
    ACCELERATION_M_S2,
    CLIMB_M_S,
    Along,
    ApproachResult,
    Group,
    PlaceMemory,
    SetPointDemand,
    ThreatField,
)
from swarmctl.agent.formation.approaches.place_keeping import (
    bounded,
    error_of,
    keep_separation,
    place_of,
    progress,
)
from swarmctl.agent.formation.reference import Pose
from swarmctl.agent.formation.ways import offset_of
from swarmctl.core.section import Section

LEADER_FLIES_MISSION = False
MEMBERS_TELL_HZ = 5.0
WEIGHTS = ("goal", "formation", "threat", "collision")
BACK_TO_ROUTE_HZ, BACK_TO_ROUTE_M_S = 0.2, 3.0
"""Speed of the common reference back to the route for each metre of distance [1/s], and its limit."""
FORMATION_HZ = 0.5
"""Speed toward the place for each metre of distance [1/s]."""
ACTIVE_FORMATION_M = 2.0
"""Distance from the place at which formation keeping has its full priority [m]."""

GREATEST_EXPOSURE = 10.0
"""Greatest P_s in a gradient: a wall is infinite."""

Planar = tuple[float, float]


class Params(Section):
    """Weights and parameters of the behaviours."""

    goal_weight: Annotated[float, Field(ge=0)] = 1.0
    """weight of goal seeking"""
    formation_weight: Annotated[float, Field(ge=0)] = 1.0
    """weight of formation keeping"""
    threat_weight: Annotated[float, Field(ge=0)] = 0.5
    """weight of threat avoidance"""
    collision_weight: Annotated[float, Field(ge=0)] = 1.0
    """weight of collision avoidance"""
    null_space: bool = False
    """collision avoidance before threat avoidance, formation keeping and goal seeking, each across the
    directions of those before it; False: the weighted sum"""
    closing_m_s: Annotated[float, Field(gt=0)] = 3.0
    """greatest speed toward the place [m/s]"""
    threat_m_s: Annotated[float, Field(gt=0)] = 3.0
    """greatest speed away from threats [m/s]"""
    threat_step: Annotated[float, Field(gt=0)] = 0.2
    """difference of P_s between two cells at which threat avoidance has its greatest speed"""
    collision_m_s: Annotated[float, Field(gt=0)] = 4.0
    """greatest speed away from another member, at the separation [m/s]"""
    near_separations: Annotated[float, Field(gt=1)] = 2.0
    """distance at which collision avoidance begins, in units of the separation"""


def fly(params: Params, group: Group) -> ApproachResult:
    """Return the velocity of a member."""
    along, pose, centre = _common_reference(group)
    goal = _goal(pose, centre, along.speed_m_s)
    place_m, moving = place_of(group, pose, centre, goal, along.speed_m_s)
    turning = (moving[0] - goal[0], moving[1] - goal[1])
    own = group.position_m
    error = (place_m[0] - own[0], place_m[1] - own[1])
    error_m = math.hypot(*error)
    pull = min(FORMATION_HZ * error_m, params.closing_m_s) / error_m if error_m > 1e-9 else 0.0
    keeping = (pull * error[0] + turning[0], pull * error[1] + turning[1])
    threat = _threat(params, group, pose)
    collision, their = _collision(params, group)
    weights = (params.goal_weight, params.formation_weight, params.threat_weight, params.collision_weight)
    weighted = [
        (weight * behaviour[0], weight * behaviour[1])
        for weight, behaviour in zip(weights, (goal, keeping, threat, collision), strict=True)
    ]
    if params.null_space:
        velocity = _projected(params, weighted, error_m, their)
    else:
        velocity = (sum(v[0] for v in weighted), sum(v[1] for v in weighted))
    climb = min(max(place_m[2] - own[2], -CLIMB_M_S), CLIMB_M_S)
    wanted = _steady(group, bounded((*velocity, climb), group.speed_m_s))
    safe = keep_separation(group, wanted) or wanted
    memory = PlaceMemory(group.now_s, place_m, moving, own, safe, along)
    return ApproachResult(SetPointDemand(safe), error_of(group, pose, place_m), memory)


def _common_reference(group: Group) -> tuple[Along, Pose, Planar]:
    """Return distance and pose of the members' common reference, and its position (east, north) [m].

    The position is the mean of the reference points that the members' positions and places give.
    """
    memory = group.memory
    if memory is not None:
        dt = min(max(group.now_s - memory.now_s, 0.0), 1.0)
        expected_m = memory.along.s_m + dt * group.profile.at(memory.along.s_m)
    elif group.along is not None:
        expected_m, _ = group.profile.ahead(group.along.s_m, group.along.speed_m_s, group.along.age_s)
    else:
        expected_m = group.reference.locate(group.position_m[:2])
    pose = group.reference.at(expected_m)
    (away_e, away_n), _ = offset_of(pose, group.place, group.way)
    east, north = group.position_m[0] - away_e, group.position_m[1] - away_n
    for member in group.others:
        (their_e, their_n, _), (velocity_e, velocity_n, _) = member.position_m, member.velocity_m_s
        (away_e, away_n), _ = offset_of(pose, member.place, member.way)
        east += their_e + member.age_s * velocity_e - away_e
        north += their_n + member.age_s * velocity_n - away_n
    n = 1 + len(group.others)
    centre = (east / n, north / n)
    s_m = progress(group, expected_m, centre)
    return Along(s_m, group.profile.at(s_m)), group.reference.at(s_m), centre


def _goal(pose: Pose, centre: Planar, speed_m_s: float) -> Planar:
    """Return the velocity along the route, with the way back to the route."""
    away_e, away_n = pose.east_m - centre[0], pose.north_m - centre[1]
    away_m = math.hypot(away_e, away_n)
    back = min(BACK_TO_ROUTE_HZ, BACK_TO_ROUTE_M_S / away_m) if away_m > 1e-9 else 0.0
    return (
        speed_m_s * pose.slope_east + back * away_e,
        speed_m_s * pose.slope_north + back * away_n,
    )


def _threat(params: Params, group: Group, pose: Pose) -> Planar:
    """Return the velocity down the gradient of P_s, without a part back along the route.

    The plan has compared the exposure of all ways. Against the route, threats could stop a group for ever.
    """
    if group.threats is None or not params.threat_weight:
        return 0.0, 0.0
    east, north = gradient(group.threats, group.position_m[0], group.position_m[1])
    steep = math.hypot(east, north)  # difference of P_s from cell to cell
    if steep < 1e-9:
        return 0.0, 0.0
    speed = params.threat_m_s * min(1.0, steep / params.threat_step)
    away = -speed * east / steep, -speed * north / steep
    slope = math.hypot(pose.slope_east, pose.slope_north) or 1.0
    along = (pose.slope_east / slope, pose.slope_north / slope)
    back = min(away[0] * along[0] + away[1] * along[1], 0.0)
    return away[0] - back * along[0], away[1] - back * along[1]


def gradient(threats: ThreatField, east_m: float, north_m: float) -> Planar:
    """Return the change of P_s for a cell to the east and to the north, continuous over the area."""
    rows, cols = threats.exposure.shape
    col, row = east_m / threats.cell_m - 0.5, north_m / threats.cell_m - 0.5

    def value(r: int, c: int) -> float:
        here = threats.exposure[min(max(r, 0), rows - 1), min(max(c, 0), cols - 1)]
        return min(float(here), GREATEST_EXPOSURE)

    c0, r0 = math.floor(col), math.floor(row)
    x, y = col - c0, row - r0
    # Central differences in the four cells around, and between them evenly by distance.
    east = north = 0.0
    for r, c, share in (
        (r0, c0, (1 - x) * (1 - y)),
        (r0, c0 + 1, x * (1 - y)),
        (r0 + 1, c0, (1 - x) * y),
        (r0 + 1, c0 + 1, x * y),
    ):
        east += share * 0.5 * (value(r, c + 1) - value(r, c - 1))
        north += share * 0.5 * (value(r + 1, c) - value(r - 1, c))
    return east, north


def _collision(params: Params, group: Group) -> tuple[Planar, tuple[float, float, float, Planar] | None]:
    """Return the velocity away from near members, and of the nearest one: direction away (east, north),
    priority from 0 to 1, and its velocity."""
    limits, own = group.limits, group.position_m
    begins_m = params.near_separations * limits.horizontal_m
    away = [0.0, 0.0]
    nearest, nearest_m = None, begins_m
    for member in group.others:
        (their_e, their_n, their_u), (moves_e, moves_n, _) = member.position_m, member.velocity_m_s
        east = own[0] - their_e - member.age_s * moves_e
        north = own[1] - their_n - member.age_s * moves_n
        away_m = math.hypot(east, north)
        if away_m >= begins_m or away_m < 1e-6 or abs(own[2] - their_u) >= limits.vertical_m:
            continue
        share = min((begins_m - away_m) / (begins_m - limits.horizontal_m), 1.0)
        speed = params.collision_m_s * share / away_m
        away[0] += speed * east
        away[1] += speed * north
        if away_m < nearest_m:
            nearest_m, nearest = away_m, (east / away_m, north / away_m, share, (moves_e, moves_n))
    return (away[0], away[1]), nearest


def _projected(
    params: Params,
    weighted: list[Planar],
    error_m: float,
    nearest: tuple[float, float, float, Planar] | None,
) -> Planar:
    """Return v₁ + N₁(v₂ + N₂(v₃ + N₃v₄)) with N = I − a·n·nᵀ and the priority a of a task from 0 to 1.

    The velocity of a task that moves along with the group has a part of the goal's velocity along n, so the
    group goes on while its members keep their places.
    """
    goal, keeping, threat, collision = weighted
    size = math.hypot(*keeping)
    unit = (keeping[0] / size, keeping[1] / size) if size > 1e-9 else (0.0, 0.0)
    ahead = goal[0] * unit[0] + goal[1] * unit[1]
    priority = min(error_m / ACTIVE_FORMATION_M, 1.0)
    kept = priority * ahead
    east, north = _across(goal, unit, priority)
    east, north = east + keeping[0] + kept * unit[0], north + keeping[1] + kept * unit[1]
    size = math.hypot(*threat)
    if size > 1e-9:
        unit = (threat[0] / size, threat[1] / size)
        priority = min(size / params.threat_m_s, 1.0)
        # Only what goes up the gradient is taken away: to leave a threat faster is no conflict.
        toward = east * unit[0] + north * unit[1]
        if toward < 0.0:
            east, north = _across((east, north), unit, priority)
        east, north = east + threat[0], north + threat[1]
    if nearest is not None:
        unit_e, unit_n, priority, (moves_e, moves_n) = nearest
        toward = (east - moves_e) * unit_e + (north - moves_n) * unit_n
        if toward < 0.0:
            east, north = east - priority * toward * unit_e, north - priority * toward * unit_n
        east, north = east + collision[0], north + collision[1]
    return east, north


def _across(velocity: Planar, unit: Planar, priority: float) -> Planar:
    along = priority * (velocity[0] * unit[0] + velocity[1] * unit[1])
    return velocity[0] - along * unit[0], velocity[1] - along * unit[1]


def _steady(group: Group, wanted: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return the wanted velocity, within the acceleration from the velocity demanded before."""
    memory = group.memory
    before = group.velocity_m_s if memory is None else memory.demanded_m_s
    dt = 0.1 if memory is None else min(max(group.now_s - memory.now_s, 0.0), 1.0)
    east, north, _ = bounded(
        (wanted[0] - before[0], wanted[1] - before[1], 0.0), 2.0 * ACCELERATION_M_S2 * dt
    )
    return before[0] + east, before[1] + north, wanted[2]
