"""Flight in a group: the joining, the set-points, the leader's speed, and the leaving. Pure.

`fly_in_formation` comes last at each telemetry message, because an earlier part of the policy may have taken
the vehicle out of its group.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from swarmctl.agent.commands import StepResult, command, release_vehicle, set_speed
from swarmctl.agent.formation.approaches.base import (
    Along,
    ApproachResult,
    Group,
    MemberLimits,
    OtherMember,
    SetPointDemand,
    ThreatField,
)
from swarmctl.agent.formation.approaches.place_keeping import keep_separation
from swarmctl.agent.formation.membership import Formation, MemberReport, far_from_place
from swarmctl.agent.formation.near_members import near_members, obstacles, places_of, with_members_shown
from swarmctl.agent.formation.shape import ShapePlace, least_spacing_m
from swarmctl.agent.formation.split import followers_in_place
from swarmctl.agent.formation.ways import MemberWay
from swarmctl.agent.own_modes import own_mode_roles
from swarmctl.agent.phases import EN_ROUTE, ENDED, Phase
from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.prediction import hears_nobody, home_amsl_m, position_of, reported_amsl_m
from swarmctl.agent.traffic.route_hold import ceiling_m, hold, would_block
from swarmctl.core import events as ev
from swarmctl.core.any_angle.track import cells_under
from swarmctl.core.belief import OCCUPIED
from swarmctl.core.grid import Cell
from swarmctl.core.records import replace
from swarmctl.core.setpoint import SetPoint

LOWEST_M = 10.0
"""Least height above home at which a member flies level [m]."""
LEVEL_WITHIN = 0.4
"""Distance from its place within which a member flies at the group's height, in spacings."""
CLEAR_LIMITS = 3.0
"""Distance from other vehicles at which a member changes to the group's height, in limits."""
STOPS_WITHIN_S = 3.0
"""Time in which a member can stop, after some reaction [s]."""
GIVES_WAY_FOR_S = 30.0
"""Greatest time for which a member gives way before it leaves [s]: members that left tell their positions for
as long."""
ANNOUNCED_WITHIN_S = 2.0
"""Time within which a member that leaves has announced its next flight to the others [s]."""
RESTING_TARGET_LEAD_S = 0.1
"""Time by which set-points are ahead for a vehicle whose target rests between them, as PX4's does [s]."""


def fly_in_formation(state: AgentState) -> StepResult:
    """Join the group, fly to the place, lead, or leave; the leader reports a new shape, and a split."""
    after, effects = _fly_in_formation(state)
    return after, [*_changes_of_group(state, after), *effects]


def _fly_in_formation(state: AgentState) -> StepResult:
    formation, membership = state.task.formation, state.membership
    if formation is None or state.phase not in EN_ROUTE:
        return state, []
    in_formation = state.phase is Phase.FORMATION
    if in_formation and state.vehicle.mode_role not in own_mode_roles(state):
        return state, []  # a pilot may have chosen this mode: `taken_over` decides
    if membership.leader is None or membership.route is None:
        return _leave(state, _why_apart(state)) if in_formation else _at_full_speed(state, formation)
    if in_formation:
        return _alone(state, formation) if membership.n_present == 1 else _with_group(state, formation)
    if membership.n_present == 1:
        return _at_full_speed(state, formation)
    if state.leads_group and formation.approach.LEADER_FLIES_MISSION:
        return _lead_mission(*_flown(state, formation))
    if not state.flies_mission or state.alarms:
        return state, []
    joined, flown = _flown(state, formation)
    if _cell_in_the_way(joined, formation) is not None:
        return state, []  # its own mission leads around it
    state, ordered = command(joined, ev.FlightOrder.FORMATION, phase=Phase.FORMATION)
    leader = state.task.name_of(membership.leader)
    text = f"the vehicle joins group {formation.name}, which {leader} leads [joins]"
    return state, [ev.NotifyOperator(text), *_set_points(state, flown.demand), *ordered]


