"""Common parts of the approaches: a place without jumps, distances, and the wait for the slowest member.

A place jumps when the shape, the route or the leader changes, or when a message comes after a gap. The
member's demanded position does not: it keeps its distance from the place, and this distance shrinks at a
bounded speed and acceleration (`glide`). So one rule serves joining, new shapes, new routes and new leaders.
"""

from __future__ import annotations

import math

from swarmctl.agent.formation.approaches.base import (
    ACCELERATION_M_S2,
    CLIMB_M_S,
    Along,
    ApproachResult,
    Group,
    Nearby,
    PlaceMemory,
    SetPointDemand,
    Vector,
)
from swarmctl.agent.formation.reference import Pose, Reference
from swarmctl.agent.formation.ways import offset_of
from swarmctl.core.planar import by_heading
from swarmctl.core.records import replace

PAUSE_S = 1.5
"""Gap between two calls after which a member begins anew at its own position [s]."""
CLOSING_HZ = 0.5
"""Speed toward the place for each metre of distance [1/s]."""
POSITION_HZ = 0.95
"""Speed toward a demanded position for each metre of distance, as autopilots fly it [1/s] (PX4: MPC_XY_P)."""
APPROACH_HZ = 0.4
"""Greatest speed of approach for each metre that is left to the separation [1/s]."""
MARGIN_M, GROWTH_M_S = 1.0, 0.5
"""Distance beyond the separation at which an approach ends [m], and its growth with the age of a message."""
RESPONSE_S = 1.0
"""Time in which an autopilot takes a new velocity [s]: the present approach goes on for so long."""
MARGIN_UP_M = 0.5
"""The same in height [m]."""
TRUSTED_S, BRAKES_M_S2 = 0.6, 2.5
"""Age up to which a velocity counts [s]; a member that tells nothing for longer may brake so hard."""
STAYS_WITHIN_M = 3.0
"""Greatest distance of a member from its place at which it is expected to stay there [m]."""
OLDEST_S = 3.0
"""Greatest age by which the margin grows [s]."""
SIDEWAYS = 0.3
"""Speed to the right of another member for each m/s of approach that is taken away, so that two members
that meet pass each other."""
REACH_M = 30.0
"""Greatest distance along the route between a reference point and where it was expected [m]."""
FASTER = 1.5
"""Greatest progress along the route, in units of the flown distance."""
_PASSES = 5


def reference_now(group: Group) -> Along:
    """Return the reference point at `now_s`, predicted along the route from what was told."""
    if group.along is None:
        s_m = group.reference.locate(group.position_m[:2])
        return Along(s_m, 0.0)
    s_m, speed_m_s = group.profile.ahead(group.along.s_m, group.along.speed_m_s, group.along.age_s)
    return Along(s_m, speed_m_s)


def on_new_route(along: Along, before: Reference, after: Reference) -> Along:
    """Return a reference point of one route for another route, at the nearest place there."""
    pose = before.at(along.s_m)
    return replace(along, s_m=after.locate((pose.east_m, pose.north_m)))


def place_of(
    group: Group, pose: Pose, point: tuple[float, float], velocity: tuple[float, float], speed_m_s: float
) -> tuple[Vector, Vector]:
    """Return position and velocity of the member's place in a shape at `point` that moves at `velocity`."""
    away, moves = offset_of(pose, group.place, group.way, speed_m_s)
    return (
        (point[0] + away[0], point[1] + away[1], group.height_m + group.place[2]),
        (velocity[0] + moves[0], velocity[1] + moves[1], 0.0),
    )


def keep_place(
    group: Group, pose: Pose, along: Along, place_m: Vector, velocity_m_s: Vector, closing_m_s: float
) -> ApproachResult:
    """Return the set-point of a member that flies to its place and stays there."""
    position, wanted = glide(group, place_m, velocity_m_s, closing_m_s)
    flown = bounded(wanted, group.speed_m_s)
    own = group.position_m
    pull = [POSITION_HZ * (position[k] - own[k]) for k in range(3)]
    east, north, _ = bounded((flown[0] + pull[0], flown[1] + pull[1], 0.0), group.speed_m_s)
    climb = min(max(flown[2] + pull[2], -CLIMB_M_S), CLIMB_M_S)
    demand = SetPointDemand(flown, position)
    if (safe := keep_separation(group, (east, north, climb))) is not None:
        demand, position, flown = SetPointDemand(safe), own, safe
    memory = PlaceMemory(group.now_s, place_m, velocity_m_s, position, flown, along)
    return ApproachResult(demand, error_of(group, pose, place_m), memory)


