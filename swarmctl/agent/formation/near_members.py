"""The members that a vehicle flies with: heard recently, and not far away. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence

from swarmctl.agent.formation.approaches.base import Nearby
from swarmctl.agent.formation.membership import Formation, MemberReport
from swarmctl.agent.formation.shape import ShapePlace, assigned
from swarmctl.agent.phases import Phase
from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.separation.trajectory import LocalPoint, extrapolate
from swarmctl.core.records import replace

SOON_S = 8.0
"""Time within which a silent member has stopped: alone, without set-points, or by a pilot [s]. For as long
members keep clear of the announced flight of a member that leaves."""
AHEAD_S = 6.0
"""A silent member stops nearer than it flies straight on in this time [s]: ArduPilot goes on for 3 s."""
OFF_INTENT_M = 15.0
"""Distance of a member from its announced place above which its intent is of an earlier flight [m]."""
SILENT_S = 90.0
"""Time for which a silent member counts as stopped near its last position [s]."""
JOINS_WITHIN_M = 200.0
"""Greatest distance from another member at which a vehicle joins, beside the size of the shape [m]."""


def joins_within_m(formation: Formation) -> float:
    """Return the distance up to which a vehicle counts another one as a present member [m]."""
    return JOINS_WITHIN_M + 2.0 * formation.radius_m


def near_members(state: AgentState, formation: Formation, silence_s: float) -> tuple[int, ...]:
    """Return this vehicle and the other members near it that are in the group, or on their way to it.

    They are in the group's order. A member that was not heard for `silence_s` does not count.
    """
    vehicle, told = state.last_position, state.membership.told
    if vehicle.lat_lon is None:
        return (state.task.uav,)
    here, within_m = state.task.grid.frame.to_local(*vehicle.lat_lon), joins_within_m(formation)
    now_s = state.now_boot_s

    def is_near(report: MemberReport) -> bool:
        is_heard = report.message.joins and now_s - report.at_boot_s <= silence_s
        return is_heard and math.dist(here, report.here_m) <= within_m

    own = state.task.uav
    return tuple([uav for uav in formation.members if uav == own or (uav in told and is_near(told[uav]))])


def places_of(state: AgentState, formation: Formation) -> dict[int, ShapePlace]:
    """Return the present place in the shape of each member that has one."""
    membership = state.membership
    return places_in(formation, membership.shape, membership.with_places)


def places_in(formation: Formation, shape: int, present: Sequence[int]) -> dict[int, ShapePlace]:
    """Return the place of each of the present members in a shape."""
    numbers = assigned([uav in present for uav in formation.members], closes_up=formation.closes_up)
    places = formation.places(shape, len(present))
    pairs = zip(formation.members, numbers, strict=True)
    return {uav: places[number] for uav, number in pairs if number is not None}


def obstacles(state: AgentState, formation: Formation) -> tuple[Nearby, ...]:
    """Return the vehicles from which a member keeps apart, beside the present members; heights above the sea.

    A member that leaves tells its position for some seconds. Its next place, and that of a silent member, may
    be anywhere on its announced flight within SOON_S of its last message, or straight ahead, where it stops.
    """
    found: list[Nearby] = []
    own = state.last_position
    if own.lat_lon is None or own.alt_amsl_m is None:
        return ()
    here = (*state.task.grid.frame.to_local(*own.lat_lon), own.alt_amsl_m)
    for uav, told, age_s in _not_present(state, formation):
        message = told.message
        if _leaves(formation, told, age_s):
            there = (*told.here_m, message.alt_amsl_m)
            found.append(Nearby(there, message.velocity_m_s, max(age_s, 0.0)))
            found.append(Nearby(_nearest_place(state, here, uav, told), (0.0, 0.0, 0.0)))
        elif uav != state.task.uav and _is_silent(formation, told, age_s, SILENT_S):
            east_m, north_m, _ = _nearest_place(state, here, uav, told)
            # In a level group it may be anywhere between its last height and the group's.
            heights_m = {message.alt_amsl_m, here[2]} if formation.is_level else {message.alt_amsl_m}
            found += [Nearby((east_m, north_m, up_m), (0.0, 0.0, 0.0)) for up_m in heights_m]
    return tuple(found)


def _nearest_place(state: AgentState, here: LocalPoint, uav: int, told: MemberReport) -> LocalPoint:
    """Return the place nearest to `here` at which a member may be within SOON_S of its last message.

    It flies as announced, or stops straight ahead: on a lost link it gets no set-points round a turn.
    """
    message, intent = told.message, state.received.intents.get(uav)
    there = (*told.here_m, message.alt_amsl_m)
    places = [extrapolate(there, message.velocity_m_s, told.at_boot_s, AHEAD_S).nearest(here[:2])]
    announced = None if intent is None else intent.flight.since(told.at_boot_s)
    has_begun = announced is not None and announced.times_s[0] == told.at_boot_s
    if announced and has_begun and math.dist(announced.points[0][:2], told.here_m) <= OFF_INTENT_M:
        places.append(announced.lasting(told.at_boot_s + SOON_S).nearest(here[:2]))
    return min(places, key=lambda at: math.dist(here[:2], at[:2]))


def with_members_shown(state: AgentState) -> AgentState:
    """Return the state as the rules for other traffic see it when the vehicle leaves its group.

    The members fly on with the group for some seconds, so they do not change their plans for this vehicle.
    """
    hidden = state.membership.hidden
    intents = state.received.intents
    members = {uav: replace(intents[uav], may_change=False) for uav in intents if uav in hidden}
    received = replace(state.received, intents={**intents, **members})
    return replace(state, membership=replace(state.membership, hidden=frozenset()), received=received)


def with_members_hidden(state: AgentState) -> AgentState:
    """Return the state with the present members hidden from the rules for other traffic."""
    hidden = _present_members_of(state)
    if hidden == state.membership.hidden:
        return state
    return replace(state, membership=replace(state.membership, hidden=hidden))


def _present_members_of(state: AgentState) -> frozenset[int]:
    """Return the members that the vehicle keeps apart from by set-points; none outside of a group."""
    formation, membership = state.task.formation, state.membership
    if formation is None or membership.leader is None:
        return frozenset()
    if state.phase is not Phase.FORMATION and not (state.phase is Phase.FLYING and state.leads_group):
        return frozenset()
    present = frozenset(membership.present) - {state.task.uav}
    if state.phase is not Phase.FORMATION:
        return present
    return present | {
        uav
        for uav, told, age_s in _not_present(state, formation)
        if _leaves(formation, told, age_s) or _is_silent(formation, told, age_s, SOON_S)
    }


def _not_present(state: AgentState, formation: Formation) -> list[tuple[int, MemberReport, float]]:
    """Return the members that leave or are silent, their last messages, and the ages of these [s]."""
    now_s = state.now_boot_s
    ages_s = ((uav, told, now_s - told.at_boot_s) for uav, told in state.membership.told.items())
    return [
        (uav, told, age_s)
        for uav, told, age_s in ages_s
        if age_s > formation.lost_after_s or not told.message.joins
    ]


def _leaves(formation: Formation, told: MemberReport, age_s: float) -> bool:
    """Return whether a member leaves the group, and still tells its position; `age_s`: age of its message."""
    return not told.message.joins and age_s <= formation.lost_after_s


def _is_silent(formation: Formation, told: MemberReport, age_s: float, for_s: float) -> bool:
    """Return whether a member was in the group, and has told nothing since, for at most `for_s` [s]."""
    return told.message.joins and formation.lost_after_s < age_s <= for_s
