"""Landing without a landing mode: a fixed wing flies the landing of its mission."""

from __future__ import annotations

import math
from collections.abc import Iterator

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.geo import distance_m
from swarmctl.core.mission import MissionItem
from swarmctl.core.vehicle import Landed, VehicleState
from swarmctl.mavlink.dialects.plan import JUMP, LAND, LAND_START, LOITER_TO_ALT
from swarmctl.mavlink.procedures.guarded import (
    NotInControl,
    StateCondition,
    command,
    in_modes,
    send_guarded,
    set_mode,
)
from swarmctl.mavlink.protocol.procedure import Context, Procedure


def land_by_mission(
    ctx: Context, land_command: int, *, check_mode_first: bool = False
) -> Procedure[str | None]:
    """Have the vehicle fly to its nearest landing and land, unless it does so already; return the failure.

    On the ground it is disarmed instead, because a landing begins with a flight.
    """
    dialect = ctx.dialect
    may_hold = {dialect.hold_mode} if ctx.interrupted or not check_mode_first else set()
    modes = {dialect.mission_mode, dialect.return_mode, ctx.state.mode} | may_hold
    ours = in_modes(modes)
    items = landing_items(ctx.verified_items)

    def lands(state: VehicleState) -> bool:
        return state.mode == dialect.mission_mode and (not items or state.mission_seq in items)

    try:
        if ctx.state.landed is Landed.ON_GROUND:
            disarm = command(ctx, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (0.0,))
            return (yield from send_guarded(ctx, disarm, ours, lambda s: not s.armed, skip_if_done=True))
        if items and lands(ctx.state):
            return None  # a second command would make it go around
        if dialect.lands_at_nearest:
            order = command(ctx, land_command)
            return (yield from send_guarded(ctx, order, ours, lands, skip_first_check=not check_mode_first))
        begins = nearest_landing(ctx.verified_items, ctx.state)
        if begins is not None:
            return (
                yield from _from_item(
                    ctx, begins, in_modes(modes, armed=True), check_mode_first=check_mode_first
                )
            )
        # This command may arm the vehicle, so a new heartbeat always precedes it.
        flies = in_modes(modes, armed=True)
        return (yield from send_guarded(ctx, command(ctx, land_command), flies, lands))
    except NotInControl as why:
        return str(why)


def _from_item(
    ctx: Context, seq: int, ours: StateCondition, *, check_mode_first: bool
) -> Procedure[str | None]:
    """Have the vehicle fly its mission from item `seq` on; return the failure."""
    failure = yield from send_guarded(
        ctx,
        lambda attempt: ctx.dialect.set_current(ctx.peer, seq, attempt),
        ours,
        lambda s: ours(s) and s.mission_seq == seq,
        skip_first_check=not check_mode_first,
    )
    return failure or (yield from set_mode(ctx, ctx.dialect.mission_mode, ours, armed=True))


def landing_items(items: tuple[MissionItem, ...]) -> frozenset[int]:
    """Return the indices of items that belong to landings: from DO_LAND_START or a circle to NAV_LAND."""
    found, inside = set[int](), False
    for seq, item in enumerate(items):
        inside = inside or item.command in (LAND_START, LOITER_TO_ALT)
        if inside:
            found.add(seq)
        inside = inside and item.command != LAND
    return frozenset(found)


def is_other_landing(items: tuple[MissionItem, ...], seq: int) -> bool:
    """Return whether an item belongs to a landing that the list's waypoints do not lead to.

    Its first jump leads from the waypoints to their landing's circle.
    """
    leads_to = next((int(item.param1) for item in items if item.command == JUMP), None)
    return seq in landing_items(items) and seq != leads_to


def nearest_landing(items: tuple[MissionItem, ...], state: VehicleState) -> int | None:
    """Return the index of the nearest landing circle; the first one while the position is unknown.

    None if the list has no landing.
    """
    here = None if state.lat_deg is None or state.lon_deg is None else (state.lat_deg, state.lon_deg)

    def away_m(seq: int) -> float:
        there = items[seq].x / 1e7, items[seq].y / 1e7
        return math.inf if here is None else distance_m(here, there)

    return min(_circles(items), key=away_m, default=None)


def _circles(items: tuple[MissionItem, ...]) -> Iterator[int]:
    return (seq for seq in sorted(landing_items(items)) if items[seq].command == LOITER_TO_ALT)
