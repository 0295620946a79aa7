"""Atomic swap: a completed upload replaces the old mission while the vehicle flies on."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum

from swarmctl.core.mission import MissionItem
from swarmctl.core.records import replace
from swarmctl.core.vehicle import Landed
from swarmctl.mavlink.dialects.plan import LAND, append_items
from swarmctl.mavlink.procedures.guarded import (
    WARNING,
    WHILE_RECENT_S,
    CommandLate,
    TakenOver,
    confirm_state,
    in_modes,
)
from swarmctl.mavlink.procedures.land import is_landing_item_except_entry
from swarmctl.mavlink.procedures.set_current import await_current_item, set_current_item
from swarmctl.mavlink.procedures.swap.machine import (
    MAX_ITEMS,
    NOT_ON_OLD_MISSION,
    POSITION_UNKNOWN,
    Machine,
    OldPlan,
    Swap,
    Table,
)
from swarmctl.mavlink.procedures.verified_upload import read_back, upload_mission
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


class State(StrEnum):
    UPLOADING = "uploading the new mission"
    CHECKING = "reading which mission is stored"
    CONFIRMING = "confirming that the new mission is flown"
    RESTORING = "restoring the old mission"
    ENTERING_HOLD = "entering hold"


Step = Procedure[State | Swapped]


class AtomicSwap(Machine[State]):
    """Upload and read back the new mission and confirm that it is flown.

    If the new plan begins with the old plan's next waypoints (`leaves_ahead`), the upload has the items
    already flown, then the new plan. The common items keep their numbers, so the vehicle keeps its current
    item. For any other plan the upload marks the first waypoint as current (`current` = 1).

    The vehicle flies on during the upload, so the upload is tried once. If `leaves_ahead`, the last item is
    withheld from a vehicle that has passed the splice point, is off the new route or reports no position.
    """

    def table(self) -> Table[State]:
        return {
            State.UPLOADING: (self._upload, {State.CONFIRMING, State.CHECKING}),
            State.CHECKING: (self._check, {State.CONFIRMING, State.RESTORING, "old"}),
            State.CONFIRMING: (self._confirm, {State.RESTORING, "new"}),
            State.RESTORING: (self._restore, {State.ENTERING_HOLD, "old"}),
            State.ENTERING_HOLD: (self._hold, {"hold"}),
        }

    def __init__(self, swap: Swap, old: OldPlan) -> None:
        super().__init__(swap, old)
        self._items, self._marked = self._items_and_mark()
        self._flown = self.ctx.state.mission_seq or 0
        """item that the vehicle flew before the upload, in mission mode or in hold"""
        self._n_texts = self.ctx.telemetry.n_texts
        """number of the vehicle's texts before the upload"""

    def _upload(self) -> Step:
        """Upload the new mission and read it back."""
        ctx, swap = self.ctx, self.swap
        yield from confirm_state(ctx, self.in_own_modes)
        self._items = _beginning_here(ctx, self._items)
        uploaded = yield from upload_mission(
            ctx,
            self._items,
            self._marked,
            tries=1,
            too_late=lambda round_trip_s: swap.lacks_position() or swap.is_past_splice(round_trip_s),
        )
        swap.current_since_s = uploaded.uploaded_s
        if uploaded.failure is None:
            return State.CONFIRMING
        self.failed = Swapped(uploaded.failure, "old", is_late=uploaded.is_late)
        if uploaded.is_late and swap.lacks_position():
            self.failed = Swapped(POSITION_UNKNOWN, "old")
        return State.CHECKING

    def _check(self) -> Step:
        """Read the stored mission: if only the read-back failed, the vehicle flies the new mission."""
        ctx, old = self.ctx, self.old.items
        read = yield from read_back(ctx)
        if read.outcome is not DownloadOutcome.COMPLETE:
            return State.RESTORING
        yield from confirm_state(ctx, in_modes(self.swap.own_modes))
        is_new = not ctx.dialect.differences(self._items, read.items)
        is_old = bool(old) and not ctx.dialect.differences(old, read.items)
        if not is_new and not (is_old and ctx.state.mode == self.mission_mode):
            return State.RESTORING
        ctx.verified_items = read.items
        return State.CONFIRMING if is_new else self.failed

    def _confirm(self) -> Step:
        """Confirm that the vehicle flies the new mission."""
        ctx = self.ctx
        if _has_flown_and_landed(ctx):
            return Swapped(None, "new")
        try:
            failure = yield from self._fly_new()
        except TakenOver:
            # PX4 accepts a mission that it cannot fly, sends a text, and leaves mission mode.
            failure = rejection_text(ctx, self._n_texts)
            if failure is None or ctx.state.mode != self.hold_mode:
                raise
            self.swap.own_modes.add(self.hold_mode)
        if failure is None:
            return Swapped(None, "new")
        self.failed = Swapped(failure, "old")
        return State.RESTORING

    def _restore(self) -> Step:
        """Make a vehicle that is still on the old route fly the old mission."""
        yield from confirm_state(self.ctx, self.in_own_modes)
        failure = yield from self._fly_old()
        if failure is None:
            return Swapped(self.failed.failure, "old")
        self.failed = Swapped(f"{self.failed.failure}; back to the old mission: {failure}", "hold")
        return State.ENTERING_HOLD

    def _hold(self) -> Step:
        yield from self.hold_after(self.failed.failure or "")
        return self.failed

    def _items_and_mark(self) -> tuple[tuple[MissionItem, ...], int | None]:
        """Return the items to upload, and the item to mark as current.

        If the new plan begins like the old plan, the old plan's items before the current item stand before
        the new plan, and no item is marked. If that list is too long, the new plan stands alone.
        """
        swap, old, new, first = self.swap, self.old, self.swap.items, self.first
        if not (swap.plan.leaves_ahead and old.items and self.ctx.state.mode == self.mission_mode):
            return new, first
        waypoint, on_first_leg = new[first], list[MissionItem]()
        # The plan leaves out items that the vehicle has passed, but the last MISSION_CURRENT may be older.
        # A plan may also go straight to a later waypoint of the old one: items ahead are no such items.
        n_behind = old.progress.n_behind(self.ctx.state)
        n_before = old.seq + min(old.progress.leg_over(waypoint) or 0, n_behind)
        if n_before > first and _position(old.items[n_before - 1]) == _position(waypoint):
            n_before -= 1
        else:
            # Old items on the new plan's first leg stay, so that the items after them keep their numbers.
            for item in old.items[n_before:]:
                if _position(item) == _position(waypoint) or swap.progress.leg_over(item) != 0:
                    break
                on_first_leg.append(replace(item, z=waypoint.z))
        joined = append_items((*old.items[:n_before], *on_first_leg), new, first)
        return (joined, None) if len(joined) <= MAX_ITEMS else (new, first)

    def _fly_new(self) -> Procedure[str | None]:
        """Make the vehicle fly the new mission; return the failure."""
        ctx, items, marked = self.ctx, self.ctx.verified_items, self._marked
        flown = min(self._flown, len(items) - 1)
        if marked is not None:
            return (yield from self._fly_from(marked, lambda seq: self._begins_at(marked, flown, seq)))
        # The next MISSION_CURRENT is about the new mission.
        yield from await_current_item(ctx, lambda _seq: True)
        if is_landing_item_except_entry(items, ctx.state.mission_seq or 0):
            # Before the upload this number may have been an item of another landing, or no landing item.
            return "the vehicle reached its landing before the new mission was complete [landing-reached]"
        return (yield from self.fly_on(flown, self.in_own_modes))

    def _begins_at(self, marked: int, flown: int, current: int) -> bool:
        """Return whether the vehicle has begun the new mission at the marked item.

        The marked item proves this, and any item up to below `flown`, the item flown before. Any other higher
        number may be of the old mission, so the vehicle has to be near the leg to `current`.
        """
        if marked <= current < flown or current == marked:
            return True
        is_near = self.swap.progress.is_near_leg_to(current - self.first, self.ctx.state)
        return current > marked and is_near

    def _fly_old(self) -> Procedure[str | None]:
        """Upload the old mission and make the vehicle fly it from its next item; return the failure."""
        ctx, old = self.ctx, self.old
        seq = old.next_item(ctx)
        if seq is None:
            return NOT_ON_OLD_MISSION if old.items else "the old mission is unknown"
        uploaded = yield from upload_mission(ctx, _beginning_here(ctx, old.items), seq)
        if uploaded.failure:
            return uploaded.failure
        seq = old.next_item(ctx)  # the vehicle has flown on during the upload
        if seq is None:
            return NOT_ON_OLD_MISSION
        return (yield from self._fly_from(seq, lambda current: current == seq))

    def _fly_from(self, seq: int, is_right: Callable[[int], bool]) -> Procedure[str | None]:
        """Make item `seq` current unless the current item is right, and fly on; return the failure."""
        failure: str | None = None
        if not (yield from await_current_item(self.ctx, is_right)):
            try:
                failure = yield from set_current_item(
                    self.ctx, seq, self.in_own_modes, lasts_s=WHILE_RECENT_S
                )
            except CommandLate as why:
                failure = str(why)
        return failure or (yield from self.fly_on(seq, self.in_own_modes))


