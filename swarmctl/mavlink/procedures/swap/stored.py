"""Swap to a plan that is stored already: the vehicle holds, and flies its stored mission from an item on.

Nothing is uploaded. A member that leaves its group goes on by its own mission in this way. A PX4 far away
from the first position of its mission does not fly it, so there a new mission is uploaded instead.
"""

from __future__ import annotations

import math
from enum import StrEnum

from swarmctl.core.geo import distance_m
from swarmctl.core.mission import MissionItem
from swarmctl.mavlink.dialects import Dialect
from swarmctl.mavlink.dialects.plan import append_items
from swarmctl.mavlink.procedures.guarded import UNTIL_REPLACED_S, confirm_state
from swarmctl.mavlink.procedures.set_current import set_current_item
from swarmctl.mavlink.procedures.swap.machine import Machine, OldPlan, Swap, Table
from swarmctl.mavlink.protocol.outcome import Swapped
from swarmctl.mavlink.protocol.procedure import Context, Procedure


class State(StrEnum):
    SETTING_ITEM = "making an item of the stored mission current"
    STARTING = "starting the stored mission"
    HOLDING = "holding with the stored mission"


Step = Procedure[State | Swapped]
HOLDING_STATES = frozenset({State.SETTING_ITEM, State.HOLDING})
"""states in which the vehicle holds, as confirmed by a heartbeat"""


def stored_at(ctx: Context, items: tuple[MissionItem, ...]) -> int | None:
    """Return the index in the stored mission of a plan's first waypoint.

    The last place counts: a list may hold earlier plans with the same items. The result is None if the plan
    is not stored, or if the vehicle is too far away to fly its stored mission.
    """
    stored, first = ctx.verified_items, ctx.dialect.first_waypoint_seq
    within_m, here = ctx.dialect.flies_stored_within_m, ctx.state.lat_lon
    if within_m < math.inf and stored:
        begins = stored[0].x * 1e-7, stored[0].y * 1e-7
        if here is None or distance_m(begins, here) >= within_m:
            return None
    indices = range(len(stored) - len(items) + first, first - 1, -1)
    return next((begin for begin in indices if is_stored_at(ctx.dialect, stored, items, begin)), None)


def is_stored_at(
    dialect: Dialect, stored: tuple[MissionItem, ...], items: tuple[MissionItem, ...], begin: int
) -> bool:
    """Return whether index `begin` of a stored list has a mission's items from its first waypoint on."""
    expected = append_items(stored[:begin], items, dialect.first_waypoint_seq)[begin:]
    return not dialect.differences(expected, stored[begin : begin + len(expected)], begin)


class StoredSwap(Machine[State]):
    """Make the plan's first stored item current, and fly the mission; after a failure the vehicle holds."""

    def table(self) -> Table[State]:
        return {
            State.SETTING_ITEM: (self._set_item, {State.STARTING, State.HOLDING}),
            State.STARTING: (self._start, {State.HOLDING, "new"}),
            State.HOLDING: (self._hold, {"hold"}),
        }

    def __init__(self, swap: Swap, old: OldPlan, begin: int) -> None:
        super().__init__(swap, old)
        self._begin = begin
        """index of the plan's first waypoint in the stored mission"""

    def _set_item(self) -> Step:
        yield from confirm_state(self.ctx, self.in_hold)
        failure = yield from set_current_item(self.ctx, self._begin, self.in_hold, lasts_s=UNTIL_REPLACED_S)
        return self._after(failure) if failure else State.STARTING

    def _start(self) -> Step:
        ctx = self.ctx
        if failure := (yield from self.fly_on(self._begin, self.in_hold)):
            yield from self.hold_after(failure)
            return self._after(failure)
        self.swap.current_since_s = ctx.state.time_boot_s
        if not ctx.dialect.uploads_atomically:
            ctx.plan_first_seq = self._begin  # earlier plans stay stored before it
        return Swapped(None, "new")

    def _hold(self) -> Step:
        yield from confirm_state(self.ctx, self.in_hold)
        return self.failed

    def _after(self, failure: str) -> State:
        self.failed = Swapped(failure, "hold")
        return State.HOLDING
