"""Swap in hold: the vehicle holds while its mission is replaced item by item."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum

from swarmctl.core.mission import MissionItem
from swarmctl.mavlink.procedures.guarded import UNTIL_REPLACED_S, confirm_state
from swarmctl.mavlink.procedures.set_current import set_current_item
from swarmctl.mavlink.procedures.swap.machine import (
    NOT_ON_OLD_MISSION,
    PAST_SPLICE,
    POSITION_UNKNOWN,
    Machine,
    OldPlan,
    Swap,
    Table,
)
from swarmctl.mavlink.procedures.verified_upload import upload_mission
from swarmctl.mavlink.protocol.outcome import Swapped
from swarmctl.mavlink.protocol.procedure import Procedure

HOLD_LIMIT_S = 120.0
"""time in hold after which no further upload begins, because holding uses battery; then the agent decides"""


class State(StrEnum):
    ENTERING_HOLD = "entering hold"
    UPLOADING_NEW = "uploading the new mission in hold"
    STARTING_NEW = "starting the new mission"
    UPLOADING_OLD = "uploading the old mission in hold"
    STARTING_OLD = "starting the old mission"
    HOLDING = "holding after a failure"


Step = Procedure[State | Swapped]
HOLDING_STATES = frozenset({State.UPLOADING_NEW, State.UPLOADING_OLD, State.HOLDING})
"""states in which the vehicle holds, as confirmed by a heartbeat"""


class SwapInHold(Machine[State]):
    """Hold, upload, read back, set the current item, fly; after a failure do the same with the old mission.

    After a second failure, or after HOLD_LIMIT_S, the vehicle stays in hold.
    """

    def table(self) -> Table[State]:
        new, old, hold = State.UPLOADING_NEW, State.UPLOADING_OLD, State.HOLDING
        return {
            State.ENTERING_HOLD: (self._enter_hold, {new, old, hold, "old", "unknown"}),
            State.UPLOADING_NEW: (self._upload_new, {State.STARTING_NEW, old, hold}),
            State.STARTING_NEW: (self._start_new, {old, hold, "new"}),
            State.UPLOADING_OLD: (self._upload_old, {State.STARTING_OLD, hold}),
            State.STARTING_OLD: (self._start_old, {hold, "old"}),
            State.HOLDING: (self._hold, {"hold"}),
        }

    def __init__(self, swap: Swap, old: OldPlan) -> None:
        super().__init__(swap, old)
        self._seq = 0
        """item from which the vehicle flies on"""
        self._until_s = 0.0
        """end of HOLD_LIMIT_S, by the vehicle's clock"""

    def _enter_hold(self) -> Step:
        ctx, swap, old = self.ctx, self.swap, self.old
        if failure := (yield from self.enter_hold()):
            yield from confirm_state(ctx, self.in_mission)
            text = f"the vehicle does not hold: {failure} [no-hold]"
            return Swapped(text, "old" if old.items else "unknown")
        self._until_s = ctx.state.time_boot_s + HOLD_LIMIT_S
        if old.items and swap.is_past_splice(0.0):
            return self._after(PAST_SPLICE, is_late=True)
        return self._after(POSITION_UNKNOWN) if swap.lacks_position() else State.UPLOADING_NEW

    def _upload_new(self) -> Step:
        failure = yield from self._upload(self.swap.items, lambda: self.first + self.swap.next_waypoint())
        return self._after(failure) if failure else State.STARTING_NEW

    def _start_new(self) -> Step:
        if failure := (yield from self._start()):
            return self._after(failure)
        self.swap.current_since_s = self.ctx.state.time_boot_s
        return Swapped(None, "new")

    def _upload_old(self) -> Step:
        failure = yield from self._upload(self.old.items, lambda: self._seq)
        return self._after_second(failure) if failure else State.STARTING_OLD

    def _start_old(self) -> Step:
        failure = yield from self._start()
        return self._after_second(failure) if failure else self.failed

    def _hold(self) -> Step:
        yield from confirm_state(self.ctx, self.in_hold)
        return self.failed

    def _after(self, failure: str, *, is_late: bool = False) -> State:
        """Return the state after a failure of the new mission: back to the old mission if possible."""
        self.failed = Swapped(failure, "hold")
        if self._is_over():
            limit = f"the vehicle has held for more than {HOLD_LIMIT_S:g} s [hold-limit]"
            self.failed = Swapped(f"{failure}; {limit}", "hold")
        elif self.old.items:
            seq = self.old.next_item(self.ctx)
            if seq is None:
                return self._after_second(NOT_ON_OLD_MISSION)
            self._seq, self.failed = seq, Swapped(failure, "old", is_late=is_late)
            return State.UPLOADING_OLD
        return State.HOLDING

    def _after_second(self, failure: str) -> State:
        self.failed = Swapped(f"{self.failed.failure}; back to the old mission: {failure}", "hold")
        return State.HOLDING

    def _is_over(self) -> bool:
        return self.ctx.state.time_boot_s > self._until_s

    def _upload(self, items: tuple[MissionItem, ...], first: Callable[[], int]) -> Procedure[str | None]:
        """Upload `items` and make item `first()` current; return the failure."""
        yield from confirm_state(self.ctx, self.in_hold)
        uploaded = yield from upload_mission(self.ctx, items, is_over=self._is_over)
        if uploaded.failure:
            return uploaded.failure
        self._seq = first()
        return (yield from set_current_item(self.ctx, self._seq, self.in_hold, lasts_s=UNTIL_REPLACED_S))

    def _start(self) -> Procedure[str | None]:
        """Make the vehicle fly its mission; return the failure, with the vehicle in hold again."""
        if failure := (yield from self.fly_on(self._seq, self.in_hold)):
            yield from self.hold_after(failure)
        return failure
