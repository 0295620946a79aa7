"""Virtual structure: a point that the leader moves along the route, with all places fixed to it.

The leader advances the point (s, speed) by the speeds of the route's profile and tells it. It slows for the
member with the largest error. A new leader goes on from its own prediction.

After Lewis and Tan, "High precision formation control of mobile robots using virtual structures",
Autonomous Robots 4 (1997): the structure moves, the members follow their points, and their errors hold the
structure back. Here the errors slow it down, instead of a fit of the structure to the members.
"""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from swarmctl.agent.formation.approaches.base import ACCELERATION_M_S2, Along, ApproachResult, Group
from swarmctl.agent.formation.approaches.place_keeping import keep_place, place_of, reference_now
from swarmctl.core.section import Section

LEADER_FLIES_MISSION = False
MEMBERS_TELL_HZ = 2.0
WEIGHTS: tuple[str, ...] = ()
LONGEST_STEP_S = 0.5
"""Greatest age of the leader's own last reference, from which it goes on step by step [s]."""

SlowsFrom = Annotated[
    float, Field(ge=0, description="largest error of a member at which the group keeps its speed [m]")
]
SlowsTo = Annotated[
    float, Field(gt=0, description="error of a member from which the group has its least speed [m]")
]
LeastSpeedShare = Annotated[
    float,
    Field(ge=0, le=1, description="least speed, as a share of the speed without errors; 0: the group waits"),
]


class Params(Section):
    """Speed at which members take their places, and the wait of a group for its slowest member."""

    closing_m_s: Annotated[float, Field(gt=0)] = 3.0
    """greatest speed of a member relative to its place, while it joins or the shape changes [m/s]"""
    slows_from_m: SlowsFrom = 3.0
    slows_to_m: SlowsTo = 15.0
    least_speed_share: LeastSpeedShare = 0.3

    def model_post_init(self, _context: object) -> None:
        if self.slows_to_m <= self.slows_from_m:
            raise ValueError(
                f"slows_to_m {self.slows_to_m:g}: expected more than slows_from_m {self.slows_from_m:g}"
            )

    def share(self, group: Group, own_error_m: float = 0.0) -> float:
        """Return the share of its speed at which the group waits for its member with the largest error.

        The share falls evenly from 1 at `slows_from_m` to the least share at `slows_to_m`.
        """
        largest_m = max((member.error_m for member in group.others), default=0.0)
        excess = (max(largest_m, own_error_m) - self.slows_from_m) / (self.slows_to_m - self.slows_from_m)
        return 1.0 - (1.0 - self.least_speed_share) * min(max(excess, 0.0), 1.0)


def fly(params: Params, group: Group) -> ApproachResult:
    """Return the set-point of a member, and for the leader the reference point that it tells."""
    now = _lead(params, group) if group.is_leader else reference_now(group)
    s_m, speed_m_s = group.profile.ahead(now.s_m, now.speed_m_s, group.lead_s)
    pose = group.reference.at(s_m)
    velocity = (speed_m_s * pose.slope_east, speed_m_s * pose.slope_north)
    place_m, velocity_m_s = place_of(group, pose, (pose.east_m, pose.north_m), velocity, speed_m_s)
    return keep_place(group, pose, now, place_m, velocity_m_s, params.closing_m_s)


def _lead(params: Params, group: Group) -> Along:
    """Return the reference point that the leader has moved on; it slows for the largest error."""
    told = group.along
    if told is None or told.age_s > LONGEST_STEP_S:
        return reference_now(group)
    return _advanced(group, told, params.share(group, _own_error_m(group)))


def _own_error_m(group: Group) -> float:
    """Return the member's distance over ground from its place [m]; 0 before the first call."""
    if (memory := group.memory) is None:
        return 0.0
    dt, own, place, moves = group.now_s - memory.now_s, group.position_m, memory.place_m, memory.velocity_m_s
    return math.hypot(own[0] - place[0] - dt * moves[0], own[1] - place[1] - dt * moves[1])


def _advanced(group: Group, told: Along, share: float) -> Along:
    """Return the reference point moved on from `told`, toward a share of the profile's speed.

    The speed changes by at most half of the acceleration. It does not grow while no other member is heard:
    the vehicle's own radio may be silent, and the others expect it as announced, or later.
    """
    wanted = group.profile.at(told.s_m + told.age_s * told.speed_m_s) * share
    if not group.others:
        wanted = min(wanted, told.speed_m_s)
    change = 0.5 * ACCELERATION_M_S2 * told.age_s
    speed_m_s = min(max(wanted, told.speed_m_s - change), told.speed_m_s + change)
    s_m = told.s_m + 0.5 * told.age_s * (told.speed_m_s + speed_m_s)
    length_m = group.reference.length_m
    return Along(min(s_m, length_m), speed_m_s if s_m < length_m else 0.0)
