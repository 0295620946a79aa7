"""What may happen to a vehicle in flight, and what its agent does then: one rule a file. Pure.

A rule is a module with `NAME`, its `Params`, and `judge(params, memory, facts, now)`, which says what it
demands, if anything. Of several demands the strongest is followed (`base.STRENGTH`). A new rule is a file, a
line here, and its key in `config_rules`. Imports core.
"""

from __future__ import annotations

from typing import Any

from swarmctl.agent.failsafes import fence_ahead, gps_loss, lost_link, low_battery, not_following, taken_over
from swarmctl.agent.failsafes.base import (
    CALMEST,
    IN_FLIGHT,
    STRENGTH,
    Action,
    Doing,
    Facts,
    Fence,
    Kind,
    Rule,
    Ruling,
    Way,
)

__all__ = [
    "ALWAYS",
    "CALMEST",
    "IN_FLIGHT",
    "RULES",
    "STRENGTH",
    "Action",
    "Doing",
    "Facts",
    "Fence",
    "Kind",
    "Rule",
    "Ruling",
    "Way",
    "judge",
    "strongest",
]

ALWAYS: tuple[Ruling, ...] = (
    Ruling(taken_over, taken_over.Params()),
    Ruling(lost_link, lost_link.Params()),
)
"""What no configuration turns off."""

RULES: tuple[Rule, ...] = (low_battery, fence_ahead, not_following, gps_loss)
"""What a configuration may set, by name, and turn off."""


def judge(
    rulings: tuple[Ruling, ...], memories: tuple[Any, ...], facts: Facts, now: float
) -> tuple[tuple[Any, ...], tuple[Action | None, ...]]:
    """What each rule remembers, and what each demands, in their order. `memories` is what this returned the
    last time; empty the first time."""
    judged = [
        ruling.rule.judge(ruling.params, memory, facts, now)
        for ruling, memory in zip(rulings, memories or (None,) * len(rulings), strict=True)
    ]
    return tuple(memory for memory, _ in judged), tuple(action for _, action in judged)


def strongest(actions: tuple[Action | None, ...]) -> Action | None:
    """Of equal ones the first."""
    there = [action for action in actions if action is not None]
    return max(there, key=lambda action: STRENGTH[action.kind], default=None)
