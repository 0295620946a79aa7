"""The members that a vehicle flies with: heard recently, and not far away. Pure."""

from __future__ import annotations

import math

from swarmctl.agent.formation.membership import Formation
from swarmctl.agent.phases import Phase
from swarmctl.agent.state import AgentState

JOINS_WITHIN_M = 200.0
"""Greatest distance from another member at which a vehicle joins, beside the size of the shape [m]."""


def near_members(state: AgentState, formation: Formation, silence_s: float) -> tuple[int, ...]:
    """Return the other members that are heard and not far from this vehicle, in the group's order."""
    vehicle = state.last_position
    if vehicle.lat_lon is None:
        return ()
    here = state.task.grid.frame.to_local(*vehicle.lat_lon)
    within_m = JOINS_WITHIN_M + 2.0 * formation.radius_m
    told = state.membership.told
    others = state.membership.present(formation.members, state.now_boot_s, silence_s)
    return tuple(
        uav for uav in others if uav != state.task.uav and math.dist(here, told[uav].here_m) <= within_m
    )


def present_members_of(state: AgentState) -> frozenset[int]:
    """Return the present members of the group that the vehicle flies in or leads; none outside of a group."""
    formation, membership = state.task.formation, state.membership
    if formation is None or membership.leader is None:
        return frozenset()
    if state.phase is not Phase.FORMATION and not (state.phase is Phase.FLYING and state.leads_group):
        return frozenset()
    return frozenset(near_members(state, formation, formation.lost_after_s))
