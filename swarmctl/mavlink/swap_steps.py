"""What the ways to swap a mission have in common."""

from __future__ import annotations

from dataclasses import dataclass

from swarmctl.core.mission import MissionItem
from swarmctl.mavlink.guarded import HandsOff, in_modes, set_mode
from swarmctl.mavlink.outcome import Swapped
from swarmctl.mavlink.procedure import Context, Procedure
from swarmctl.mavlink.wait import Until

MOVE_WAIT_S = 10.0


@dataclass(frozen=True, slots=True)
class Flown:
    """The plan that is flown, as a mission of its own, and how far: what to go back to."""

    items: tuple[MissionItem, ...]
    """empty where that is not known"""
    seq: int
    """its current item"""

    @classmethod
    def by(cls, ctx: Context) -> Flown:
        """What the vehicle flies now; of a list that holds earlier plans as well only the last."""
        first, begins = ctx.dialect.first_waypoint_seq, max(ctx.flown_from, ctx.dialect.first_waypoint_seq)
        items = ctx.on_vehicle[:first] + ctx.on_vehicle[begins:]
        seq = (ctx.state.mission_seq or begins) - begins + first
        return cls(items, min(max(seq, first), max(len(items) - 1, first)))


def takes_off(ctx: Context) -> bool:
    seq = ctx.state.mission_seq
    first = ctx.dialect.first_waypoint_seq
    return ctx.state.mode == ctx.dialect.mission_mode and seq is not None and seq < first


def see_it_fly(ctx: Context, first: int) -> Procedure[str | None]:
    """See the vehicle under way to the item `first` or a later one; returns the failure."""
    hold, mission = ctx.dialect.hold_mode, ctx.dialect.mission_mode
    # The last position may be of the way to where it held.
    since_s = ctx.state.time_boot_s
    yield Until(lambda: _flies_on(ctx, first, since_s) or ctx.state.mode not in (hold, mission), MOVE_WAIT_S)
    if _flies_on(ctx, first, since_s):
        return None
    return f"it does not fly on: {ctx.state.mode}, item {ctx.state.mission_seq}"


def _flies_on(ctx: Context, first: int, since_s: float) -> bool:
    state, last = ctx.state, len(ctx.on_vehicle) - 1
    if state.mode != ctx.dialect.mission_mode or state.mission_seq is None or state.time_boot_s <= since_s:
        return False
    moves = state.ground_speed_m_s > 0.5 or abs(state.climb_m_s) > 0.3
    return first < state.mission_seq <= last or (state.mission_seq == first and moves)


def held(ctx: Context, failure: str) -> Procedure[Swapped]:
    """Have it hold where nothing else is left. Raises HandsOff where it does not."""
    hold, mission = ctx.dialect.hold_mode, ctx.dialect.mission_mode
    back = yield from set_mode(ctx, hold, in_modes({hold, mission}, armed=True), armed=True)
    if back:
        raise HandsOff(f"{failure}; nor does it hold: {back}")
    return Swapped(failure, "hold")
