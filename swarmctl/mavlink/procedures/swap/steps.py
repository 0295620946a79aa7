"""State and steps shared by the kinds of swap."""

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


@dataclass(frozen=True, slots=True)
class OldPlan:
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


@dataclass(slots=True)
class SwapPlan:
    """The new plan of a swap, and the state of the swap."""

    items: tuple[MissionItem, ...]
    """the plan as a separate mission"""
    progress: RouteProgress
    """progress on the items from the first waypoint on"""
    leaves_ahead: bool
    """True if the plan begins like the flown plan, up to a splice point ahead of the vehicle"""
    max_overshoot_m: float
    """greatest distance past the splice point at which the vehicle may stop for the plan [m]"""
    own_modes: set[str]
    """modes that count as set by this program; the swap adds the modes that it sets"""
    holds: bool = False
    """True if this swap has put the vehicle into hold, as confirmed by a heartbeat"""
    current_since_s: float | None = None
    """time when the plan became current, by the vehicle's clock [s]"""
    _position: RoutePosition | None = None
    """last position on the new plan"""

    def position(self, ctx: Context, later_s: float) -> RoutePosition:
        """Return the position on the new plan after `later_s`, or the last result while no position is known.

        Positions are rare over a slow radio.
        """
        if self._position is None or ctx.state.has_position:
            self._position = self.progress.at(ctx.state, later_s + ctx.telemetry.position_age_s)
        return self._position

    def lacks_position(self, ctx: Context) -> bool:
        """Return whether the plan needs a position (`leaves_ahead`), but it is unknown or old."""
        return self.leaves_ahead and (not ctx.state.has_position or ctx.telemetry.is_old(ctx.now))

    def next_waypoint(self, ctx: Context, later_s: float = 0.0) -> int:
        """Return the index of the next waypoint; 0 if not `leaves_ahead` and the position is late."""
        at = self.position(ctx, later_s)
        return at.item if self.leaves_ahead or not at.is_late else 0

    def is_past_splice(self, ctx: Context, round_trip_s: float) -> bool:
        """Return whether it is too late for the splice point when a message takes effect.

        Then the vehicle is past the splice point or off the plan, or would stop too far past that point.
        """
        at = self.position(ctx, round_trip_s)
        stops_past_m = at.past_splice_m + stopping_distance_m(ctx)
        return self.leaves_ahead and (at.is_late or stops_past_m > self.max_overshoot_m)

    def record_current(self, ctx: Context) -> None:
        """Record that the plan is current from now on; telemetry shows the new current item later."""
        self.current_since_s = ctx.state.time_boot_s


def stopping_distance_m(ctx: Context) -> float:
    """Return the distance in which the vehicle stops for a new item [m]; 0 if it turns without a stop."""
    brakes_m_s2 = ctx.dialect.brakes_m_s2
    return 0.0 if brakes_m_s2 is None else ctx.state.ground_speed_m_s**2 / (2.0 * brakes_m_s2)


def takes_off(ctx: Context) -> bool:
    """Return whether the vehicle flies an item before its first waypoint."""
    seq = ctx.state.mission_seq
    first = ctx.dialect.first_waypoint_seq
    return ctx.state.mode == ctx.dialect.mission_mode and seq is not None and seq < first


def confirm_flying(ctx: Context, first: int) -> Procedure[str | None]:
    """Wait until the vehicle flies to item `first` or a later item; return the failure.

    If no position is known, mode and current item are the only evidence.
    """
    hold, mission = ctx.dialect.hold_mode, ctx.dialect.mission_mode
    # The last position may be from before the hold.
    since_s = ctx.state.time_boot_s
    yield WaitUntil(
        lambda: _flies_on(ctx, first, since_s) or ctx.state.mode not in (hold, mission), MOVE_WAIT_S
    )
    if _flies_on(ctx, first, since_s) or (_is_under_way(ctx, first) and not ctx.state.has_position):
        return None
    return f"the vehicle does not fly on: mode {ctx.state.mode}, item {ctx.state.mission_seq} [not-flying-on]"


def _flies_on(ctx: Context, first: int, since_s: float) -> bool:
    state = ctx.state
    if not _is_under_way(ctx, first) or state.time_boot_s <= since_s:
        return False
    return state.mission_seq != first or state.ground_speed_m_s > 0.5 or abs(state.climb_m_s) > 0.3


def _is_under_way(ctx: Context, first: int) -> bool:
    """Return whether, by mode and current item, the vehicle flies `first` or a later item."""
    state = ctx.state
    is_on = state.mission_seq is not None and first <= state.mission_seq < len(ctx.verified_items)
    return is_on and state.mode == ctx.dialect.mission_mode


def end_in_hold(ctx: Context, plan: SwapPlan, failure: str) -> Procedure[Swapped]:
    """Set hold mode after a failure; return the outcome. Raises NotInControl if the vehicle does not hold."""
    no_hold = yield from enter_hold(ctx, plan)
    if no_hold:
        raise NotInControl(f"{failure}; the vehicle does not hold either: {no_hold} [no-hold]")
    return Swapped(failure, "hold")


def enter_hold(ctx: Context, plan: SwapPlan) -> Procedure[str | None]:
    """Set hold mode; return the failure. Raises NotInControl."""
    # If the vehicle already holds and hold is not an own mode, another party has taken over.
    yield from confirm_state(ctx, in_modes(plan.own_modes, armed=True))
    plan.own_modes.add(ctx.dialect.hold_mode)
    failure = yield from set_mode(
        ctx, ctx.dialect.hold_mode, in_modes(plan.own_modes, armed=True), armed=True
    )
    plan.holds = failure is None
    return failure
