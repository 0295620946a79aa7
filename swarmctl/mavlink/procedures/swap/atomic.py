"""Atomic swap: a completed upload replaces the old mission while the vehicle flies on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from swarmctl.core.mission import MissionItem
from swarmctl.core.vehicle import Landed
from swarmctl.mavlink.dialects.plan import LAND, append_items
from swarmctl.mavlink.procedures.guarded import (
    WARNING,
    WHILE_RECENT_S,
    CommandLate,
    StateCondition,
    TakenOver,
    confirm_state,
    in_modes,
    set_mode,
)
from swarmctl.mavlink.procedures.land import is_landing_item_except_entry
from swarmctl.mavlink.procedures.set_current import await_current_item, set_current_item
from swarmctl.mavlink.procedures.swap.steps import (
    MAX_ITEMS,
    NOT_ON_OLD_MISSION,
    POSITION_UNKNOWN,
    OldPlan,
    SwapPlan,
    confirm_flying,
    end_in_hold,
)
from swarmctl.mavlink.procedures.verified_upload import VerifiedUpload, read_back, upload_mission
from swarmctl.mavlink.protocol.mission_download import DownloadOutcome
from swarmctl.mavlink.protocol.outcome import Swapped
from swarmctl.mavlink.protocol.procedure import Context, Procedure

REJECTION_TEXTS = (
    "mission rejected",
    "no valid mission",
    "geofence violation for waypoint",
    "geofence breach on path",
    "geofence requires valid home",
    "first waypoint too far away",
    "distance between waypoint",
    "is out of bounds",
    "mission item could not be set",
)
"""parts of PX4's texts (mission_feasibility_checker.cpp, MissionFeasibility/, navigator/mission_base.cpp)"""


def swap_atomic(ctx: Context, plan: SwapPlan) -> Procedure[Swapped]:
    """Upload and read back the new mission and confirm that it is flown.

    After a failure fly the old mission, or hold. Raises NotInControl.

    If the new plan begins with the old plan's next waypoints (`leaves_ahead`), the upload has the items
    already flown, then the new plan. The common items keep their numbers, so the vehicle keeps its current
    item. For any other plan the upload marks the first waypoint as current (`current` = 1).

    The vehicle flies on during the upload, so the upload is tried once. If `leaves_ahead`, the last item is
    withheld from a vehicle that has passed the splice point, is off the new route or reports no position.
    """
    old = OldPlan.of(ctx)
    items: tuple[MissionItem, ...] = plan.items
    marked: int | None = ctx.dialect.first_waypoint_seq
    if plan.leaves_ahead and old.items and ctx.state.mode == ctx.dialect.mission_mode:
        items, marked = _joined(ctx, plan, old)
    n_texts, flown = ctx.telemetry.n_texts, ctx.state.mission_seq or 0
    uploaded = yield from _upload(ctx, plan, items, marked, flown)
    failure = uploaded.failure
    if failure is None:
        plan.current_since_s = uploaded.uploaded_s
        failure = yield from _confirm_new_mission(ctx, plan, marked, min(flown, len(items) - 1), n_texts)
        if failure is None:
            return Swapped(None, "new")
    elif _still_flies_old(ctx, old, uploaded.found):
        ctx.verified_items = uploaded.found
        return Swapped(failure, "old", is_late=uploaded.is_late)
    second = yield from _return_to_old(ctx, plan, old)
    if second is None:
        return Swapped(failure, "old")
    return (yield from end_in_hold(ctx, plan, f"{failure}; back to the old mission: {second}"))


