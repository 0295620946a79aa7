"""The swap where a new mission takes the old one's place when it is complete: it flies on meanwhile."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from swarmctl.core.mission import MissionItem
from swarmctl.core.vehicle import Landed
from swarmctl.mavlink.dialects.plan import LAND, append_items
from swarmctl.mavlink.procedures.guarded import (
    WARNING,
    StateCondition,
    TakenOver,
    confirm_state,
    in_modes,
    set_mode,
)
from swarmctl.mavlink.procedures.land import is_other_landing
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
"""in what PX4 says (mission_feasibility_checker.cpp, MissionFeasibility/, navigator/mission_base.cpp)"""


def swap_atomic(ctx: Context, plan: SwapPlan) -> Procedure[Swapped]:
    """Upload, read back, see it flown; or back to the old mission.

    A plan that leaves the old one ahead is put behind what is flown of that, number by number: the vehicle
    keeps its current item, wherever it has got to. Of another the item to fly is marked.

    One try: it flies on meanwhile, and who is past where the new plan leaves the old one by then is not given
    the last item of it. Raises NotInControl.
    """
    old = OldPlan.of(ctx)
    items: tuple[MissionItem, ...] = plan.items
    marked: int | None = ctx.dialect.first_waypoint_seq
    if plan.leaves_ahead and old.items and ctx.state.mode == ctx.dialect.mission_mode:
        items, marked = _joined(ctx, plan, old)
    n_texts, before = ctx.telemetry.n_texts, ctx.state.mission_seq or 0
    uploaded = yield from _upload(ctx, plan, items, marked, before)
    failure = uploaded.failure
    if failure is None:
        plan.taken_over_s = uploaded.uploaded_s
        failure = yield from _confirm_taken_up(ctx, plan, marked, min(before, len(items) - 1), n_texts)
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
    """The old plan up to where the new one goes on, and that, with no item marked; the new one by itself
    where that is too long."""
    first, flown = ctx.dialect.first_waypoint_seq, old.seq
    begins, passed = plan.items[first], list[MissionItem]()
    if _place(old.items[flown - 1]) == _place(begins):
        flown -= 1
    else:
        # What it passes on its way there counts as well, also where the new plan does not name it.
        for item in old.items[flown:]:
            if _place(item) == _place(begins) or not plan.progress.first_leg_passes(item):
                break
            passed.append(replace(item, z=begins.z))
    joined = append_items((*old.items[:flown], *passed), plan.items, first)
    return (joined, None) if len(joined) <= MAX_ITEMS else (plan.items, first)


def _place(item: MissionItem) -> tuple[int, int]:
    return item.x, item.y


def _upload(
    ctx: Context, plan: SwapPlan, items: tuple[MissionItem, ...], marked: int | None, before: int
) -> Procedure[VerifiedUpload]:
    """Put the new mission on a vehicle that flies `before`, or holds, once; where that fails, with what is
    there instead, if that could be read."""
    yield from confirm_state(ctx, _in_own_modes(plan))

    def too_late(round_trip_s: float) -> bool:
        return plan.lacks_position(ctx) or plan.is_past_split(ctx, round_trip_s)

    uploaded = yield from upload_mission(ctx, items, marked, tries=1, flown=before, too_late=too_late)
    if uploaded.failure is None:
        return uploaded
    if uploaded.is_late and plan.lacks_position(ctx):
        uploaded = replace(uploaded, failure=POSITION_UNKNOWN, is_late=False)
    # What it has taken up it flies, though only reading back has failed.
    read = yield from read_back(ctx)
    if read.outcome is not DownloadOutcome.COMPLETE:
        return uploaded
    yield from confirm_state(ctx, in_modes(plan.own_modes))
    if ctx.dialect.differences(items, read.items):
        return replace(uploaded, found=read.items)
    ctx.verified_items = read.items
    return replace(uploaded, failure=None, found=read.items)


def _confirm_taken_up(
    ctx: Context, plan: SwapPlan, marked: int | None, kept: int, n_texts: int
) -> Procedure[str | None]:
    """See a vehicle fly the mission that was put on it: from the item that is marked, or from where it is,
    which was `kept`. It has said `n_texts` before."""
    items = ctx.verified_items
    if _has_landed_by(ctx, items):
        return None
    try:
        if marked is None:
            # What is told from now on is of the new mission.
            yield from await_current_item(ctx, lambda _now: True)
            if is_other_landing(items, ctx.state.mission_seq or 0):
                # Its number was of the old mission's landing, and is of another landing now.
                return "it had got to its landing before the new mission was complete"
            return (yield from _flown_from(ctx, plan, kept))
        return (yield from _fly(ctx, plan, marked, lambda now: _reached_marked(ctx, plan, marked, kept, now)))
    except TakenOver:
        why = _rejection(ctx, n_texts)
        if why is None:
            raise
        plan.own_modes.add(ctx.dialect.hold_mode)
        return why


def _has_landed_by(ctx: Context, items: tuple[MissionItem, ...]) -> bool:
    """Whether it has flown them to their end while they were read back, and is down."""
    state, seq = ctx.state, ctx.state.mission_seq
    is_down = not state.armed and state.landed is Landed.ON_GROUND and state.mode == ctx.dialect.mission_mode
    return is_down and seq is not None and seq < len(items) and items[seq].command == LAND


def _reached_marked(ctx: Context, plan: SwapPlan, marked: int, kept: int, now: int) -> bool:
    """Whether it was flown to the marked item first, if `now` is its current one: it may have got on since.

    Before `kept`, the number that it flew, it can only be so. From that on it may have gone on by number
    instead, and then it is somewhere else.
    """
    first = ctx.dialect.first_waypoint_seq
    if marked <= now < kept or now == marked:
        return True
    return now > marked and plan.progress.is_near_leg_to(now - first, ctx.state)


def _rejection(ctx: Context, n_texts: int) -> str | None:
    """What it said of the mission it was given, where it holds for that; None where others have it hold.

    PX4 takes a mission that it cannot fly, complains, and leaves the mission's mode by itself.
    """
    return complaint(ctx, n_texts) if ctx.state.mode == ctx.dialect.hold_mode else None


def complaint(ctx: Context, n_texts: int) -> str | None:
    """Why it would not fly the mission that it was given since it had said `n_texts`, in its words."""
    said = [text for severity, text in ctx.telemetry.texts_since(n_texts) if severity <= WARNING]
    about = [text for text in said if any(words in text.lower() for words in REJECTION_TEXTS)]
    return about[-1] if about else None


def _still_flies_old(ctx: Context, old: OldPlan, there: tuple[MissionItem, ...]) -> bool:
    """Whether it flies the old mission as if nothing had been: the new one was refused, or never complete."""
    is_there = bool(there) and bool(old.items) and not ctx.dialect.differences(old.items, there)
    return is_there and ctx.state.mode == ctx.dialect.mission_mode


def _return_to_old(ctx: Context, plan: SwapPlan, old: OldPlan) -> Procedure[str | None]:
    """To the old mission, where it is still on its way; returns why not."""
    yield from confirm_state(ctx, _in_own_modes(plan))
    seq = old.next_item(ctx)
    if seq is None:
        return NOT_ON_OLD_MISSION if old.items else "it is not known"
    uploaded = yield from upload_mission(ctx, old.items, seq)
    if uploaded.failure:
        return uploaded.failure
    seq = old.next_item(ctx)  # it has flown on meanwhile
    if seq is None:
        return NOT_ON_OLD_MISSION
    return (yield from _fly(ctx, plan, seq, lambda now: now == seq))


def _fly(ctx: Context, plan: SwapPlan, seq: int, is_right: Callable[[int], bool]) -> Procedure[str | None]:
    failure = None
    if not (yield from await_current_item(ctx, is_right)):
        failure = yield from set_current_item(ctx, seq, _in_own_modes(plan))
    return failure or (yield from _flown_from(ctx, plan, seq))


def _flown_from(ctx: Context, plan: SwapPlan, seq: int) -> Procedure[str | None]:
    """In its mission's mode, under way to the item `seq` or a later one."""
    failure = yield from set_mode(ctx, ctx.dialect.mission_mode, _in_own_modes(plan), armed=True)
    return failure or (yield from confirm_flying(ctx, seq))


def _in_own_modes(plan: SwapPlan) -> StateCondition:
    return in_modes(plan.own_modes, armed=True)
