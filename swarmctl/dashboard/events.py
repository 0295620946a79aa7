"""The lines of the event list, in words. Pure."""

from __future__ import annotations

from collections.abc import Iterator

from swarmctl.agent.state import ARRIVED
from swarmctl.dashboard.facts import Words
from swarmctl.dashboard.picture import RouteChange, Severity

ALARMS = frozenset({"failed", "released"})
"""phases that are an alarm"""
NEAR = "predicted to come too close"
"""begin of the agent's text about a vehicle that comes too close"""


def of_words(before: Words, after: Words, *, is_bus: bool) -> Iterator[tuple[Severity, str]]:
    """Yield severity and text of each change that an operator should see."""
    if after.phase != before.phase and after.phase:
        why = f": {after.outcome}" if after.outcome else ""
        yield "alarm" if after.phase in ALARMS else "info", f"phase {after.phase}{why}"
    elif after.outcome != before.outcome and after.outcome:
        yield "info" if after.outcome == ARRIVED else "warning", after.outcome
    if after.trouble != before.trouble and after.trouble.startswith(NEAR):
        yield "alarm", after.trouble
    elif is_bus and after.trouble != before.trouble and after.trouble:
        yield "warning", after.trouble  # a record has the texts to the operator instead
    if after.waiting != before.waiting and after.waiting.split(",")[0] != before.waiting.split(",")[0]:
        yield "info", f"waits {after.waiting}" if after.waiting else "the wait is over"
    if (after.w, after.strength) != (before.w, before.strength) and before.phase:
        strength = after.strength
        text = "" if after.w is None else f"w {after.w:g}"
        if strength is not None:
            text += f", firing strengths {strength.direct:g}/{strength.first_neighbour:g}"
            text += f"/{strength.second_neighbour:g}"
        yield "info", f"new weights from the next plan on: {text.lstrip(', ')}"


def of_change(change: RouteChange) -> str:
    """Return a new plan in words: the reason, the length and ΣP_s."""
    new = change.new
    text = f"plan {new.plan_id} of {new.length_m:.0f} m with ΣP_s {new.exposure_sum:.3f}"
    who = dict.fromkeys(learned.observer for learned in change.because)
    return f"{text}, after observations by {', '.join(who)}" if who else text


def of_strikes(new: int, total: int) -> str:
    times = "" if new == 1 else f" {new} times"
    return f"struck{times}; strikes in all: {total}"