def _changes_of_group(before: AgentState, after: AgentState) -> list[ev.Effect]:
    """Return the leader's reports about a new shape of its group, and about a split."""
    formation, old, new, uav = after.task.formation, before.membership, after.membership, after.task.uav
    if formation is None or new.along is None or new.n_present == 1 or not (old.leader == new.leader == uav):
        return []
    group, texts = f"group {formation.name}", []
    if new.shape != old.shape and old.has_shape:
        texts.append(f"{group} changes its shape: {formation.shape(new.shape).kind} [shape]")
    if new.is_split and not old.is_split:
        texts.append(f"{group} splits: the members fly ways of their own, and meet again [splits]")
    if old.is_split and not new.is_split:
        texts.append(f"{group} flies together again [meets]")
    return [ev.NotifyOperator(text) for text in texts]


def note_following(state: AgentState) -> AgentState:
    """Note the mode in which the vehicle follows set-points, after it has confirmed the order."""
    return replace(state, membership=replace(state.membership, setpoint_role=state.vehicle.mode_role))


def not_following(state: AgentState, reason: str) -> StepResult:
    """Fly the own mission on: the vehicle does not follow set-points.

    In another mode the vehicle is released, because a pilot may have chosen that mode. While the mode is
    unknown, or the vehicle has followed set-points before, a hold is ordered.
    """
    if state.lost or state.telemetry_is_late or state.order.is_followed:
        return _leave(state, reason)
    if state.vehicle.mode_role != "mission":
        return release_vehicle(state, f"{reason}, in mode {state.vehicle.mode}")
    order = state.order.noted(ev.FlightOrder.LAUNCH)
    state = state.enter(Phase.FLYING, order=order, plans=state.plans.due(), trouble=reason)
    return state, [ev.NotifyOperator(f"{reason}; the vehicle flies its own mission [not-joined]")]


def _with_group(state: AgentState, formation: Formation) -> StepResult:
    """Fly to the place, or leave. A member whose hold would be in the way of another one gives way first."""
    flying, flown = _flown(state, formation)
    if (why := _why_off_place(flying, formation)) is not None:
        return _stand_still(state, formation) if _gives_way(state) else _leave(state, why)
    membership = replace(flying.membership, stands_since_boot_s=None)
    return replace(flying, membership=membership), _set_points(flying, flown.demand)


def _alone(state: AgentState, formation: Formation) -> StepResult:
    """Leave if all others have left. Else fly on while they keep the place, stand still, and then leave."""
    membership = state.membership
    alone_s = state.now_boot_s - membership.n_present_since_boot_s
    if membership.told and not any(report.message.joins for report in membership.told.values()):
        if alone_s < ANNOUNCED_WITHIN_S or _gives_way(state):
            return _stand_still(state, formation)
        return _leave(state, "all other members have left")
    if alone_s >= formation.alone_after_s:
        return _leave(state, f"no other member was heard for {formation.alone_after_s:g} s")
    if membership.stands_still or alone_s >= formation.keeps_place_s - formation.lost_after_s:
        return _stand_still(state, formation)
    state, flown = _flown(state, formation)
    return state, _set_points(state, flown.demand)


def _gives_way(state: AgentState) -> bool:
    """Return whether a member gives way by set-points before it leaves, for at most GIVES_WAY_FOR_S.

    It does so while its hold would be in the way of another vehicle, because in hold it cannot give way.
    """
    since_s = state.membership.stands_since_boot_s
    is_due = since_s is not None and state.now_boot_s - since_s >= GIVES_WAY_FOR_S
    return not is_due and would_block(with_members_shown(state))


def _stand_still(state: AgentState, formation: Formation) -> StepResult:
    """Stand still by set-points, and keep apart from the others."""
    if not state.membership.stands_still:
        membership = replace(state.membership, stands_since_boot_s=state.now_boot_s)
        state = replace(state, membership=membership).with_new_flight()
    still, group = (0.0, 0.0, 0.0), _view(state, formation, _along(state))
    return state, _set_points(state, SetPointDemand(keep_separation(group, still) or still))


