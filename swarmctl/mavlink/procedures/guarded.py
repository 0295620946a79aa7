"""Guarded commands: they never override a pilot or another station, and they are never sent too late.

A pilot may take over by radio control at any moment, and the regular heartbeat shows this up to a second
later. So a requested heartbeat precedes every try, unless `skip_first_check` is True or `before` is None. A
heartbeat counts only if telemetry is recent by the vehicle's clock: it may have waited on the link, or in
this program's own inbox.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence, Set

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.vehicle import MAX_DELAY_S, RECENT_DELAY_S, VehicleState
from swarmctl.mavlink.protocol.command import Command, CommandOutcome, CommandResult
from swarmctl.mavlink.protocol.conversation import Conversation
from swarmctl.mavlink.protocol.procedure import Context, Procedure
from swarmctl.mavlink.protocol.wait import RequestUntil, wait

HEARTBEAT_WAIT_S = 5.0
"""longest wait: heartbeats come every second and on request, and several may be lost"""
TEXT_WAIT_S = 0.5
TRIES = 5
"""number of times that an unanswered command is sent"""
WARNING = int(mavlink.MAV_SEVERITY_WARNING)

WHILE_RECENT_S = 2.0 * MAX_DELAY_S
"""life of a command that depends on the position of a moving vehicle [s]: several tries over a lossy link"""
UNTIL_REPLACED_S = math.inf
"""life of a command that stays right until another procedure replaces it, such as an order to hold"""

StateCondition = Callable[[VehicleState], bool]


class GuardedCommand(msgspec.Struct, frozen=True):
    """A command with the end of its life. It is never sent after that end, but decided anew."""

    next_try: Callable[[int], Conversation[CommandResult] | None]
    """function that decides one try, from the number of earlier tries; None: the command would be too late"""
    until_s: float
    """end of the command's life, by this program's clock [s]"""


class NotInControl(Exception):
    """The vehicle is silent or not in the expected state, so no command may follow."""


class TakenOver(NotInControl):
    """Another party has changed the mode, the arming or the mission."""


def in_modes(modes: Set[str], *, armed: bool | None = None) -> StateCondition:
    """Return the condition that the mode is one of `modes` and the armed state is `armed` (None: any)."""
    return lambda s: s.mode in modes and armed in (None, s.armed)


class CommandLate(NotInControl):
    """The life of a command ended before the command was sent. It has to be decided anew."""


def describe_takeover(state: VehicleState) -> str:
    """Return a message about a mode or an arming that this program has not commanded."""
    arming = "armed" if state.armed else "disarmed"
    return (
        f"the vehicle is {arming} in mode {state.mode}, set by the pilot, a failsafe or another station; "
        "no further command is sent [taken-over]"
    )


def confirm_state(ctx: Context, expected: StateCondition) -> Procedure[None]:
    """Request a heartbeat and check that the vehicle's state fulfils `expected`. Raises NotInControl."""
    is_recent = ctx.has_recent_telemetry
    if not (yield RequestUntil(ctx.peer, lambda: True, HEARTBEAT_WAIT_S, counts=is_recent)):
        if not is_recent():
            raise NotInControl(describe_old_telemetry(ctx.telemetry.clock.age_s(ctx.now)))
        raise NotInControl(
            f"no heartbeat for {HEARTBEAT_WAIT_S:g} s: mode unknown, no further command is sent [silent]"
        )
    if not expected(ctx.state):
        raise TakenOver(describe_takeover(ctx.state))


def describe_old_telemetry(age_s: float) -> str:
    """Return a message about telemetry that is too old for a command."""
    return (
        f"telemetry is {age_s:.0f} s old (limit {RECENT_DELAY_S:g} s); no further command is sent until it "
        "recovers [telemetry-old]"
    )


def command(ctx: Context, number: int, params: Sequence[float] = (), *, lasts_s: float) -> GuardedCommand:
    """Return a MAV_CMD; `lasts_s` is its life from now [s]."""
    return GuardedCommand(
        lambda attempt: Command(ctx.peer, number, *params, confirmation=attempt), ctx.now + lasts_s
    )