def glide(group: Group, place_m: Vector, velocity_m_s: Vector, closing_m_s: float) -> tuple[Vector, Vector]:
    """Return the demanded position and its velocity [m], [m/s]: its distance from the place shrinks."""
    memory = group.memory
    dt = 0.0 if memory is None else group.now_s - memory.now_s
    if memory is None or not 0.0 <= dt <= PAUSE_S:
        east, north, climb = group.velocity_m_s
        return group.position_m, (east, north, min(max(climb, -CLIMB_M_S), CLIMB_M_S))
    before, moved, half = memory.demanded_m, memory.velocity_m_s, 0.5 * dt
    # The demanded position moves on with the place, by the place's own velocity: a jump of the place remains.
    offset_e = before[0] + half * (moved[0] + velocity_m_s[0]) - place_m[0]
    offset_n = before[1] + half * (moved[1] + velocity_m_s[1]) - place_m[1]
    offset_u = before[2] - place_m[2]
    rate_e, rate_n = memory.demanded_m_s[0] - moved[0], memory.demanded_m_s[1] - moved[1]
    away = math.hypot(offset_e, offset_n)
    # Half of the acceleration brakes, so that the rate can follow.
    back = _closing(away, closing_m_s, ACCELERATION_M_S2) / away if away > 1e-9 else 0.0
    change_e, change_n = -back * offset_e - rate_e, -back * offset_n - rate_n
    size, most = math.hypot(change_e, change_n), ACCELERATION_M_S2 * dt
    share = most / size if size > most else 1.0
    rate_e, rate_n = rate_e + share * change_e, rate_n + share * change_n
    rate_u = -math.copysign(_closing(abs(offset_u), CLIMB_M_S, CLIMB_M_S), offset_u)
    offset = offset_e + rate_e * dt, offset_n + rate_n * dt, offset_u + rate_u * dt
    return (
        (place_m[0] + offset[0], place_m[1] + offset[1], place_m[2] + offset[2]),
        (velocity_m_s[0] + rate_e, velocity_m_s[1] + rate_n, rate_u),
    )


def _closing(away_m: float, fastest_m_s: float, acceleration_m_s2: float) -> float:
    return min(fastest_m_s, CLOSING_HZ * away_m, math.sqrt(acceleration_m_s2 * away_m))


def keep_separation(group: Group, velocity: Vector) -> Vector | None:
    """Return a velocity that brings the member too near to no other vehicle; None if `velocity` does so.

    A member may approach another one by `APPROACH_HZ` of the distance that is left to the separation, so
    the approach ends there, and no faster than it can stop if both brake at any time. A member within the
    separation moves away. This holds over ground while the heights are within the vertical separation, and
    in height while the distance is within the horizontal one, or will be before the member has braked.
    """
    limits, own = group.limits, group.position_m
    near, climb = [], velocity[2]
    least_m = limits.horizontal_m + MARGIN_M
    reach_m = least_m + GROWTH_M_S * OLDEST_S + 2.0 * group.speed_m_s / APPROACH_HZ
    for member in (*group.others, *_silent_by_plan(group), *group.obstacles):
        age_s, (their_e, their_n, their_u) = member.age_s, member.velocity_m_s
        moved_s, left = _if_braking(member)
        away_e = own[0] - member.position_m[0] - moved_s * their_e
        away_n = own[1] - member.position_m[1] - moved_s * their_n
        their_e, their_n = left * their_e, left * their_n
        away_m = math.hypot(away_e, away_n)
        if away_m > reach_m:
            continue
        if away_m < 1e-6:
            away_e, away_n, away_m = 1.0, 0.0, 1.0
        left_m = away_m - least_m - GROWTH_M_S * min(age_s, OLDEST_S)
        unit_e, unit_n = away_e / away_m, away_n / away_m
        theirs = their_e * unit_e + their_n * unit_n
        closing = theirs - group.velocity_m_s[0] * unit_e - group.velocity_m_s[1] * unit_n
        left_m -= RESPONSE_S * max(closing, 0.0)
        up_m = own[2] - member.position_m[2] - age_s * their_u
        if abs(up_m) >= limits.vertical_m:
            if left_m < max(closing, 0.0) ** 2 / (2.0 * ACCELERATION_M_S2):
                above = math.copysign(1.0, up_m)
                height_left_m = abs(up_m) - limits.vertical_m - MARGIN_UP_M
                climb = above * max(above * climb, above * their_u - APPROACH_HZ * height_left_m)
            continue
        stops_m_s = math.sqrt(min(theirs, 0.0) ** 2 + 2.0 * ACCELERATION_M_S2 * max(left_m, 0.0))
        near.append((-left_m, unit_e, unit_n, max(theirs - APPROACH_HZ * left_m, -stops_m_s)))
    east, north = velocity[0], velocity[1]
    is_changed = abs(climb - velocity[2]) > 1e-3
    near.sort()  # the nearest member last, so that it decides if no velocity suits all
    for sideways in (SIDEWAYS, *(0.0,) * _PASSES):
        is_clear = True
        for _, unit_e, unit_n, least_speed in near:
            short = least_speed - (east * unit_e + north * unit_n)
            if short > 1e-3:
                is_clear, is_changed = False, True
                side = sideways * short
                east += short * unit_e + side * -unit_n
                north += short * unit_n + side * unit_e
        if is_clear:
            break
    if not is_changed:
        return None
    climb = min(max(climb, -CLIMB_M_S), CLIMB_M_S)
    return bounded((east, north, climb), group.speed_m_s)


