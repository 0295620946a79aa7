"""Append swap for autopilots that use each item as soon as it is stored: the new route follows the old route.

No item of the old route changes. After the read-back one command makes an item of the new route current. An
ArduCopter brakes and speeds up again; other vehicles turn without braking. If the link ends before that
command, the vehicle flies its old route and lands.
"""

from __future__ import annotations

from enum import StrEnum

from swarmctl.core.mission import MissionItem
from swarmctl.core.records import replace
from swarmctl.core.vehicle import Landed, VehicleState
from swarmctl.mavlink.procedures.guarded import (
    UNTIL_REPLACED_S,
    CommandLate,
    GuardedCommand,
    TakenOver,
    confirm_state,
    send_guarded,
)
from swarmctl.mavlink.procedures.set_current import await_current_item
from swarmctl.mavlink.procedures.swap.in_hold import SwapInHold
from swarmctl.mavlink.procedures.swap.machine import (
    MAX_ITEMS,
    PAST_SPLICE,
    POSITION_UNKNOWN,
    Machine,
    OldPlan,
    Swap,
    Table,
)
from swarmctl.mavlink.procedures.swap.route_progress import CORNER_MARGIN_S, SAME_PLACE_M, RoutePosition
from swarmctl.mavlink.procedures.verified_upload import read_back
from swarmctl.mavlink.protocol.command import CommandResult
from swarmctl.mavlink.protocol.conversation import Conversation
from swarmctl.mavlink.protocol.mission_append import Append, AppendResult
from swarmctl.mavlink.protocol.mission_download import DownloadOutcome
from swarmctl.mavlink.protocol.outcome import Swapped
from swarmctl.mavlink.protocol.procedure import Procedure
from swarmctl.mavlink.protocol.wait import WaitUntil
from swarmctl.mavlink.telemetry.vehicle_state import STILL_M_S

CLEAR_WAIT_S = 10.0
"""longest wait until the vehicle is clear of corners"""
DECISIONS = 3
"""greatest number of decisions for the change to the new route; each late command needs a new one"""
MAX_BESIDE_LEG_M = 2.0
"""greatest distance from the route at which a vehicle may begin a new leg"""


class State(StrEnum):
    APPENDING = "appending the new route"
    ENDING_LATE = "reading what was appended too late"
    READING_BACK = "reading the new route back"
    CHANGING = "changing to the new route"
    CONFIRMING = "confirming that the new route is flown"
    IN_HOLD = "swapping in hold"


Step = Procedure[State | Swapped]
LATE = Swapped(PAST_SPLICE, "old", is_late=True)