def _leave(state: AgentState, why: str) -> StepResult:
    """Hold, and then fly the own mission when its way is clear; the hold gives way to nobody yet."""
    assert state.task.formation is not None
    text = f"{why}; the vehicle leaves group {state.task.formation.name}, holds, and flies its own mission"
    state, effects = hold(state, state.plans.mission, {}, n_holds=state.n_holds)
    return state, [ev.NotifyOperator(f"{text} [leaves-group]"), *effects]


def _why_apart(state: AgentState) -> str:
    """Return the reason why a vehicle is in no group: it has no leader, or no route."""
    vehicle, membership = state.vehicle, state.membership
    if membership.is_over:
        return "the group has reached its goal"
    if state.lost:
        return "the link to the vehicle is lost"
    if not vehicle.has_position or vehicle.alt_amsl_m is None:
        return "the vehicle's position is unknown"
    return "the group's route is unknown" if membership.route is None else "no leader is heard"


def _why_off_place(state: AgentState, formation: Formation) -> str | None:
    """Return the reason why a member cannot fly to its place; None if it can."""
    if (far_m := _comes_no_nearer(state, formation)) is not None:
        for_s, limit_m = formation.max_error_s, formation.max_error_m
        why = f"for {for_s:g} s the vehicle has been more than {limit_m:g} m from its place"
        return f"{why}, and comes no nearer ({far_m:.0f} m now)"
    if (cell := _cell_in_the_way(state, formation)) is not None:
        what = "no-fly" if cell in state.task.no_fly else "hostile"
        return f"the {what} cell {list(cell)} lies on the straight way to its place"
    return None


def _comes_no_nearer(state: AgentState, formation: Formation) -> float | None:
    """Return the distance from the place of a vehicle that does not follow [m]; None if it follows."""
    far = state.membership.far
    if far is None or state.now_boot_s - far.since_boot_s < formation.max_error_s:
        return None
    return state.membership.from_place_m


def _cell_in_the_way(state: AgentState, formation: Formation) -> Cell | None:
    """Return a no-fly cell or a cell of a known hostile on the way to a place far away; else None.

    The way leads straight on for STOPS_WITHIN_S, so that the vehicle can stop, and from there to the place.
    Near its place a member flies where the group does, and the group's plan counts its cell.
    """
    memory, vehicle, grid = state.membership.memory, state.vehicle, state.task.grid
    if memory is None or vehicle.lat_lon is None:
        return None
    here, there = grid.frame.to_local(*vehicle.lat_lon), memory.place_m[:2]
    if math.dist(here, there) <= formation.max_error_m:
        return None
    ahead = here[0] + STOPS_WITHIN_S * vehicle.east_m_s, here[1] + STOPS_WITHIN_S * vehicle.north_m_s
    way = (cell for cell in cells_under((here, ahead, there), grid.cell_size_m) if grid.contains(cell))
    no_fly, known = state.task.no_fly, state.belief.known
    return next((cell for cell in way if cell in no_fly or known[cell] == OCCUPIED), None)


def _lead_mission(state: AgentState, flown: ApproachResult) -> StepResult:
    """Set the speed of the leader's mission: for the shape's turns, and for followers that are behind."""
    wanted_m_s = flown.mission_speed_m_s
    return (state, []) if wanted_m_s is None else set_speed(state, wanted_m_s)


def _at_full_speed(state: AgentState, formation: Formation) -> StepResult:
    """Set the vehicle's own speed again after it has led a group.

    In silence the vehicle flies on as announced, because the others expect it later than at full speed. So
    members that were heard lately, and keep their places, count as present: the silence may be its own.
    """
    if state.speed.m_s is None or state.task.arrival_group is not None:
        return state, []
    if hears_nobody(state) or near_members(state, formation, formation.keeps_place_s):
        return state, []
    return set_speed(state, state.task.arrival.speed_m_s)


# --- the view of an approach, and its answer