def _silent_by_plan(group: Group) -> list[Nearby]:
    """Return the present positions of members that have told nothing for TRUSTED_S, but keep their places.

    In a turn of the route they are not straight ahead of their last position.
    """
    silent = [m for m in group.others if m.age_s > TRUSTED_S and m.error_m <= STAYS_WITHIN_M]
    if not silent:
        return []
    now, found = reference_now(group), []
    pose = group.reference.at(now.s_m)
    for member in silent:
        then = group.reference.at(max(now.s_m - member.age_s * now.speed_m_s, 0.0))
        (before_e, before_n), _ = offset_of(then, member.place, member.way)
        (away_e, away_n), (moves_e, moves_n) = offset_of(pose, member.place, member.way, now.speed_m_s)
        east_m = member.position_m[0] + pose.east_m + away_e - then.east_m - before_e
        north_m = member.position_m[1] + pose.north_m + away_n - then.north_m - before_n
        velocity = now.speed_m_s * pose.slope_east + moves_e, now.speed_m_s * pose.slope_north + moves_n, 0.0
        found.append(Nearby((east_m, north_m, member.position_m[2]), velocity))
    return found


def _if_braking(other: Nearby) -> tuple[float, float]:
    """Return the way of another vehicle since its message, as time at its speed [s], and the share of its
    speed that is left, if it brakes from TRUSTED_S on."""
    speed_m_s, braking_s = math.hypot(*other.velocity_m_s[:2]), max(other.age_s - TRUSTED_S, 0.0)
    if not speed_m_s or not braking_s:
        return other.age_s, 1.0
    braking_s = min(braking_s, speed_m_s / BRAKES_M_S2)
    left = 1.0 - BRAKES_M_S2 * braking_s / speed_m_s
    return TRUSTED_S + 0.5 * (1.0 + left) * braking_s, left


def progress(group: Group, expected_m: float, point: tuple[float, float]) -> float:
    """Return the distance along the route of a reference point that moves by itself [m].

    It is the place nearest to the point, but neither goes back nor jumps, as the nearest place does inside of
    a corner. Where the curve turns back on itself the nearest place stands still, so there the distance grows
    by the profile's speed.
    """
    s_m = group.reference.project(point, expected_m, REACH_M)
    if (memory := group.memory) is None:
        return s_m
    dt, before_m = min(max(group.now_s - memory.now_s, 0.0), PAUSE_S), memory.along.s_m
    pose = group.reference.at(before_m)
    step_m = dt * group.profile.at(before_m)
    standing = 1.0 - min(math.hypot(pose.slope_east, pose.slope_north), 1.0)
    most_m = FASTER * max(step_m, dt * math.hypot(group.velocity_m_s[0], group.velocity_m_s[1]))
    return min(max(s_m, before_m + standing * step_m), before_m + most_m, group.reference.length_m)


def error_of(group: Group, pose: Pose, place_m: Vector) -> Vector:
    """Return the member's position minus its place: forward, right, up [m]."""
    east, north, up = (own - place for own, place in zip(group.position_m, place_m, strict=True))
    return *by_heading((east, north), pose.heading_rad), up


def bounded(velocity: Vector, speed_m_s: float) -> Vector:
    """Return the velocity with at most this speed over ground, in the same direction."""
    size = math.hypot(velocity[0], velocity[1])
    if size <= speed_m_s:
        return velocity
    share = speed_m_s / size
    return velocity[0] * share, velocity[1] * share, velocity[2]
