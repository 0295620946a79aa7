"""The group as one of its members sees it, for an approach; heights are above the sea. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping

from swarmctl.agent.formation.approaches.base import Along, Group, OtherMember, ThreatField
from swarmctl.agent.formation.membership import Formation, MemberReport
from swarmctl.agent.formation.near_members import obstacles, places_of
from swarmctl.agent.formation.shape import ShapePlace, least_spacing_m
from swarmctl.agent.formation.ways import MemberWay
from swarmctl.agent.phases import ENDED, Phase
from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.prediction import home_amsl_m, position_amsl
from swarmctl.agent.traffic.route_hold import ceiling_m
from swarmctl.core.records import replace

LOWEST_M = 10.0
"""Least height above home at which a member flies level [m]."""
LEVEL_WITHIN = 0.4
"""Distance from its place within which a member flies at the group's height, in spacings."""
CLEAR_LIMITS = 3.0
"""Distance from other vehicles at which a member changes to the group's height, in limits."""
RESTING_TARGET_LEAD_S = 0.1
"""Time by which set-points are ahead for a vehicle whose target rests between them, as PX4's does [s]."""


def view_of(state: AgentState, formation: Formation, along: Along | None) -> Group:
    """Return the group as this vehicle sees it, with its reference point; heights are above the sea."""
    membership, vehicle, now_s = state.membership, state.vehicle, state.now_boot_s
    route, leader = membership.route, membership.leader
    assert route is not None
    assert leader is not None
    then, since_s = position_amsl(state), vehicle.delay_s
    assert then is not None
    others = [uav for uav in membership.present if uav != state.task.uav]
    places = places_of(state, formation)
    velocity_m_s = vehicle.east_m_s, vehicle.north_m_s, vehicle.climb_m_s
    # Telemetry is as old as the link's delay: the vehicle has flown on since.
    here = (
        then[0] + since_s * velocity_m_s[0],
        then[1] + since_s * velocity_m_s[1],
        then[2] + since_s * velocity_m_s[2],
    )
    return Group(
        now_s=now_s,
        position_m=here,
        velocity_m_s=velocity_m_s,
        place=places[state.task.uav],
        others=tuple([_member(membership.told[u], now_s, places[u], route.way_of(u)) for u in others]),
        obstacles=obstacles(state, formation),
        along=along,
        reference=route.reference,
        profile=route.profile,
        height_m=_height_amsl_m(state, formation, places),
        speed_m_s=state.task.speed_m_s,
        limits=state.task.separation.limits,
        leader=None if state.leads_group else others.index(leader),
        flies_mission=state.phase is Phase.FLYING and state.leads_group,
        memory=membership.memory,
        threats=_threats(state),
        way=route.way_of(state.task.uav),
        lead_s=RESTING_TARGET_LEAD_S if membership.setpoint_role == "setpoints" else 0.0,
    )


def along_of(state: AgentState) -> Along | None:
    """Return the reference point: as the leader told it on this route, or as this vehicle last knew it."""
    membership, now_s = state.membership, state.now_boot_s
    route, leader = membership.route, membership.leader
    if leader is not None and not state.leads_group and route is not None:
        told = membership.told[leader]
        if route.is_of(leader, told.message.route_id):
            message, fastest_m_s = told.message, state.task.speed_m_s
            along_m = min(message.along_m, route.reference.length_m)
            return Along(along_m, min(message.speed_m_s, fastest_m_s), max(now_s - told.at_boot_s, 0.0))
    if (memory := membership.memory) is None:
        return _begin(state)
    return replace(memory.along, age_s=max(now_s - memory.now_s, 0.0))


def _begin(state: AgentState) -> Along | None:
    """Return the reference point of a leader that begins to lead: beside it, at its own speed."""
    route, lat_lon = state.membership.route, state.vehicle.lat_lon
    if route is None or lat_lon is None or not state.leads_group:
        return None
    s_m = route.reference.locate(state.task.grid.frame.to_local(*lat_lon))
    return Along(s_m, min(state.vehicle.ground_speed_m_s, route.profile.at(s_m)))


def _member(told: MemberReport, now_s: float, place: ShapePlace, way: MemberWay | None) -> OtherMember:
    message = told.message
    return OtherMember(
        position_m=(*told.here_m, message.alt_amsl_m),
        velocity_m_s=message.velocity_m_s,
        place=place,
        age_s=max(now_s - told.at_boot_s, 0.0),
        error_m=message.error_m,
        way=way,
    )


def _level_within_m(state: AgentState, places: Mapping[int, ShapePlace]) -> float:
    """Return the distance from its place within which a member flies at the group's height [m].

    Places above each other count by the separation.
    """
    limits = state.task.separation.limits
    spacing_m = least_spacing_m(tuple(places.values()), limits.vertical_m)
    return LEVEL_WITHIN * (spacing_m if math.isfinite(spacing_m) else limits.horizontal_m)


def _height_amsl_m(state: AgentState, formation: Formation, places: Mapping[int, ShapePlace]) -> float:
    """Return the height of the reference point above the sea; `places`: those of the present members.

    A vehicle keeps its own height until it is near its place, and no other vehicle is between the heights: so
    vehicles cross each other's ways at different heights.
    """
    membership, place, home_m = state.membership, places[state.task.uav], home_amsl_m(state)
    own_m = home_m + state.height_m
    if not formation.is_level:
        return own_m - place[2]
    if state.leads_group or membership.leader is None:
        return own_m
    error_m, told = membership.error_m, membership.told[membership.leader].message
    is_near = error_m is not None and max(map(abs, error_m[:2])) <= _level_within_m(state, places)
    if not is_near or told.route_id == 0:
        return own_m - place[2]
    # A wrong height of the leader must lead no vehicle into the ground, or through the fence's ceiling.
    up_m = min(max(told.height_amsl_m + place[2], home_m + LOWEST_M), home_m + ceiling_m(state))
    return (own_m if _is_other_between(state, up_m) else up_m) - place[2]


def _is_other_between(state: AgentState, up_m: float) -> bool:
    """Return whether a vehicle that is no present member is near, between the own height and `up_m`."""
    limits, here = state.task.separation.limits, position_amsl(state)
    assert here is not None
    low_m, high_m = sorted((here[2], up_m))
    return high_m - low_m > limits.vertical_m and any(
        low_m - limits.vertical_m < report.position_m[2] < high_m + limits.vertical_m
        and math.dist(here[:2], report.position_m[:2]) < CLEAR_LIMITS * limits.horizontal_m
        for report in state.neighbours.values()
        if report.state.phase not in ENDED
    )


def _threats(state: AgentState) -> ThreatField | None:
    exposure = state.plans.exposure
    return None if exposure is None else ThreatField(exposure, state.task.grid.cell_size_m)
