"""The machine that each kind of swap is, and the data that its steps share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Set
from dataclasses import dataclass
from enum import StrEnum
from typing import Generic, TypeVar

import msgspec

from swarmctl.core.mission import FlightPlan, MissionItem
from swarmctl.core.vehicle import MAX_DELAY_S
from swarmctl.mavlink.procedures.guarded import (
    NotInControl,
    StateCondition,
    confirm_state,
    in_modes,
    set_mode,
)
from swarmctl.mavlink.procedures.land import landing_items
from swarmctl.mavlink.procedures.swap.route_progress import MAX_CROSS_TRACK_M, RoutePosition, RouteProgress
from swarmctl.mavlink.protocol.conversation import check_transition
from swarmctl.mavlink.protocol.outcome import FlyingAfterSwap, Swapped
from swarmctl.mavlink.protocol.procedure import Context, Procedure
from swarmctl.mavlink.protocol.wait import WaitUntil

MAX_ITEMS = 400
"""Greatest number of stored items if flown items stay stored; above this number only the new plan is stored.
ArduPilot stores 650 items or more."""
MOVE_WAIT_S = 10.0
"""longest wait until the vehicle flies to its new item"""
MAX_CROSS_TRACK_TURNING_M = 150.0
"""greatest cross-track distance of a fixed wing in a turn or a circle of its plan"""
PAST_SPLICE = (
    "the change came too late: the vehicle has passed the splice point of the new plan, "
    f"or is more than {MAX_CROSS_TRACK_M:g} m off the new plan [past-splice]"
)
NOT_ON_OLD_MISSION = "cannot confirm that the vehicle is still on its previous mission"
POSITION_UNKNOWN = (
    "the vehicle reports no recent position, so the next item of the new plan is unknown [no-position]"
)

S = TypeVar("S", bound=StrEnum)
Table = Mapping[S, tuple[Callable[[], Procedure[S | Swapped]], Set[S | FlyingAfterSwap]]]
"""For each state its step, and what may follow: states and, for an end, what the vehicle may fly then."""


@dataclass(slots=True)
class Swap:
    """A swap under way: the new plan, and what the steps share."""

    ctx: Context
    plan: FlightPlan
    items: tuple[MissionItem, ...]
    """the plan as a separate mission"""
    progress: RouteProgress
    """progress on the items from the first waypoint on"""
    own_modes: set[str]
    """modes that count as set by this program; the swap adds the modes that it sets"""
    state: StrEnum | None = None
    """state of the machine that runs; None before its begin"""
    current_since_s: float = 0.0
    """time when the plan became current, by the vehicle's clock [s]; telemetry shows the item later"""
    _position: RoutePosition | None = None
    """last position on the new plan"""

    def position(self, later_s: float) -> RoutePosition:
        """Return the position on the new plan after `later_s`, or the last result while no position is known.

        Positions are rare over a slow radio.
        """
        if self._position is None or self.ctx.state.has_position:
            age_s = self.ctx.telemetry.position_age_s
            self._position = self.progress.at(self.ctx.state, later_s + age_s)
        return self._position

    def lacks_position(self) -> bool:
        """Return whether the plan needs a position (`leaves_ahead`), but it is unknown or old."""
        ctx = self.ctx
        is_old = ctx.telemetry.clock.is_old(ctx.now, MAX_DELAY_S)
        return self.plan.leaves_ahead and (not ctx.state.has_position or is_old)

    def next_waypoint(self, later_s: float = 0.0) -> int:
        """Return the index of the next waypoint; 0 if not `leaves_ahead` and the position is late."""
        at = self.position(later_s)
        return at.item if self.plan.leaves_ahead or not at.is_late else 0

    def is_past_splice(self, round_trip_s: float) -> bool:
        """Return whether it is too late for the splice point when a message takes effect.

        Then the vehicle is past the splice point or off the plan, or would stop too far past that point.
        """
        at = self.position(round_trip_s)
        stops_past_m = at.past_splice_m + self.stopping_distance_m()
        return self.plan.leaves_ahead and (at.is_late or stops_past_m > self.plan.max_overshoot_m)

    def stopping_distance_m(self) -> float:
        """Return the distance in which the vehicle stops for a new item [m]; 0 if it turns without a stop."""
        brakes_m_s2 = self.ctx.dialect.brakes_m_s2
        return 0.0 if brakes_m_s2 is None else self.ctx.state.ground_speed_m_s**2 / (2.0 * brakes_m_s2)


