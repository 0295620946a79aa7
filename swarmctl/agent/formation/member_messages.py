"""Messages to the other members of a group: position and place error, and the leader's reference. Pure."""

from __future__ import annotations

from swarmctl.agent.commands import StepResult
from swarmctl.agent.formation.ways import SplitStretch
from swarmctl.agent.state import AgentState
from swarmctl.core import events as ev
from swarmctl.core.frames import MemberShared
from swarmctl.core.records import replace
from swarmctl.core.split import SplitShared

LEAVES_WITHIN_S = 30.0
"""Time for which a vehicle that left goes on to tell its position, because others may fly behind it [s]."""
ROUTE_EVERY_S = 1.0
"""Time between two messages with an unchanged route [s]."""


def tell_group(state: AgentState) -> StepResult:
    """Send the own message to the other members, if it is due."""
    formation, membership = state.task.formation, state.membership
    last, now_s = state.last_position, state.vehicle.time_boot_s
    if formation is None or last.alt_amsl_m is None or last.lat_deg is None or last.lon_deg is None:
        return state, []
    in_group = membership.leader is not None and not state.is_waiting and not state.ended
    # A member that stands still because it hears nobody has not left: all may be silent for some seconds.
    leaves_beside_others = membership.stands_still and membership.n_present > 1
    joins = in_group and not leaves_beside_others
    leaves = not joins and 0.0 <= now_s - membership.in_group_boot_s < LEAVES_WITHIN_S
    if not joins and not leaves and not membership.joins_told:
        return state, []
    is_leader = joins and state.leads_group
    rate_hz = formation.rate_hz if is_leader or leaves else formation.approach.MEMBERS_TELL_HZ
    # Telemetry comes at times of its own, so a message may be due a little early.
    if joins == membership.joins_told and 0.0 <= now_s - membership.sent_boot_s < 0.9 / rate_hz:
        return state, []
    message = MemberShared(
        lat_deg=last.lat_deg,
        lon_deg=last.lon_deg,
        alt_amsl_m=last.alt_amsl_m,
        velocity_m_s=(last.east_m_s, last.north_m_s, last.climb_m_s),
        age_s=max(state.now_boot_s - last.time_boot_s, 0.0),
        joins=joins,
        error_m=membership.from_place_m,
    )
    if is_leader:
        with_route = now_s // ROUTE_EVERY_S != membership.sent_boot_s // ROUTE_EVERY_S
        message = _as_leader(state, message, with_route=with_route)
    in_group_boot_s = now_s if in_group else membership.in_group_boot_s
    membership = replace(membership, sent_boot_s=now_s, joins_told=joins, in_group_boot_s=in_group_boot_s)
    state = replace(state, membership=membership)
    return state, [ev.Publish(message, group=formation.members)]


def _as_leader(state: AgentState, message: MemberShared, *, with_route: bool) -> MemberShared:
    """Return the message with the reference point, and with the route if it is due."""
    message = replace(message, weights=state.membership.weights)
    route, along, last = state.membership.route, state.membership.along, state.last_position
    if route is None or along is None:
        return message
    to_geodetic = state.task.grid.frame.to_geodetic
    home_m = (last.alt_amsl_m or 0.0) - (last.alt_rel_m or 0.0)
    return replace(
        message,
        along_m=along.s_m,
        speed_m_s=along.speed_m_s,
        route_id=route.number,
        route=tuple(to_geodetic(*point) for point in route.reference.points_m) if with_route else (),
        shapes=route.shapes if with_route else (),
        split=_split_message(state, route.split_at(along.s_m)) if with_route else None,
        height_amsl_m=home_m + state.height_m,
    )


def _split_message(state: AgentState, split: SplitStretch | None) -> SplitShared | None:
    """Return the split as the leader tells it; None after its end."""
    if split is None:
        return None
    to_geodetic = state.task.grid.frame.to_geodetic
    ways = ((uav, tuple(to_geodetic(*p) for p in curve.points_m)) for uav, curve in split.curves.items())
    return SplitShared(split.begin_m, split.end_m, tuple(ways))
