"""Leader following: the others keep their places relative to the leader, which flies its mission first.

A leader whose vehicle stops for new missions flies new routes by set-points (`group_plan.plan_of_leader`).

A follower predicts the leader along the leader's route from what it told: position, velocity, and its
distance along the route. Velocity and turn of the leader are fed forward. The leader is slowed for turns and
for a follower that is far behind.
"""

from __future__ import annotations

import math

from swarmctl.agent.formation.approaches import virtual_structure
from swarmctl.agent.formation.approaches.base import Along, ApproachResult, Group, PlaceMemory
from swarmctl.agent.formation.approaches.place_keeping import keep_place, place_of, progress, reference_now
from swarmctl.agent.formation.approaches.virtual_structure import LeastSpeedShare, SlowsFrom, SlowsTo
from swarmctl.agent.formation.ways import offset_of

LEADER_FLIES_MISSION = True
MEMBERS_TELL_HZ = 2.0
WEIGHTS: tuple[str, ...] = ()
LOOKS_AHEAD_S = 1.0
"""Time ahead for which the leader's speed is demanded, because a mission changes speed slowly [s]."""
SLOWING_M_S = 1.0
"""Difference by which a leader slows down for its followers at a time, so that they can slow down too."""


class Params(virtual_structure.Params):
    """Parameters of leader following: those of a virtual structure, with other defaults."""

    slows_from_m: SlowsFrom = 5.0
    slows_to_m: SlowsTo = 25.0
    least_speed_share: LeastSpeedShare = 0.4


def fly(params: Params, group: Group) -> ApproachResult:
    """Return a follower's set-point; for the leader the speed of its mission, and its progress to tell."""
    if group.leader is None:
        # A new leader was a follower before. It goes on along the group's route by set-points, because a
        # mission from beside the route would cross the places of the others. So does a leader on a new route.
        return _lead_mission(params, group) if group.flies_mission else virtual_structure.fly(params, group)
    leader = group.others[group.leader]
    told = reference_now(group) if group.along is None else group.along
    now = reference_now(group)
    # The leader's own position and velocity, moved along the route as far as the reference moves.
    then_s, then_speed = told.s_m, told.speed_m_s
    if leader.age_s != told.age_s:
        then_s, then_speed = group.profile.ahead(then_s, then_speed, max(told.age_s - leader.age_s, 0.0))
    later_s, later_speed = group.profile.ahead(now.s_m, now.speed_m_s, group.lead_s)
    then, pose = group.reference.at(then_s), group.reference.at(later_s)
    point_e = leader.position_m[0] + pose.east_m - then.east_m
    point_n = leader.position_m[1] + pose.north_m - then.north_m
    velocity = (
        leader.velocity_m_s[0] + later_speed * pose.slope_east - then_speed * then.slope_east,
        leader.velocity_m_s[1] + later_speed * pose.slope_north - then_speed * then.slope_north,
    )
    if leader.place[0] or leader.place[1] or leader.way:  # a new leader, at the place that it had before
        away, moves = offset_of(then, leader.place, leader.way, then_speed)
        point_e, point_n = point_e - away[0], point_n - away[1]
        velocity = (velocity[0] - moves[0], velocity[1] - moves[1])
    place_m, velocity_m_s = place_of(group, pose, (point_e, point_n), velocity, later_speed)
    return keep_place(group, pose, now, place_m, velocity_m_s, params.closing_m_s)


def _lead_mission(params: Params, group: Group) -> ApproachResult:
    """Return the leader's progress along its route, and the speed of its mission."""
    own = group.position_m
    expected = reference_now(group)
    share = params.share(group)
    s_m = progress(group, expected.s_m, own[:2])
    pose = group.reference.at(s_m)
    slope = math.hypot(pose.slope_east, pose.slope_north)
    east, north, _ = group.velocity_m_s
    forward_m_s = (east * pose.slope_east + north * pose.slope_north) / max(slope, 1e-9)
    # Where the curve turns back on itself, the reference moves on by the profile (`progress`).
    along = Along(s_m, max(forward_m_s, 0.0) + max(1.0 - slope, 0.0) * group.profile.at(s_m))
    soon_m = s_m + LOOKS_AHEAD_S * along.speed_m_s
    limit = min(group.profile.at(s_m), group.profile.at(min(soon_m, 0.999 * group.reference.length_m)))
    waiting = max(limit * share, math.hypot(east, north) - SLOWING_M_S)
    memory = PlaceMemory(group.now_s, own, group.velocity_m_s, own, group.velocity_m_s, along)
    return ApproachResult(None, (0.0, 0.0, 0.0), memory, min(limit, waiting))
