"""Virtual structure: a point that the leader moves along the route, with all places fixed to it.

The leader advances the point (s, speed) by the speeds of the route's profile and tells it. It slows for the
member with the largest error. A new leader goes on from its own prediction. All members fly set-points.
After Lewis and Tan, "High precision formation control of mobile robots using virtual structures",
Autonomous Robots 4 (1997): the structure moves, the members follow their points, and their errors hold the
structure back. Here the errors slow it down, instead of a fit of the structure to the members.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from swarmctl.agent.formation.approaches.base import Command, Group
from swarmctl.agent.formation.approaches.keeping import (
    advanced,
    keep_place,
    own_error_m,
    place_of,
    reference_now,
    waiting_share,
)
from swarmctl.core.section import Section

DESCRIPTION = "All members follow the points of a structure that moves along the route and turns as one."
LEADER_FLIES_MISSION = False
MEMBERS_TELL_HZ = 2.0
WEIGHTS: tuple[str, ...] = ()
LONGEST_STEP_S = 0.5
"""Greatest age of the leader's own last reference, from which it goes on step by step [s]."""


class Params(Section):
    """Parameters of the virtual structure."""

    closing_m_s: Annotated[float, Field(gt=0)] = 3.0
    """greatest speed of a member relative to its place, while it joins or the shape changes [m/s]"""
    slows_from_m: Annotated[float, Field(ge=0)] = 3.0
    """largest error of a member at which the structure keeps its speed [m]"""
    slows_to_m: Annotated[float, Field(gt=0)] = 15.0
    """error of a member from which the structure has its least speed [m]"""
    least_speed_share: Annotated[float, Field(ge=0, le=1)] = 0.3
    """least speed, as a share of the speed without errors; 0: the structure waits"""

    def model_post_init(self, _context: object) -> None:
        if self.slows_to_m <= self.slows_from_m:
            raise ValueError(
                f"slows_to_m {self.slows_to_m:g}: expected more than slows_from_m {self.slows_from_m:g}"
            )


def fly(params: Params, group: Group) -> Command:
    """Return the set-point of a member, and for the leader the reference point that it tells."""
    now = reference_now(group)
    told = group.along
    if group.is_leader and told is not None and told.age_s <= LONGEST_STEP_S:
        now = advanced(group, told, _wait(params, group))
    s_m, speed_m_s = group.profile.ahead(now.s_m, now.speed_m_s, group.lead_s)
    pose = group.reference.at(s_m)
    velocity = (speed_m_s * pose.slope_east, speed_m_s * pose.slope_north)
    place_m, velocity_m_s = place_of(group, pose, (pose.east_m, pose.north_m), velocity, speed_m_s)
    return keep_place(group, pose, now, place_m, velocity_m_s, params.closing_m_s)


def _wait(params: Params, group: Group) -> float:
    """Return the share of its speed at which the structure waits for its members."""
    return waiting_share(
        group, own_error_m(group), params.slows_from_m, params.slows_to_m, params.least_speed_share
    )
