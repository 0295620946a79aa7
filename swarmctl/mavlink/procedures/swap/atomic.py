"""The swap where a new mission takes the old one's place when it is complete: it flies on meanwhile."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from swarmctl.core.mission import MissionItem
from swarmctl.core.vehicle import Landed
from swarmctl.mavlink.dialects.plan import LAND, behind
from swarmctl.mavlink.procedures.guarded import WARNING, Seen, Theirs, in_modes, look, set_mode
from swarmctl.mavlink.procedures.land import is_out_of_turn
from swarmctl.mavlink.procedures.set_current import jump_to, see_current
from swarmctl.mavlink.procedures.swap.steps import BLIND, MOST_ITEMS, NOT_ON_IT, Flown, Way, held, see_it_fly
from swarmctl.mavlink.procedures.verified_upload import Placed, put, read_back
from swarmctl.mavlink.protocol.mission_download import DownloadOutcome
from swarmctl.mavlink.protocol.outcome import Swapped
from swarmctl.mavlink.protocol.procedure import Context, Procedure

REJECTED = (
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


def swap_at_once(ctx: Context, way: Way) -> Procedure[Swapped]:
    """Upload, read back, see it flown; or back to the old mission.

    A plan that leaves the old one ahead is put behind what is flown of that, number by number: the vehicle
    keeps its current item, wherever it has got to. Of another the item to fly is marked.

    One try: it flies on meanwhile, and who is past where the new plan leaves the old one by then is not given
    the last item of it. Raises HandsOff.
    """
    old = Flown.by(ctx)
    items: tuple[MissionItem, ...] = way.items
    marked: int | None = ctx.dialect.first_waypoint_seq
    if way.leaves_ahead and old.items and ctx.state.mode == ctx.dialect.mission_mode:
        items, marked = _grown(ctx, way, old)
    n_texts, before = ctx.telemetry.n_texts, ctx.state.mission_seq or 0
    placed = yield from _placed(ctx, way, items, marked, before)
    failure = placed.failure
    if failure is None:
        way.taken_over_s = placed.uploaded_s
        failure = yield from _taken_up(ctx, way, marked, min(before, len(items) - 1), n_texts)
        if failure is None:
            return Swapped(None, "new")
    elif _flies_still(ctx, old, placed.found):
        ctx.on_vehicle = placed.found
        return Swapped(failure, "old", is_late=placed.is_late)
    second = yield from _return(ctx, way, old)
    if second is None:
        return Swapped(failure, "old")
    return (yield from held(ctx, way, f"{failure}; back to the old mission: {second}"))


def _grown(ctx: Context, way: Way, old: Flown) -> tuple[tuple[MissionItem, ...], int | None]:
    """The old plan up to where the new one goes on, and that, with no item marked; the new one by itself
    where that is too long."""
    first, flown = ctx.dialect.first_waypoint_seq, old.seq
    begins, passed = way.items[first], list[MissionItem]()
    if _place(old.items[flown - 1]) == _place(begins):
        flown -= 1
    else:
        # What it passes on its way there counts as well, also where the new plan does not name it.
        for item in old.items[flown:]:
            if _place(item) == _place(begins) or not way.ahead.begins_over(item):
                break
            passed.append(replace(item, z=begins.z))
    grown = behind((*old.items[:flown], *passed), way.items, first)
    return (grown, None) if len(grown) <= MOST_ITEMS else (way.items, first)


def _place(item: MissionItem) -> tuple[int, int]:
    return item.x, item.y


def _placed(
    ctx: Context, way: Way, items: tuple[MissionItem, ...], marked: int | None, before: int
) -> Procedure[Placed]:
    """Put the new mission on a vehicle that flies `before`, or holds, once; where that fails, with what is
    there instead, if that could be read."""
    yield from look(ctx, _ours(way))

    def too_late(answers_after_s: float) -> bool:
        return way.is_blind(ctx) or way.is_past(ctx, answers_after_s)

    placed = yield from put(ctx, items, marked, tries=1, flown=before, too_late=too_late)
    if placed.failure is None:
        return placed
    if placed.is_late and way.is_blind(ctx):
        placed = replace(placed, failure=BLIND, is_late=False)
    # What it has taken up it flies, though only reading back has failed.
    read = yield from read_back(ctx)
    if read.outcome is not DownloadOutcome.COMPLETE:
        return placed
    yield from look(ctx, in_modes(way.ours))
    if ctx.dialect.differences(items, read.items):
        return replace(placed, found=read.items)
    ctx.on_vehicle = read.items
    return replace(placed, failure=None, found=read.items)


def _taken_up(ctx: Context, way: Way, marked: int | None, kept: int, n_texts: int) -> Procedure[str | None]:
    """See a vehicle fly the mission that was put on it: from the item that is marked, or from where it is,
    which was `kept`. It has said `n_texts` before."""
    items = ctx.on_vehicle
    if _has_landed_by(ctx, items):
        return None
    try:
        if marked is None:
            # What is told from now on is of the new mission.
            yield from see_current(ctx, lambda _now: True)
            if is_out_of_turn(items, ctx.state.mission_seq or 0):
                # Its number was of the old mission's landing, and is of another landing now.
                return "it had got to its landing before the new mission was complete"
            return (yield from _flown_from(ctx, way, kept))
        return (yield from _fly(ctx, way, marked, lambda now: _got_to(ctx, way, marked, kept, now)))
    except Theirs:
        why = _rejects(ctx, n_texts)
        if why is None:
            raise
        way.ours.add(ctx.dialect.hold_mode)
        return why


def _has_landed_by(ctx: Context, items: tuple[MissionItem, ...]) -> bool:
    """Whether it has flown them to their end while they were read back, and is down."""
    state, seq = ctx.state, ctx.state.mission_seq
    is_down = not state.armed and state.landed is Landed.ON_GROUND and state.mode == ctx.dialect.mission_mode
    return is_down and seq is not None and seq < len(items) and items[seq].command == LAND


def _got_to(ctx: Context, way: Way, marked: int, kept: int, now: int) -> bool:
    """Whether it was flown to the marked item first, if `now` is its current one: it may have got on since.

    Before `kept`, the number that it flew, it can only be so. From that on it may have gone on by number
    instead, and then it is somewhere else.
    """
    first = ctx.dialect.first_waypoint_seq
    if marked <= now < kept or now == marked:
        return True
    return now > marked and way.ahead.is_on_leg_to(now - first, ctx.state)


def _rejects(ctx: Context, n_texts: int) -> str | None:
    """What it said of the mission it was given, where it holds for that; None where others have it hold.

    PX4 takes a mission that it cannot fly, complains, and leaves the mission's mode by itself.
    """
    return complaint(ctx, n_texts) if ctx.state.mode == ctx.dialect.hold_mode else None


def complaint(ctx: Context, n_texts: int) -> str | None:
    """Why it would not fly the mission that it was given since it had said `n_texts`, in its words."""
    said = [text for severity, text in ctx.telemetry.texts_since(n_texts) if severity <= WARNING]
    about = [text for text in said if any(words in text.lower() for words in REJECTED)]
    return about[-1] if about else None


def _flies_still(ctx: Context, old: Flown, there: tuple[MissionItem, ...]) -> bool:
    """Whether it flies the old mission as if nothing had been: the new one was refused, or never complete."""
    is_there = bool(there) and bool(old.items) and not ctx.dialect.differences(old.items, there)
    return is_there and ctx.state.mode == ctx.dialect.mission_mode


def _return(ctx: Context, way: Way, old: Flown) -> Procedure[str | None]:
    """To the old mission, where it is still on its way; returns why not."""
    yield from look(ctx, _ours(way))
    seq = old.item(ctx)
    if seq is None:
        return NOT_ON_IT if old.items else "it is not known"
    placed = yield from put(ctx, old.items, seq)
    if placed.failure:
        return placed.failure
    seq = old.item(ctx)  # it has flown on meanwhile
    if seq is None:
        return NOT_ON_IT
    return (yield from _fly(ctx, way, seq, lambda now: now == seq))


def _fly(ctx: Context, way: Way, seq: int, is_right: Callable[[int], bool]) -> Procedure[str | None]:
    failure = None
    if not (yield from see_current(ctx, is_right)):
        failure = yield from jump_to(ctx, seq, _ours(way))
    return failure or (yield from _flown_from(ctx, way, seq))


def _flown_from(ctx: Context, way: Way, seq: int) -> Procedure[str | None]:
    """In its mission's mode, under way to the item `seq` or a later one."""
    failure = yield from set_mode(ctx, ctx.dialect.mission_mode, _ours(way), armed=True)
    return failure or (yield from see_it_fly(ctx, seq))


def _ours(way: Way) -> Seen:
    return in_modes(way.ours, armed=True)
