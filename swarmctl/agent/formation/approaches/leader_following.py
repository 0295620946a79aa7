"""Leader following: the others keep their places relative to the leader, which flies its mission.

A follower predicts the leader along the leader's route from what it told: position, velocity, and its
distance along the route. Velocity and turn of the leader are fed forward. The leader is slowed for turns and
for a follower that is far behind.
"""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from swarmctl.agent.formation.approaches.base import Along, Command, Group, Memory
from swarmctl.agent.formation.approaches.keeping import (
    keep_place,
    place_of,
    progress,
    reference_now,
    waiting_share,
)
from swarmctl.core.section import Section

DESCRIPTION = "The leader flies its mission, and the others keep their places relative to it."
LEADER_FLIES_MISSION = True
LOOKS_AHEAD_S = 1.0
"""Time ahead for which the leader's speed is demanded, because a mission changes speed slowly [s]."""


class Params(Section):
    """Parameters of leader following."""

    closing_m_s: Annotated[float, Field(gt=0)] = 3.0
    """greatest speed of a follower relative to its place, while it joins or the shape changes [m/s]"""
    slows_from_m: Annotated[float, Field(ge=0)] = 5.0
    """largest error of a follower at which the leader keeps its speed [m]"""
    slows_to_m: Annotated[float, Field(gt=0)] = 25.0
    """error of a follower from which the leader has its least speed [m]"""
    least_speed_share: Annotated[float, Field(ge=0, le=1)] = 0.4
    """least speed, as a share of the speed without errors"""


def fly(params: Params, group: Group) -> Command:
    """Return a follower's set-point; for the leader the speed of its mission, and its progress to tell."""
    if group.leader is None:
        return _lead(params, group)
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
    if leader.place[0] or leader.place[1]:  # a lost leader's place stays open: the reference point is there
        place = pose.at(leader.place[0], leader.place[1])
        away_e, away_n = place[0] - pose.east_m, place[1] - pose.north_m
        turn = later_speed * pose.turn_rad_m
        point_e, point_n = point_e - away_e, point_n - away_n
        velocity = (velocity[0] - turn * away_n, velocity[1] + turn * away_e)
    place_m, velocity_m_s = place_of(group, pose, (point_e, point_n), velocity, later_speed)
    return keep_place(group, pose, now, place_m, velocity_m_s, params.closing_m_s)


def _lead(params: Params, group: Group) -> Command:
    """Return the leader's progress along its route, and the speed of its mission."""
    expected, own = reference_now(group), group.position_m
    pose = group.reference.at(expected.s_m)
    forward, right, _ = group.place
    place = pose.at(forward, right)
    point = (own[0] - place[0] + pose.east_m, own[1] - place[1] + pose.north_m)
    s_m = progress(group, expected.s_m, point)
    pose = group.reference.at(s_m)
    slope = math.hypot(pose.slope_east, pose.slope_north)
    east, north, _ = group.velocity_m_s
    forward_m_s = (east * pose.slope_east + north * pose.slope_north) / max(slope, 1e-9)
    # Where the curve turns back on itself, the reference moves on by the profile (`progress`).
    along = Along(s_m, max(forward_m_s, 0.0) + max(1.0 - slope, 0.0) * group.profile.at(s_m))
    share = waiting_share(group, 0.0, params.slows_from_m, params.slows_to_m, params.least_speed_share)
    soon_m = s_m + LOOKS_AHEAD_S * along.speed_m_s
    limit = min(group.profile.at(s_m), group.profile.at(min(soon_m, 0.999 * group.reference.length_m)))
    memory = Memory(group.now_s, own, group.velocity_m_s, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), s_m)
    return Command(None, (0.0, 0.0, 0.0), along, memory, limit * share)