class OldPlan(msgspec.Struct, frozen=True):
    """The plan flown before a swap, as a separate mission, with its current item."""

    items: tuple[MissionItem, ...]
    """empty if unknown"""
    seq: int
    """current item"""
    progress: RouteProgress
    """progress on the items from the current item on"""

    @classmethod
    def of(cls, ctx: Context) -> OldPlan:
        """Return the plan that the vehicle flies now, without earlier plans in the vehicle's list."""
        first = ctx.dialect.first_waypoint_seq
        plan_first = max(ctx.plan_first_seq, first)
        items = ctx.verified_items[:first] + ctx.verified_items[plan_first:]
        seq = (ctx.state.mission_seq or plan_first) - plan_first + first
        seq = min(max(seq, first), max(len(items) - 1, first))
        return cls(items, seq, RouteProgress(ctx.state, items[seq:]))

    def next_item(self, ctx: Context) -> int | None:
        """Return the index of the vehicle's next item; None if off this plan or without a position."""
        if not (self.items and self.progress.is_known and ctx.state.has_position):
            return None
        at = self.progress.at(ctx.state)
        cross_track_m = MAX_CROSS_TRACK_TURNING_M if landing_items(self.items) else MAX_CROSS_TRACK_M
        return None if at.cross_track_m > cross_track_m else self.seq + at.item


class Machine(ABC, Generic[S]):
    """A kind of swap: states with a step each. A step returns the next state, or the outcome of the swap.

    In every state NotInControl may end the swap.
    """

    def __init__(self, swap: Swap, old: OldPlan) -> None:
        self.swap, self.old, self.ctx = swap, old, swap.ctx
        dialect = swap.ctx.dialect
        self.hold_mode, self.mission_mode = dialect.hold_mode, dialect.mission_mode
        self.first = dialect.first_waypoint_seq
        self.in_hold = in_modes({self.hold_mode}, armed=True)
        self.in_mission = in_modes({self.mission_mode}, armed=True)
        self.in_own_modes = in_modes(swap.own_modes, armed=True)
        """condition that follows `own_modes`"""
        self.failed = Swapped()
        """outcome after the failures so far"""

    @abstractmethod
    def table(self) -> Table[S]:
        """Return the table; its first state is the begin."""

    def run(self) -> Procedure[Swapped]:
        """Perform one step after the other; return the outcome. Raises NotInControl, IllegalEvent."""
        table = self.table()
        state = next(iter(table))
        while True:
            self.swap.state = state
            step, may_follow = table[state]
            after = yield from step()
            check_transition(self, state, after.flying if isinstance(after, Swapped) else after, may_follow)
            if isinstance(after, Swapped):
                return after
            state = after

    # Parts of steps; each raises NotInControl.

    def enter_hold(self) -> Procedure[str | None]:
        """Set hold mode; return the failure."""
        # If the vehicle already holds and hold is not an own mode, another party has taken over.
        yield from confirm_state(self.ctx, self.in_own_modes)
        self.swap.own_modes.add(self.hold_mode)
        return (yield from set_mode(self.ctx, self.hold_mode, self.in_own_modes, armed=True))

    def hold_after(self, failure: str) -> Procedure[None]:
        """Set hold mode after a failure. A vehicle that does not hold is not in control."""
        if no_hold := (yield from self.enter_hold()):
            raise NotInControl(f"{failure}; the vehicle does not hold either: {no_hold} [no-hold]")

    def fly_on(self, seq: int, before: StateCondition) -> Procedure[str | None]:
        """Set mission mode and confirm that the vehicle flies from item `seq`; return the failure."""
        failure = yield from set_mode(self.ctx, self.mission_mode, before, armed=True)
        return failure or (yield from self.confirm_flying(seq))

    def confirm_flying(self, first: int) -> Procedure[str | None]:
        """Wait until the vehicle flies to item `first` or a later item; return the failure.

        If no position is known, mode and current item are the only evidence.
        """
        ctx, since_s = self.ctx, self.ctx.state.time_boot_s

        def is_under_way() -> bool:
            seq = ctx.state.mission_seq
            is_on = seq is not None and first <= seq < len(ctx.verified_items)
            return is_on and ctx.state.mode == self.mission_mode

        def flies_on() -> bool:
            state = ctx.state
            # The last position may be from before the hold.
            moves = state.mission_seq != first or state.ground_speed_m_s > 0.5 or abs(state.climb_m_s) > 0.3
            return is_under_way() and state.time_boot_s > since_s and moves

        modes = (self.hold_mode, self.mission_mode)
        yield WaitUntil(lambda: flies_on() or ctx.state.mode not in modes, MOVE_WAIT_S)
        if flies_on() or (is_under_way() and not ctx.state.has_position):
            return None
        at = f"mode {ctx.state.mode}, item {ctx.state.mission_seq}"
        return f"the vehicle does not fly on: {at} [not-flying-on]"