class AppendSwap(Machine[State]):
    """Append the new route, read it back and make it current. If this is impossible or fails, swap in hold.

    A vehicle that is past the splice point, off the new route, landing, or without a known position stays on
    the old route.
    """

    def table(self) -> Table[State]:
        return {
            State.APPENDING: (self._append, {State.READING_BACK, State.ENDING_LATE, State.IN_HOLD}),
            State.ENDING_LATE: (self._end_late, {"old"}),
            State.READING_BACK: (self._read_back, {State.CHANGING, State.IN_HOLD}),
            State.CHANGING: (self._change, {State.CHANGING, State.CONFIRMING, State.IN_HOLD, "old"}),
            State.CONFIRMING: (self._confirm, {State.IN_HOLD, "new"}),
            State.IN_HOLD: (self._swap_in_hold, {"new", "old", "hold", "unknown"}),
        }

    def __init__(self, swap: Swap, old: OldPlan) -> None:
        super().__init__(swap, old)
        self._before = self.ctx.verified_items
        """items stored before the new route"""
        self._tail = swap.items[self.first :]
        """items of the new route"""
        self._found: tuple[MissionItem, ...] = ()
        """items of the new route as read back"""
        self._later_s = 0.0
        """age of telemetry when a command based on it arrives: one round trip [s]"""
        self._n_decisions = 0

    def _append(self) -> Step:
        ctx, n_before = self.ctx, len(self._before)
        is_flown = n_before > 0 and self.in_mission(ctx.state)
        if not is_flown or n_before + len(self._tail) > MAX_ITEMS:
            return State.IN_HOLD
        # From now on the vehicle stores items that are not verified.
        ctx.verified_items = ()
        appended: AppendResult = yield Append(ctx.peer, n_before, self._tail, self.swap.is_past_splice)
        if appended.is_foreign:
            raise TakenOver(f"another station has changed the mission: {appended.failure}")
        if appended.is_late:
            return State.ENDING_LATE
        self._later_s = appended.round_trip_s
        return self._after(appended.failure) if appended.failure else State.READING_BACK

    def _end_late(self) -> Step:
        read = yield from read_back(self.ctx, len(self._before))
        yield from confirm_state(self.ctx, self.in_mission)
        # Without a read-back the stored items are unknown, so the next plan is written as a whole.
        is_complete = read.outcome is DownloadOutcome.COMPLETE
        self.ctx.verified_items = self._before + read.items if is_complete else ()
        return LATE

    def _read_back(self) -> Step:
        ctx, n_before = self.ctx, len(self._before)
        read = yield from read_back(ctx, n_before)
        if read.outcome is not DownloadOutcome.COMPLETE:
            return self._after(read.text)
        if mismatches := ctx.dialect.differences(self._tail, read.items, n_before):
            return self._after(f"read back after the old route: {mismatches[0]}")
        self._found = read.items
        return State.CHANGING

    def _change(self) -> Step:
        """Make the next item of the new route current, as decided now by the vehicle's position.

        After a late command the change is decided anew: the next item may be another one, or the vehicle may
        have to stay on its old route.
        """
        ctx, is_again = self.ctx, self._n_decisions > 0
        self._n_decisions += 1
        yield WaitUntil(self._is_next_item_certain, CLEAR_WAIT_S)
        # A command that was sent before this decision may have taken effect.
        if is_again and (yield from await_current_item(ctx, lambda _seq: self._follows(ctx.state))):
            return State.CONFIRMING
        if (stays := self._stays_on_old()) is not None:
            if is_again and stays.is_late:
                # An earlier command may still be on its way, so the vehicle's route is not certain.
                return self._after(PAST_SPLICE)
            # Another station or the pilot may have ordered a landing.
            yield from confirm_state(ctx, self.in_mission)
            ctx.verified_items = self._before + self._found
            return stays
        order = GuardedCommand(self._next_try, UNTIL_REPLACED_S)
        try:
            failure = yield from send_guarded(
                ctx, order, self.in_mission, self._follows, skip_if_done=is_again
            )
        except CommandLate as why:
            return State.CHANGING if self._n_decisions < DECISIONS else self._after(str(why))
        return self._after(failure) if failure else State.CONFIRMING

    def _confirm(self) -> Step:
        ctx = self.ctx
        self.swap.current_since_s = ctx.state.time_boot_s
        ctx.verified_items, ctx.plan_first_seq = self._before + self._found, len(self._before)
        failure = yield from self.confirm_flying(len(self._before))
        return self._after(failure) if failure else Swapped(None, "new")

    def _swap_in_hold(self) -> Step:
        done = yield from SwapInHold(self.swap, self.old).run()
        if done.failure is None or self.failed.failure is None:
            return done
        return replace(done, failure=f"{self.failed.failure}; {done.failure}")

    def _after(self, failure: str) -> State:
        self.failed = Swapped(failure)
        return State.IN_HOLD

    def _next_try(self, attempt: int) -> Conversation[CommandResult] | None:
        """Return one try of the command; None if it would be too late."""
        is_certain = attempt == 0 or self._is_next_item_certain()
        if not is_certain or self._stays_on_old() is not None:
            return None
        seq = len(self._before) + self.swap.next_waypoint(self._later_s)
        return self.ctx.dialect.set_current(self.ctx.peer, seq, attempt)

    def _follows(self, state: VehicleState) -> bool:
        """Return whether the vehicle flies an item of the new route."""
        begin, seq = len(self._before), state.mission_seq
        return self.in_mission(state) and seq is not None and begin <= seq < begin + len(self._tail)

    def _is_next_item_certain(self) -> bool:
        """Return whether it is certain which item of the new route is next when a command arrives."""
        swap = self.swap
        if swap.lacks_position():
            return False
        if not swap.plan.leaves_ahead or self.ctx.state.ground_speed_m_s < STILL_M_S:
            return True
        at = swap.position(self._later_s)
        is_late = swap.is_past_splice(self._later_s)
        return is_late or (at.corner_s > CORNER_MARGIN_S and not self._leaves_leg(at))

    def _leaves_leg(self, at: RoutePosition) -> bool:
        """Return whether the new leg of a vehicle that brakes would leave the route.

        The new leg begins where the vehicle stops: behind the next item, or beside the route soon after a
        corner. False at the splice point: flying back to that point is better than leaving it out.
        """
        is_at_splice = abs(at.to_item_m + at.past_splice_m) <= SAME_PLACE_M
        if self.ctx.dialect.brakes_m_s2 is None or is_at_splice:
            return False
        return at.to_item_m < self.swap.stopping_distance_m() or at.cross_track_m > MAX_BESIDE_LEG_M

    def _stays_on_old(self) -> Swapped | None:
        """Return the outcome if the vehicle has to stay on its old route now, else None."""
        if self.swap.is_past_splice(self._later_s):
            return LATE
        if self.swap.lacks_position():
            return Swapped(POSITION_UNKNOWN, "old")
        if self.ctx.state.landed is Landed.LANDING:
            return Swapped("the vehicle is landing [landing]", "old")
        return None