def _position(item: MissionItem) -> tuple[int, int]:
    return item.x, item.y


def _beginning_here(ctx: Context, items: tuple[MissionItem, ...]) -> tuple[MissionItem, ...]:
    """Return the items with the take-off, which a flying vehicle skips, at the vehicle's position.

    PX4 1.14 and 1.15 do not fly a mission whose first position is MIS_DIST_1WP (900 m) or more from the
    vehicle (`FeasibilityChecker::checkHorizontalDistanceToFirstWaypoint`); 1.16 only warns.
    """
    if ctx.state.lat_lon is None:
        return items
    x, y = (round(degrees * 1e7) for degrees in ctx.state.lat_lon)
    return (replace(items[0], x=x, y=y), *items[1:])


def _has_flown_and_landed(ctx: Context) -> bool:
    """Return whether the vehicle has already flown its mission and landed."""
    state, seq, items = ctx.state, ctx.state.mission_seq, ctx.verified_items
    is_down = not state.armed and state.landed is Landed.ON_GROUND and state.mode == ctx.dialect.mission_mode
    return is_down and seq is not None and seq < len(items) and items[seq].command == LAND


def rejection_text(ctx: Context, n_texts: int) -> str | None:
    """Return the vehicle's last text that rejects a mission, or None; the first `n_texts` do not count."""
    warnings = [text for severity, text in ctx.telemetry.texts_since(n_texts) if severity <= WARNING]
    rejections = [text for text in warnings if any(part in text.lower() for part in REJECTION_TEXTS)]
    return rejections[-1] if rejections else None
