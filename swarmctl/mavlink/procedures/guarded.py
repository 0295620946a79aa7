"""Commands that change a vehicle's mode or start something, never against whoever else flies it.

A pilot takes over by radio control without asking anybody, and the regular heartbeat tells of it up to a
second later. So every such command, the repeated one too, is preceded by a heartbeat that was asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence, Set

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.vehicle import VehicleState
from swarmctl.mavlink.protocol.command import Command, CommandOutcome, CommandResult
from swarmctl.mavlink.protocol.conversation import Conversation
from swarmctl.mavlink.protocol.procedure import Context, Procedure
from swarmctl.mavlink.protocol.wait import RequestUntil, wait

HEARTBEAT_WAIT_S = 5.0
"""a heartbeat a second and one for every request, and several may be lost"""
TEXT_WAIT_S = 0.5
TRIES = 5
"""of a command that is not answered"""
WARNING = int(mavlink.MAV_SEVERITY_WARNING)

StateCondition = Callable[[VehicleState], bool]
CommandFactory = Callable[[int], Conversation[CommandResult]]
"""One try to have something done; called with how often it was tried before."""


class NotInControl(Exception):
    """The vehicle is not as this procedure left it, or does not say: nothing more may be commanded."""


class TakenOver(NotInControl):
    """A heartbeat shows a mode, or an arming, that somebody else has chosen."""


def in_modes(modes: Set[str], *, armed: bool | None = None) -> StateCondition:
    """Its mode is one of `modes`, and it is armed or disarmed where that is said."""
    return lambda s: s.mode in modes and armed in (None, s.armed)


def describe_takeover(state: VehicleState) -> str:
    """For people: what the vehicle does that was not asked of it."""
    arming = "armed" if state.armed else "disarmed"
    return f"its mode is {state.mode}, {arming}: set by its pilot, its failsafe or another station"


def confirm_state(ctx: Context, expected: StateCondition) -> Procedure[None]:
    """See in a heartbeat younger than this call that the vehicle is as `expected`. Raises NotInControl."""
    if not (yield RequestUntil(ctx.peer, lambda: True, HEARTBEAT_WAIT_S)):
        raise NotInControl(f"no heartbeat for {HEARTBEAT_WAIT_S:g} s that would tell who flies it")
    if not expected(ctx.state):
        raise TakenOver(describe_takeover(ctx.state))


def command(ctx: Context, number: int, params: Sequence[float] = ()) -> CommandFactory:
    """A MAV_CMD as an order."""
    return lambda attempt: Command(ctx.peer, number, *params, confirmation=attempt)


def set_mode(
    ctx: Context, mode: str, before: StateCondition, *, armed: bool | None = None, at_once: bool = False
) -> Procedure[str | None]:
    """`send_guarded` for a change of mode; nothing is sent where it is in `mode` already."""
    order = command(ctx, mavlink.MAV_CMD_DO_SET_MODE, ctx.dialect.mode_params(mode))
    after = in_modes({mode}, armed=armed)
    return (yield from send_guarded(ctx, order, before, after, skip_if_done=True, at_once=at_once))


def send_guarded(
    ctx: Context,
    order: CommandFactory,
    before: StateCondition,
    after: StateCondition,
    *,
    seen: StateCondition | None = None,
    wait_s: float = HEARTBEAT_WAIT_S,
    skip_if_done: bool = False,
    at_once: bool = False,
) -> Procedure[str | None]:
    """Give an order and see it happen; returns the failure, with the vehicle's own words.

    It goes out, and out again while unanswered, only where a new heartbeat shows the vehicle as `before`.
    `after` is how the command leaves it, `seen` what is waited for in the end (default: `after`).
    `skip_if_done`: where it is as `after` already nothing is sent. `at_once`: the first time it goes out
    unseen. Raises NotInControl where a heartbeat shows neither `before` nor `after`, or none comes.
    """
    texts_before = ctx.telemetry.n_texts
    ours = _either(before, after)
    result: CommandResult | None = None
    done = False
    for attempt in range(TRIES):
        if attempt or not at_once:
            sent_or_needless = attempt > 0 or skip_if_done
            yield from confirm_state(ctx, ours if sent_or_needless else before)
            done = sent_or_needless and after(ctx.state)
            if done:
                break
        result = yield order(attempt)
        if result.final:
            break
    if result is None:
        return None
    if not (done or result.may_have_happened):
        # The reasons for refusals come as STATUSTEXT, before or after the acknowledgement.
        yield wait(TEXT_WAIT_S)
    elif (yield from _see(ctx, ours, seen or after, wait_s)):
        return None
    return _failure(ctx, result, texts_before)


def send_acknowledged(
    ctx: Context, order: CommandFactory, before: StateCondition | None = None
) -> Procedure[str | None]:
    """Give an order of which only its acknowledgement tells; returns the failure. Where `before` is given, it
    goes out only while a new heartbeat shows the vehicle so, as of `send_guarded`. Raises NotInControl."""
    failure: str | None = "not tried"
    for attempt in range(TRIES):
        if before is not None:
            yield from confirm_state(ctx, before)
        result: CommandResult = yield order(attempt)
        failure = None if result.outcome is CommandOutcome.ACCEPTED else result.text
        if result.final:
            break
    return failure


def _see(ctx: Context, ours: StateCondition, seen: StateCondition, wait_s: float) -> Procedure[bool]:
    yield RequestUntil(ctx.peer, lambda: seen(ctx.state) or not ours(ctx.state), wait_s)
    if seen(ctx.state):
        return True
    if not ours(ctx.state):
        raise TakenOver(describe_takeover(ctx.state))
    return False


def _either(one: StateCondition, other: StateCondition) -> StateCondition:
    return lambda s: one(s) or other(s)


def _failure(ctx: Context, result: CommandResult, texts_before: int) -> str:
    said = [text for severity, text in ctx.telemetry.texts_since(texts_before) if severity <= WARNING]
    suffix = f" (the vehicle says: {'; '.join(said[-3:])})" if said else ""
    not_seen = ", but it was not seen to happen" if result.outcome is CommandOutcome.ACCEPTED else ""
    return f"{result.text}{not_seen}{suffix}"
