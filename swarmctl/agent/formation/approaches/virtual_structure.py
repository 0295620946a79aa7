"""Virtual structure: all members follow points that are fixed to a point on the route (`structure`).

After Lewis and Tan, "High precision formation control of mobile robots using virtual structures",
Autonomous Robots 4 (1997): the structure moves, the members follow their points, and their errors hold the
structure back. Here the errors slow it down, instead of a fit of the structure to the members.
"""

from __future__ import annotations

from swarmctl.agent.formation.approaches.base import ApproachResult, Group
from swarmctl.agent.formation.approaches.structure import (
    LeastSpeedShare,
    SlowsFrom,
    SlowsTo,
    Waiting,
    fly_in_structure,
)

LEADER_FLIES_MISSION = False
MEMBERS_TELL_HZ = 2.0
WEIGHTS: tuple[str, ...] = ()


class Params(Waiting):
    """Parameters of the virtual structure."""

    slows_from_m: SlowsFrom = 3.0
    slows_to_m: SlowsTo = 15.0
    least_speed_share: LeastSpeedShare = 0.3


def fly(params: Params, group: Group) -> ApproachResult:
    """Return the set-point of a member, and for the leader the reference point that it tells."""
    return fly_in_structure(params, group)