def _flown(state: AgentState, formation: Formation) -> tuple[AgentState, ApproachResult]:
    """Return the answer of the approach, and the state that remembers it."""
    along, route, membership = _along(state), state.membership.route, state.membership
    assert route is not None
    if along is not None:
        now_m = along.s_m + along.age_s * along.speed_m_s
        is_split = route.split_at(now_m) is not None
        membership = replace(membership, shape=route.shape_at(now_m), is_split=is_split)
    params = formation.params_with(membership.weights)
    flown = formation.approach.fly(params, _view(replace(state, membership=membership), formation, along))
    error_m = None if flown.demand is None else flown.error_m
    membership = replace(membership, memory=flown.memory, error_m=error_m)
    far = far_from_place(membership.far, membership.from_place_m, state.now_boot_s, formation)
    state = replace(state, membership=replace(membership, far=far))
    if not membership.has_shape and any(followers_in_place(state).values()):
        state = replace(state, membership=replace(state.membership, has_shape=True))
    return state, flown


def _view(state: AgentState, formation: Formation, along: Along | None) -> Group:
    """Return the group as this vehicle sees it, with its reference point; heights are above the sea."""
    membership, vehicle, now_s = state.membership, state.vehicle, state.now_boot_s
    route, leader = membership.route, membership.leader
    assert route is not None
    assert leader is not None
    assert vehicle.lat_lon is not None
    assert vehicle.alt_amsl_m is not None
    with_places = near_members(state, formation, formation.keeps_place_s)
    others = [u for u in with_places if now_s - membership.told[u].at_boot_s <= formation.lost_after_s]
    places = places_of(state, formation, (*with_places, state.task.uav))
    velocity_m_s = vehicle.east_m_s, vehicle.north_m_s, vehicle.climb_m_s
    # Telemetry is as old as the link's delay: the vehicle has flown on since.
    then, since_s = (*state.task.grid.frame.to_local(*vehicle.lat_lon), vehicle.alt_amsl_m), vehicle.delay_s
    here = (
        then[0] + since_s * velocity_m_s[0],
        then[1] + since_s * velocity_m_s[1],
        then[2] + since_s * velocity_m_s[2],
    )
    limits = state.task.separation.limits
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
        limits=MemberLimits(
            speed_m_s=state.task.arrival.speed_m_s,
            separation_m=limits.horizontal_m,
            separation_up_m=limits.vertical_m,
        ),
        leader=None if state.leads_group else others.index(leader),
        flies_mission=state.phase is Phase.FLYING and state.leads_group,
        memory=membership.memory,
        threats=_threats(state),
        way=route.way_of(state.task.uav),
        lead_s=RESTING_TARGET_LEAD_S if membership.setpoint_role == "setpoints" else 0.0,
    )


def _along(state: AgentState) -> Along | None:
    """Return the reference point: as the leader told it on this route, or as this vehicle last knew it."""
    membership, now_s = state.membership, state.now_boot_s
    route, leader = membership.route, membership.leader
    if leader is not None and not state.leads_group and route is not None:
        told = membership.told[leader]
        if route.is_of(leader, told.message.route_id):
            message, fastest_m_s = told.message, state.task.arrival.speed_m_s
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
    limits, here = state.task.separation.limits, position_of(state)
    assert here is not None
    low_m, high_m = sorted((here[2] + home_amsl_m(state), up_m))
    return high_m - low_m > limits.vertical_m and any(
        low_m - limits.vertical_m < reported_amsl_m(state, report) < high_m + limits.vertical_m
        and math.dist(here[:2], (report.east_m, report.north_m)) < CLEAR_LIMITS * limits.horizontal_m
        for report in state.neighbours.values()
        if report.state.phase not in ENDED
    )


def _threats(state: AgentState) -> ThreatField | None:
    exposure = state.plans.exposure
    return None if exposure is None else ThreatField(exposure, state.task.grid.cell_size_m)


def _set_points(state: AgentState, demand: SetPointDemand | None) -> list[ev.Effect]:
    """Return the set-point for the vehicle."""
    if demand is None:
        return []
    at, alt_amsl_m = None, None
    if (position_m := demand.position_m) is not None:
        at, alt_amsl_m = state.task.grid.frame.to_geodetic(*position_m[:2]), position_m[2]
    return [ev.SendSetPoint(SetPoint(demand.velocity_m_s, at, alt_amsl_m))]
