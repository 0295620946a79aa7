"""What the ways to swap a mission have in common."""

from __future__ import annotations

from dataclasses import dataclass

from swarmctl.core.mission import MissionItem
from swarmctl.mavlink.procedures.guarded import NotInControl, confirm_state, in_modes, set_mode
from swarmctl.mavlink.procedures.land import landing_items
from swarmctl.mavlink.procedures.swap.route_progress import MAX_CROSS_TRACK_M, RoutePosition, RouteProgress
from swarmctl.mavlink.protocol.outcome import Swapped
from swarmctl.mavlink.protocol.procedure import Context, Procedure
from swarmctl.mavlink.protocol.wait import WaitUntil

MAX_ITEMS = 400
"""A longer list is written anew, without what is flown already: ArduPilot keeps 650 and more."""
MOVE_WAIT_S = 10.0
MAX_CROSS_TRACK_TURNING_M = 150.0
"""so far beside its plan's legs a fixed wing may be that flies it, in a turn or a circle"""
PAST_SPLIT = "it has flown past where the new plan leaves the old one"
NOT_ON_OLD_MISSION = "it is not known to be on the way of that any more"
POSITION_UNKNOWN = "it does not tell where it is, so that nobody knows what of the new plan lies ahead of it"


@dataclass(frozen=True, slots=True)
class OldPlan:
    """The plan that is flown, as a mission of its own, and how far: what to go back to."""

    items: tuple[MissionItem, ...]
    """empty where that is not known"""
    seq: int
    """its current item"""
    progress: RouteProgress
    """of its items from the current one on"""

    @classmethod
    def of(cls, ctx: Context) -> OldPlan:
        """What the vehicle flies now; of a list that holds earlier plans as well only the last."""
        first, begins = (
            ctx.dialect.first_waypoint_seq,
            max(ctx.plan_first_seq, ctx.dialect.first_waypoint_seq),
        )
        items = ctx.verified_items[:first] + ctx.verified_items[begins:]
        seq = (ctx.state.mission_seq or begins) - begins + first
        seq = min(max(seq, first), max(len(items) - 1, first))
        return cls(items, seq, RouteProgress(ctx.state, items[seq:]))

    def next_item(self, ctx: Context) -> int | None:
        """That which lies ahead of where the vehicle is now; None where it is beside this plan, or does not
        tell: nobody has planned a way back to it from there."""
        if not (self.items and self.progress.is_known and ctx.state.has_position):
            return None
        at = self.progress.at(ctx.state)
        cross_track_m = MAX_CROSS_TRACK_TURNING_M if landing_items(self.items) else MAX_CROSS_TRACK_M
        return None if at.cross_track_m > cross_track_m else self.seq + at.item


@dataclass(slots=True)
class SwapPlan:
    """The plan that a vehicle is to take over, and when it has."""

    items: tuple[MissionItem, ...]
    """as a mission of its own"""
    progress: RouteProgress
    """of its items from the first waypoint on"""
    leaves_ahead: bool
    """it begins as the plan goes that is flown"""
    own_modes: set[str]
    """the modes in which nobody else has put the vehicle: grows when the swap changes its mode"""
    holds: bool = False
    """it was last seen to hold, as this swap has told it"""
    taken_over_s: float | None = None
    """by the vehicle's clock"""
    _position: RoutePosition | None = None
    """on the new plan, when it told last where it is"""

    def position(self, ctx: Context, later_s: float) -> RoutePosition:
        """Where it is on the new plan in `later_s`; where it does not tell where it is, what was so before.

        A position does not come with every message, and on a thin radio seldom.
        """
        if self._position is None or ctx.state.has_position:
            self._position = self.progress.at(ctx.state, later_s + ctx.telemetry.position_age_s)
        return self._position

    def lacks_position(self, ctx: Context) -> bool:
        """Whether nobody knows what lies ahead of a plan that is not to be flown from its beginning."""
        return self.leaves_ahead and not ctx.state.has_position

    def next_waypoint(self, ctx: Context, later_s: float = 0.0) -> int:
        """The waypoint to fly to, counted from the first: of a vehicle that is on it the next ahead."""
        at = self.position(ctx, later_s)
        return at.item if self.leaves_ahead or not at.is_late else 0

    def is_past_split(self, ctx: Context, round_trip_s: float) -> bool:
        """Whether it is past where the new plan leaves the old one by when it follows what is sent now.

        That goes by what was told as long ago as it takes to be answered.
        """
        return self.leaves_ahead and self.position(ctx, round_trip_s).is_late

    def mark_taken_over(self, ctx: Context) -> None:
        """Now: what is seen of it comes later."""
        self.taken_over_s = ctx.state.time_boot_s


def takes_off(ctx: Context) -> bool:
    seq = ctx.state.mission_seq
    first = ctx.dialect.first_waypoint_seq
    return ctx.state.mode == ctx.dialect.mission_mode and seq is not None and seq < first


def confirm_flying(ctx: Context, first: int) -> Procedure[str | None]:
    """See the vehicle under way to the item `first` or a later one; returns the failure.

    Where it does not tell where it is meanwhile, what it says that it flies to has to do.
    """
    hold, mission = ctx.dialect.hold_mode, ctx.dialect.mission_mode
    # The last position may be of the way to where it held.
    since_s = ctx.state.time_boot_s
    yield WaitUntil(
        lambda: _flies_on(ctx, first, since_s) or ctx.state.mode not in (hold, mission), MOVE_WAIT_S
    )
    if _flies_on(ctx, first, since_s) or (_is_under_way(ctx, first) and not ctx.state.has_position):
        return None
    return f"it does not fly on: {ctx.state.mode}, item {ctx.state.mission_seq}"


def _flies_on(ctx: Context, first: int, since_s: float) -> bool:
    state = ctx.state
    if not _is_under_way(ctx, first) or state.time_boot_s <= since_s:
        return False
    return state.mission_seq != first or state.ground_speed_m_s > 0.5 or abs(state.climb_m_s) > 0.3


def _is_under_way(ctx: Context, first: int) -> bool:
    """By what it says."""
    state = ctx.state
    is_on = state.mission_seq is not None and first <= state.mission_seq < len(ctx.verified_items)
    return is_on and state.mode == ctx.dialect.mission_mode


def end_in_hold(ctx: Context, plan: SwapPlan, failure: str) -> Procedure[Swapped]:
    """Have it hold where nothing else is left. Raises NotInControl where it does not."""
    back = yield from enter_hold(ctx, plan)
    if back:
        raise NotInControl(f"{failure}; nor does it hold: {back}")
    return Swapped(failure, "hold")


def enter_hold(ctx: Context, plan: SwapPlan) -> Procedure[str | None]:
    """Returns the failure. Raises NotInControl."""
    # Who holds already does so by somebody else's will, unless hold is one of our modes by now.
    yield from confirm_state(ctx, in_modes(plan.own_modes, armed=True))
    plan.own_modes.add(ctx.dialect.hold_mode)
    failure = yield from set_mode(
        ctx, ctx.dialect.hold_mode, in_modes(plan.own_modes, armed=True), armed=True
    )
    plan.holds = failure is None
    return failure