def _joined(ctx: Context, plan: SwapPlan, old: OldPlan) -> tuple[tuple[MissionItem, ...], int | None]:
    """Return the old plan's items before the current item, then the new plan; and None: no item is marked.

    If this list is too long, return the new plan alone, and its first waypoint as the item to mark.
    """
    first, n_before = ctx.dialect.first_waypoint_seq, old.seq
    waypoint, on_first_leg = plan.items[first], list[MissionItem]()
    # The plan leaves out items that the vehicle has passed, but the last MISSION_CURRENT may be older.
    n_before += old.progress.leg_over(waypoint) or 0
    if n_before > first and _position(old.items[n_before - 1]) == _position(waypoint):
        n_before -= 1
    else:
        # Old items on the new plan's first leg stay, so that the items after them keep their numbers.
        for item in old.items[n_before:]:
            if _position(item) == _position(waypoint) or plan.progress.leg_over(item) != 0:
                break
            on_first_leg.append(replace(item, z=waypoint.z))
    joined = append_items((*old.items[:n_before], *on_first_leg), plan.items, first)
    return (joined, None) if len(joined) <= MAX_ITEMS else (plan.items, first)


def _position(item: MissionItem) -> tuple[int, int]:
    return item.x, item.y


def _beginning_here(ctx: Context, items: tuple[MissionItem, ...]) -> tuple[MissionItem, ...]:
    """Return the items with the take-off, which a flying vehicle skips, at the vehicle's position.

    PX4 1.14 and 1.15 do not fly a mission whose first position is MIS_DIST_1WP (900 m) or more from the
    vehicle (`FeasibilityChecker::checkHorizontalDistanceToFirstWaypoint`); 1.16 only warns.
    """
    lat_deg, lon_deg = ctx.state.lat_deg, ctx.state.lon_deg
    if lat_deg is None or lon_deg is None:
        return items
    return (replace(items[0], x=round(lat_deg * 1e7), y=round(lon_deg * 1e7)), *items[1:])


def _upload(
    ctx: Context, plan: SwapPlan, items: tuple[MissionItem, ...], marked: int | None, flown: int
) -> Procedure[VerifiedUpload]:
    """Upload the new mission, with one try. `flown`: the vehicle's current item, in mission mode or in hold.

    After a failure `found` has the items on the vehicle, if they could be read.
    """
    yield from confirm_state(ctx, _in_own_modes(plan))
    items = _beginning_here(ctx, items)

    def too_late(round_trip_s: float) -> bool:
        return plan.lacks_position(ctx) or plan.is_past_splice(ctx, round_trip_s)

    uploaded = yield from upload_mission(ctx, items, marked, tries=1, flown=flown, too_late=too_late)
    if uploaded.failure is None:
        return uploaded
    if uploaded.is_late and plan.lacks_position(ctx):
        uploaded = replace(uploaded, failure=POSITION_UNKNOWN, is_late=False)
    # Perhaps only the read-back failed, and the vehicle already flies the new mission. So read again.
    read = yield from read_back(ctx)
    if read.outcome is not DownloadOutcome.COMPLETE:
        return uploaded
    yield from confirm_state(ctx, in_modes(plan.own_modes))
    if ctx.dialect.differences(items, read.items):
        return replace(uploaded, found=read.items)
    ctx.verified_items = read.items
    return replace(uploaded, failure=None, found=read.items)


def _confirm_new_mission(
    ctx: Context, plan: SwapPlan, marked: int | None, flown: int, n_texts: int
) -> Procedure[str | None]:
    """Wait until the vehicle flies the new mission from item `marked`, or from `flown` if `marked` is None.

    Return the failure. `n_texts`: number of the vehicle's texts before the upload.
    """
    items = ctx.verified_items
    if _has_flown_and_landed(ctx, items):
        return None
    try:
        if marked is None:
            # The next MISSION_CURRENT is about the new mission.
            yield from await_current_item(ctx, lambda _current: True)
            if is_landing_item_except_entry(items, ctx.state.mission_seq or 0):
                # Before the upload this number may have been an item of another landing, or no landing item.
                return "the vehicle reached its landing before the new mission was complete [landing-reached]"
            return (yield from _fly_mission_from(ctx, plan, flown))
        return (
            yield from _make_current_and_fly(
                ctx, plan, marked, lambda current: _begins_at_marked(ctx, plan, marked, flown, current)
            )
        )
    except TakenOver:
        why = _rejection_in_hold(ctx, n_texts)
        if why is None:
            raise
        plan.own_modes.add(ctx.dialect.hold_mode)
        return why


