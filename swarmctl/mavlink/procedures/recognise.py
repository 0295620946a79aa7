"""Recognition of a flown mission: a program that was started anew finds out which of its plans is flown.

Nothing on the vehicle changes. A list on the vehicle may hold more than the flown plan:

| autopilot | before the flown plan | after the flown plan |
|---|---|---|
| exchanges whole missions (`uploads_atomically`) | flown items of earlier plans | nothing |
| uses each item as soon as it is stored | earlier plans, whole or cut | later plans, whole or cut |
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from swarmctl.core.mission import FlightPlan, MissionItem
from swarmctl.core.vehicle import Landed
from swarmctl.mavlink.dialects import Dialect
from swarmctl.mavlink.dialects.plan import LAND
from swarmctl.mavlink.procedures.guarded import NotInControl, confirm_state
from swarmctl.mavlink.procedures.land import landing_items
from swarmctl.mavlink.procedures.swap.stored import is_stored_at
from swarmctl.mavlink.procedures.verified_upload import read_back
from swarmctl.mavlink.protocol.mission_download import DownloadOutcome
from swarmctl.mavlink.protocol.outcome import Done
from swarmctl.mavlink.protocol.procedure import Context, Procedure
from swarmctl.mavlink.protocol.wait import WaitUntil

STATE_WAIT_S = 10.0
"""longest wait for position, arming state and current item, which the streams bring"""


class Recognised(Done, frozen=True):
    """Result of a recognition. A failure means that the vehicle or its mission could not be read."""

    plan_id: int | None = None
    """the plan that the vehicle flies in mission mode, by its current item; None: another mission"""
    lands: bool = False
    """True if the current item belongs to the plan's landing"""
    difference: str = ""
    """reason why no plan was recognised; empty if one was"""
    hold_params: tuple[float, ...] = ()
    """parameters of MAV_CMD_DO_SET_MODE for the vehicle's hold mode; empty after a failure"""


def recognise(
    ctx: Context, plans: Mapping[int, FlightPlan], candidates: Sequence[int]
) -> Procedure[Recognised]:
    """Read the vehicle's state and mission, and find the flown plan among `candidates`.

    `plans` are all plans that this program has ever given to the vehicle, by number; `candidates` are the
    numbers of those that the vehicle may fly now, the most likely first.
    """
    try:
        # Only recent telemetry counts: a backlog shows an old picture.
        yield from confirm_state(ctx, lambda _state: True)
        yield WaitUntil(lambda: _is_known(ctx), STATE_WAIT_S)
        read = yield from read_back(ctx)
        if read.outcome is not DownloadOutcome.COMPLETE:
            return Recognised(read.text)
        # During the read-back the vehicle may have reached another item, or another mode.
        yield from confirm_state(ctx, lambda _state: True)
    except NotInControl as why:
        return Recognised(str(why))
    seq, start = ctx.state.mission_seq, ctx.state.takeoff_lat_lon
    if seq is None or not _is_known(ctx):
        return Recognised("position, landed state or current item are not reported [incomplete]")
    hold_params = ctx.dialect.mode_params(ctx.dialect.hold_mode)
    try:
        missions = {number: ctx.dialect.mission_items(plan, start) for number, plan in plans.items()}
    except ValueError as error:  # the plans are for another airframe
        return Recognised(difference=str(error), hold_params=hold_params)
    found = _flown_plan(ctx.dialect, read.items, seq, missions, candidates)
    if isinstance(found, str):
        return Recognised(difference=found, hold_params=hold_params)
    plan_id, begin = found
    ctx.verified_items = read.items
    ctx.plan_first_seq = ctx.dialect.first_waypoint_seq if ctx.dialect.uploads_atomically else begin
    lands = seq in landing_items(read.items) or read.items[seq].command == LAND
    return Recognised(plan_id=plan_id, lands=lands, hold_params=hold_params)


def _is_known(ctx: Context) -> bool:
    state = ctx.state
    return state.has_position and state.mission_seq is not None and state.landed is not Landed.UNDEFINED


def _flown_plan(
    dialect: Dialect,
    found: tuple[MissionItem, ...],
    seq: int,
    missions: Mapping[int, tuple[MissionItem, ...]],
    candidates: Sequence[int],
) -> tuple[int, int] | str:
    """Return the flown plan and the index of its first waypoint in the list, or the reason if none is."""
    first = dialect.first_waypoint_seq
    known = {_place(item) for items in missions.values() for item in items}
    for number in candidates:
        items = missions[number]
        for begin in range(first, len(found) - len(items) + first + 1):
            end = begin + len(items) - first
            is_current = _is_current(dialect, seq, range(begin, end), len(found))
            if not (is_current and is_stored_at(dialect, found, items, begin)):
                continue
            if [item.command for item in found[:first]] != [item.command for item in items[:first]]:
                return "its take-off is not the program's"
            others = (i for i in range(first, len(found)) if not begin <= i < end)
            strange = next((i for i in others if _place(found[i]) not in known), None)
            if strange is not None:
                return f"item {strange} is of no plan of this program"
            return number, begin
    return f"from item {seq} on, its mission agrees with no plan of this program"


def _is_current(dialect: Dialect, seq: int, plan: range, n_items: int) -> bool:
    """Return whether a vehicle whose current item is `seq` flies the plan with these indices."""
    if seq in plan:
        return True
    if dialect.uploads_atomically:
        # Earlier items stay in front of the plan, so that the vehicle keeps its current item.
        return plan.stop == n_items and seq < plan.start
    return seq < plan.start == dialect.first_waypoint_seq  # the climb before the first plan


def _place(item: MissionItem) -> tuple[int, int, int]:
    return item.command, item.x, item.y
