"""Land what no mode lands: a fixed wing flies the landing of its mission."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.mission import MissionItem
from swarmctl.core.vehicle import Landed, VehicleState
from swarmctl.mavlink.guarded import HandsOff, command, guarded, in_modes
from swarmctl.mavlink.procedure import Context, Procedure


def land_by_mission(ctx: Context, land_command: int, *, looks_first: bool = False) -> Procedure[str | None]:
    """Have it fly to its nearest landing and land there, unless it does so; returns the failure.

    On the ground it is disarmed, for a landing begins with a flight to it.
    """
    dialect = ctx.dialect
    may_hold = {dialect.hold_mode} if ctx.interrupted or not looks_first else set()
    ours = in_modes({dialect.mission_mode, dialect.return_mode, ctx.state.mode} | may_hold)
    items = landing_items(ctx.on_vehicle)

    def lands(state: VehicleState) -> bool:
        return state.mode == dialect.mission_mode and (not items or state.mission_seq in items)

    try:
        if ctx.state.landed is Landed.ON_GROUND:
            disarm = command(ctx, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (0.0,))
            return (yield from guarded(ctx, disarm, ours, lambda s: not s.armed, skip_if_done=True))
        if items and lands(ctx.state):
            return None  # told once more, it would go around again
        return (yield from guarded(ctx, command(ctx, land_command), ours, lands, at_once=not looks_first))
    except HandsOff as why:
        return str(why)


def landing_items(items: tuple[MissionItem, ...]) -> frozenset[int]:
    """Which items of a list belong to landings: each from its DO_LAND_START to its NAV_LAND."""
    found, inside = set[int](), False
    for seq, item in enumerate(items):
        inside = inside or item.command == mavlink.MAV_CMD_DO_LAND_START
        if inside:
            found.add(seq)
        inside = inside and item.command != mavlink.MAV_CMD_NAV_LAND
    return frozenset(found)