def _has_flown_and_landed(ctx: Context, items: tuple[MissionItem, ...]) -> bool:
    """Return whether the vehicle has already flown the items and landed."""
    state, seq = ctx.state, ctx.state.mission_seq
    is_down = not state.armed and state.landed is Landed.ON_GROUND and state.mode == ctx.dialect.mission_mode
    return is_down and seq is not None and seq < len(items) and items[seq].command == LAND


def _begins_at_marked(ctx: Context, plan: SwapPlan, marked: int, flown: int, current: int) -> bool:
    """Return whether the vehicle has begun the new mission at the marked item.

    The marked item proves this, and any item from the marked item up to below `flown`, the item flown before.
    Any other higher number may be of the old mission, so the vehicle has to be near the leg to `current`.
    """
    first = ctx.dialect.first_waypoint_seq
    if marked <= current < flown or current == marked:
        return True
    return current > marked and plan.progress.is_near_leg_to(current - first, ctx.state)


def _rejection_in_hold(ctx: Context, n_texts: int) -> str | None:
    """Return the vehicle's text if the vehicle holds because of a rejected mission, else None.

    PX4 accepts a mission that it cannot fly, sends a text, and leaves mission mode.
    """
    return rejection_text(ctx, n_texts) if ctx.state.mode == ctx.dialect.hold_mode else None


def rejection_text(ctx: Context, n_texts: int) -> str | None:
    """Return the vehicle's last text that rejects a mission, or None; the first `n_texts` do not count."""
    warnings = [text for severity, text in ctx.telemetry.texts_since(n_texts) if severity <= WARNING]
    rejections = [text for text in warnings if any(part in text.lower() for part in REJECTION_TEXTS)]
    return rejections[-1] if rejections else None


def _still_flies_old(ctx: Context, old: OldPlan, found: tuple[MissionItem, ...]) -> bool:
    """Return whether the vehicle still flies the old mission, after a refused or incomplete upload."""
    is_stored = bool(found) and bool(old.items) and not ctx.dialect.differences(old.items, found)
    return is_stored and ctx.state.mode == ctx.dialect.mission_mode


def _return_to_old(ctx: Context, plan: SwapPlan, old: OldPlan) -> Procedure[str | None]:
    """Make a vehicle that is still on the old route fly the old mission; return the failure."""
    yield from confirm_state(ctx, _in_own_modes(plan))
    seq = old.next_item(ctx)
    if seq is None:
        return NOT_ON_OLD_MISSION if old.items else "the old mission is unknown"
    uploaded = yield from upload_mission(ctx, _beginning_here(ctx, old.items), seq)
    if uploaded.failure:
        return uploaded.failure
    seq = old.next_item(ctx)  # the vehicle has flown on during the upload
    if seq is None:
        return NOT_ON_OLD_MISSION
    return (yield from _make_current_and_fly(ctx, plan, seq, lambda current: current == seq))


def _make_current_and_fly(
    ctx: Context, plan: SwapPlan, seq: int, is_right: Callable[[int], bool]
) -> Procedure[str | None]:
    failure = None
    if not (yield from await_current_item(ctx, is_right)):
        try:
            failure = yield from set_current_item(ctx, seq, _in_own_modes(plan), lasts_s=WHILE_RECENT_S)
        except CommandLate as why:
            failure = str(why)
    return failure or (yield from _fly_mission_from(ctx, plan, seq))


def _fly_mission_from(ctx: Context, plan: SwapPlan, seq: int) -> Procedure[str | None]:
    """Set mission mode and wait until the vehicle flies to item `seq` or a later item; return the failure."""
    failure = yield from set_mode(ctx, ctx.dialect.mission_mode, _in_own_modes(plan), armed=True)
    return failure or (yield from confirm_flying(ctx, seq))


def _in_own_modes(plan: SwapPlan) -> StateCondition:
    return in_modes(plan.own_modes, armed=True)
