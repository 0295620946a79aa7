"""Flight in a group: the joining, the set-points, the leader's speed, and the leaving. Pure.

`fly_in_formation` comes last at each telemetry message, because an earlier part of the policy may have taken
the vehicle out of its group.
"""

from __future__ import annotations

import math

from swarmctl.agent.commands import StepResult, command, release_vehicle, set_speed
from swarmctl.agent.formation.approaches.base import ApproachResult, SetPointDemand
from swarmctl.agent.formation.approaches.place_keeping import keep_separation
from swarmctl.agent.formation.membership import Formation, far_from_place
from swarmctl.agent.formation.near_members import near_members, with_members_shown
from swarmctl.agent.formation.split import followers_in_place
from swarmctl.agent.formation.view import along_of, view_of
from swarmctl.agent.own_modes import own_mode_roles
from swarmctl.agent.phases import EN_ROUTE, Phase
from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.prediction import hears_nobody
from swarmctl.agent.traffic.route_hold import hold, would_block
from swarmctl.core import events as ev
from swarmctl.core.any_angle.track import cells_under
from swarmctl.core.belief import OCCUPIED
from swarmctl.core.grid import Cell
from swarmctl.core.records import replace
from swarmctl.core.setpoint import SetPoint

STOPS_WITHIN_S = 3.0
"""Time in which a member can stop, after some reaction [s]."""
GIVES_WAY_FOR_S = 30.0
"""Greatest time for which a member gives way before it leaves [s]."""
ANNOUNCED_WITHIN_S = 2.0
"""Time within which a member that leaves has announced its next flight to the others [s]."""


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
    if flying.membership.stands_still:
        membership = replace(flying.membership, stands_since_boot_s=None)
        flying = replace(flying, membership=membership).with_new_flight()
    return flying, _set_points(flying, flown.demand)


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

    A vehicle in hold cannot give way, so a hold in the way of another vehicle has to wait.
    """
    since_s = state.membership.stands_since_boot_s
    is_due = since_s is not None and state.now_boot_s - since_s >= GIVES_WAY_FOR_S
    return not is_due and would_block(with_members_shown(state))


def _stand_still(state: AgentState, formation: Formation) -> StepResult:
    """Stand still by set-points, and keep apart from the others."""
    if not state.membership.stands_still:
        membership = replace(state.membership, stands_since_boot_s=state.now_boot_s)
        state = replace(state, membership=membership).with_new_flight()
    still, group = (0.0, 0.0, 0.0), view_of(state, formation, along_of(state))
    return state, _set_points(state, SetPointDemand(keep_separation(group, still) or still))


def _leave(state: AgentState, why: str) -> StepResult:
    """Hold, and then fly the own mission when its way is clear; the hold gives way to nobody yet."""
    assert state.task.formation is not None
    text = f"{why}; the vehicle leaves group {state.task.formation.name}, holds, and flies its own mission"
    state, effects = hold(state, state.plans.mission, frozenset())
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
    """Set the vehicle's own speed again after it has led a group, unless it may only have lost its radio.

    The others expect a silent vehicle as announced, or later. So the speed stays as announced while the
    vehicle hears nobody, and while the members heard lately keep their places.
    """
    if state.speed.m_s is None:
        return state, []
    if hears_nobody(state) or len(near_members(state, formation, formation.keeps_place_s)) > 1:
        return state, []
    return set_speed(state, state.task.speed_m_s)


def _flown(state: AgentState, formation: Formation) -> tuple[AgentState, ApproachResult]:
    """Return the answer of the approach, and the state that remembers it."""
    along, route, membership = along_of(state), state.membership.route, state.membership
    assert route is not None
    if along is not None:
        now_m = along.s_m + along.age_s * along.speed_m_s
        is_split = route.split_at(now_m) is not None
        membership = replace(membership, shape=route.shape_at(now_m), is_split=is_split)
    params = formation.params_with(membership.weights)
    flown = formation.approach.fly(params, view_of(replace(state, membership=membership), formation, along))
    error_m = None if flown.demand is None else flown.error_m
    membership = replace(membership, memory=flown.memory, error_m=error_m)
    far = far_from_place(membership.far, membership.from_place_m, state.now_boot_s, formation)
    state = replace(state, membership=replace(membership, far=far))
    if not membership.has_shape and any(followers_in_place(state).values()):
        state = replace(state, membership=replace(state.membership, has_shape=True))
    return state, flown


def _set_points(state: AgentState, demand: SetPointDemand | None) -> list[ev.Effect]:
    """Return the set-point for the vehicle."""
    if demand is None:
        return []
    at, alt_amsl_m = None, None
    if (position_m := demand.position_m) is not None:
        at, alt_amsl_m = state.task.grid.frame.to_geodetic(*position_m[:2]), position_m[2]
    return [ev.SendSetPoint(SetPoint(demand.velocity_m_s, at, alt_amsl_m))]