def set_mode(
    ctx: Context,
    mode: str,
    before: StateCondition,
    *,
    armed: bool | None = None,
    skip_if_done: bool = True,
    skip_first_check: bool = False,
) -> Procedure[str | None]:
    """Set a mode by `send_guarded`, by default unless a heartbeat shows this mode; return the failure."""
    # The mode is meant until another procedure replaces this one; `before` refuses a mode of another party.
    order = command(ctx, mavlink.MAV_CMD_DO_SET_MODE, ctx.dialect.mode_params(mode), lasts_s=UNTIL_REPLACED_S)
    after = in_modes({mode}, armed=armed)
    return (
        yield from send_guarded(
            ctx, order, before, after, skip_if_done=skip_if_done, skip_first_check=skip_first_check
        )
    )


def send_guarded(
    ctx: Context,
    order: GuardedCommand,
    before: StateCondition,
    after: StateCondition,
    *,
    awaited: StateCondition | None = None,
    wait_s: float = HEARTBEAT_WAIT_S,
    skip_if_done: bool = False,
    skip_first_check: bool = False,
) -> Procedure[str | None]:
    """Send a command and wait for its effect in telemetry; return the failure with the vehicle's warnings.

    before: condition under which the command is sent, checked by a new heartbeat before each try
    after: condition that the command leads to; a vehicle that already fulfils `after` gets no repetition
    awaited: condition to wait for at the end (default: `after`)
    skip_if_done: if True, a vehicle that already fulfils `after` does not get the first try either
    skip_first_check: if True, the first try is sent without a new heartbeat, in any state

    Raises NotInControl if a heartbeat shows another state, or if no heartbeat arrives in time, and
    CommandLate if the vehicle does not fulfil `after` at the end of the command's life.
    """
    n_texts_before = ctx.telemetry.n_texts

    def expected(state: VehicleState) -> bool:
        return before(state) or after(state)

    result: CommandResult | None = None
    done = False
    for attempt in range(TRIES):
        if attempt or not skip_first_check:
            may_be_done = attempt > 0 or skip_if_done
            yield from confirm_state(ctx, expected if may_be_done else before)
            done = may_be_done and after(ctx.state)
            if done:
                break
        result = yield _next_try(ctx, order, attempt)
        if result.final:
            break
    if result is None:
        return None
    if not (done or result.may_have_happened):
        # The reason for a refusal arrives as STATUSTEXT, before or after the acknowledgement.
        yield wait(TEXT_WAIT_S)
    elif (yield from _await_effect(ctx, expected, awaited or after, wait_s)):
        return None
    return _failure(ctx, result, n_texts_before)


def send_acknowledged(
    ctx: Context, order: GuardedCommand, before: StateCondition | None = None
) -> Procedure[str | None]:
    """Send a command whose only confirmation is the acknowledgement; return the failure.

    `before`, if given, is checked by a new heartbeat before each try. Raises NotInControl, CommandLate.
    """
    failure: str | None = "not tried"
    for attempt in range(TRIES):
        if before is not None:
            yield from confirm_state(ctx, before)
        result: CommandResult = yield _next_try(ctx, order, attempt)
        failure = None if result.outcome is CommandOutcome.ACCEPTED else result.text
        if result.final:
            break
    return failure


def _next_try(ctx: Context, order: GuardedCommand, attempt: int) -> Conversation[CommandResult]:
    """Return the next try. Raises CommandLate."""
    conversation = order.next_try(attempt) if ctx.now <= order.until_s else None
    if conversation is None:
        raise CommandLate(
            f"the command is too old and was not sent (earlier tries: {attempt}); it has to be decided anew "
            "[command-late]"
        )
    return conversation


def _await_effect(
    ctx: Context, expected: StateCondition, awaited: StateCondition, wait_s: float
) -> Procedure[bool]:
    yield RequestUntil(
        ctx.peer,
        lambda: awaited(ctx.state) or not expected(ctx.state),
        wait_s,
        counts=ctx.has_recent_telemetry,
    )
    if awaited(ctx.state):
        return True
    if not expected(ctx.state):
        raise TakenOver(describe_takeover(ctx.state))
    return False


def _failure(ctx: Context, result: CommandResult, n_texts_before: int) -> str:
    warnings = (text for severity, text in ctx.telemetry.texts_since(n_texts_before) if severity <= WARNING)
    texts = list(dict.fromkeys(warnings))  # an autopilot repeats its text for each try
    suffix = f" (the vehicle reports: {'; '.join(texts[-3:])})" if texts else ""
    no_effect = ", but telemetry shows no effect" if result.outcome is CommandOutcome.ACCEPTED else ""
    return f"{result.text}{no_effect}{suffix}"
