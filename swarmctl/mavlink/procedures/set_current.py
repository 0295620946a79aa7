"""The item that is flown: see which it is, and change it."""

from __future__ import annotations

from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.mavlink.procedures.guarded import Seen, guarded
from swarmctl.mavlink.protocol.procedure import Context, Procedure
from swarmctl.mavlink.protocol.wait import Look

CURRENT_WAIT_S = 3.0
"""it is told once a second, and several may be lost"""


def see_current(ctx: Context, is_right: Callable[[int], bool]) -> Procedure[bool]:
    """Whether the vehicle says, from now on, that its current item is a right one."""

    def told() -> bool:
        return ctx.state.mission_seq is not None

    yield Look(ctx.peer, told, CURRENT_WAIT_S, mavlink.MAVLINK_MSG_ID_MISSION_CURRENT)
    return ctx.state.mission_seq is not None and is_right(ctx.state.mission_seq)


def make_current(ctx: Context, seq: int, before: Seen) -> Procedure[str | None]:
    """Have an item flown next, unless it is current already; returns the failure. `before` as of `guarded`.

    Raises HandsOff.
    """
    if (yield from see_current(ctx, lambda now: now == seq)):
        return None
    return (yield from jump_to(ctx, seq, before))


def jump_to(ctx: Context, seq: int, before: Seen) -> Procedure[str | None]:
    """Have an item flown next, now."""
    return (
        yield from guarded(
            ctx,
            lambda attempt: ctx.dialect.set_current(ctx.peer, seq, attempt),
            before,
            lambda s: before(s) and s.mission_seq == seq,
        )
    )
