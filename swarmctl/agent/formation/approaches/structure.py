"""The law of a structure: a point that the leader moves along the route, with all places fixed to it.

The leader advances the point (s, speed) by the speeds of the route's profile and tells it. It slows for the
member with the largest error. A new leader goes on from its own prediction.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from swarmctl.agent.formation.approaches.base import Along, ApproachResult, Group
from swarmctl.agent.formation.approaches.place_keeping import (
    advanced,
    keep_place,
    own_error_m,
    place_of,
    reference_now,
    waiting_share,
)
from swarmctl.core.section import Section

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


class Waiting(Section):
    """How fast members take their places, and how a group waits for them; the approaches set the defaults."""

    closing_m_s: Annotated[float, Field(gt=0)] = 3.0
    """greatest speed of a member relative to its place, while it joins or the shape changes [m/s]"""
    slows_from_m: SlowsFrom
    slows_to_m: SlowsTo
    least_speed_share: LeastSpeedShare

    def model_post_init(self, _context: object) -> None:
        if self.slows_to_m <= self.slows_from_m:
            raise ValueError(
                f"slows_to_m {self.slows_to_m:g}: expected more than slows_from_m {self.slows_from_m:g}"
            )

    def share(self, group: Group, own_error_m: float = 0.0) -> float:
        """Return the share of its speed at which the group waits for its members."""
        return waiting_share(group, own_error_m, self.slows_from_m, self.slows_to_m, self.least_speed_share)


def fly_in_structure(waiting: Waiting, group: Group) -> ApproachResult:
    """Return the set-point of a member, and for the leader the reference point that it tells."""
    now = lead_structure(waiting, group) if group.is_leader else reference_now(group)
    s_m, speed_m_s = group.profile.ahead(now.s_m, now.speed_m_s, group.lead_s)
    pose = group.reference.at(s_m)
    velocity = (speed_m_s * pose.slope_east, speed_m_s * pose.slope_north)
    place_m, velocity_m_s = place_of(group, pose, (pose.east_m, pose.north_m), velocity, speed_m_s)
    return keep_place(group, pose, now, place_m, velocity_m_s, waiting.closing_m_s)


def lead_structure(waiting: Waiting, group: Group) -> Along:
    """Return the reference point that the leader has moved on; it slows for the largest error."""
    told = group.along
    if told is None or told.age_s > LONGEST_STEP_S:
        return reference_now(group)
    return advanced(group, told, waiting.share(group, own_error_m(group)))
