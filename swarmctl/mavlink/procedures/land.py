"""Landing without a landing mode: a fixed wing flies the landing of its mission."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.geo import distance_m
from swarmctl.core.mission import MissionItem
from swarmctl.core.vehicle import Landed, VehicleState
from swarmctl.mavlink.dialects.plan import JUMP, LAND, LAND_START, LOITER_TO_ALT
from swarmctl.mavlink.procedures.guarded import (
    UNTIL_REPLACED_S,
    NotInControl,
    command,
    in_modes,
    send_guarded,
    set_mode,
)
from swarmctl.mavlink.procedures.set_current import set_current_item
from swarmctl.mavlink.protocol.procedure import Context, Procedure


def land_by_mission(
    ctx: Context, land_command: int, *, check_mode_first: bool = False
) -> Procedure[str | None]:
    """Make the vehicle fly to its nearest landing; return the failure.

    A vehicle on the ground is disarmed instead, because a command to land could make it take off.
    """
    dialect = ctx.dialect
    may_hold = {dialect.hold_mode} if ctx.interrupted or not check_mode_first else set()
    modes = {dialect.mission_mode, dialect.return_mode, ctx.state.mode} | may_hold
    is_allowed = in_modes(modes)
    items = landing_items(ctx.verified_items)

    def lands(state: VehicleState) -> bool:
        return state.mode == dialect.mission_mode and (not items or state.mission_seq in items)

    try:
        if ctx.state.landed is Landed.ON_GROUND:
            number = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
            disarm = command(ctx, number, (0.0,), lasts_s=UNTIL_REPLACED_S)
            return (
                yield from send_guarded(ctx, disarm, is_allowed, lambda s: not s.armed, skip_if_done=True)
            )
        if items and lands(ctx.state):
            return None  # a second command would restart the approach
        order = command(ctx, land_command, lasts_s=UNTIL_REPLACED_S)
        if dialect.lands_at_nearest:
            return (
                yield from send_guarded(ctx, order, is_allowed, lands, skip_first_check=not check_mode_first)
            )
        flies = in_modes(modes, armed=True)
        circle_seq = nearest_landing(ctx.verified_items, ctx.state)
        if circle_seq is None:
            # This command may arm the vehicle, so a new heartbeat always precedes it.
            return (yield from send_guarded(ctx, order, flies, lands))
        failure = yield from set_current_item(
            ctx, circle_seq, flies, lasts_s=UNTIL_REPLACED_S, skip_first_check=not check_mode_first
        )
        return failure or (yield from set_mode(ctx, dialect.mission_mode, flies, armed=True))
    except NotInControl as why:
        return str(why)


def landing_items(items: tuple[MissionItem, ...]) -> frozenset[int]:
    """Return the indices of items that belong to landings: from DO_LAND_START or a circle to NAV_LAND."""
    found, inside = set[int](), False
    for seq, item in enumerate(items):
        inside = inside or item.command in (LAND_START, LOITER_TO_ALT)
        if inside:
            found.add(seq)
        inside = inside and item.command != LAND
    return frozenset(found)


def is_landing_item_except_entry(items: tuple[MissionItem, ...], seq: int) -> bool:
    """Return whether an item belongs to a landing, but is not the circle to which the first jump leads.

    The vehicle flies from the last waypoint to this circle.
    """
    entry_seq = next((int(item.param1) for item in items if item.command == JUMP), None)
    return seq in landing_items(items) and seq != entry_seq


def nearest_landing(items: tuple[MissionItem, ...], state: VehicleState) -> int | None:
    """Return the index of the nearest landing circle; None if the list has none.

    While the vehicle's position is unknown, return the first circle.
    """
    circles = [seq for seq in sorted(landing_items(items)) if items[seq].command == LOITER_TO_ALT]
    here = state.lat_lon
    if here is None:
        return next(iter(circles), None)
    return min(
        circles, key=lambda seq: distance_m(here, (items[seq].x / 1e7, items[seq].y / 1e7)), default=None
    )
