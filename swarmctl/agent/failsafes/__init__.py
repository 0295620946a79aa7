"""What may happen to a vehicle in flight, and what its agent does then: one rule a file. Pure.

A rule is a module with `NAME`, its `Params`, and `evaluate(params, memory, facts, now)`, which says what it
demands, if anything. Of several demands the strongest is followed (`base.STRENGTH`). A new rule is a file, a
line here, and its key in `config_rules`. Imports core.
"""

from __future__ import annotations

from typing import Any

from swarmctl.agent.failsafes import fence_ahead, gps_loss, lost_link, low_battery, not_following, taken_over
from swarmctl.agent.failsafes.base import (
    ACTIVITY_AS_DEMAND,
    IN_FLIGHT,
    STRENGTH,
    ActiveRoute,
    ActiveRule,
    Activity,
    Demand,
    DemandKind,
    FailsafeFacts,
    Fence,
    Rule,
)

__all__ = [
    "ACTIVITY_AS_DEMAND",
    "ALWAYS_ON",
    "IN_FLIGHT",
    "RULES",
    "STRENGTH",
    "ActiveRoute",
    "ActiveRule",
    "Activity",
    "Demand",
    "DemandKind",
    "FailsafeFacts",
    "Fence",
    "Rule",
    "evaluate",
    "strongest",
]

ALWAYS_ON: tuple[ActiveRule, ...] = (
    ActiveRule(taken_over, taken_over.Params()),
    ActiveRule(lost_link, lost_link.Params()),
)
"""What no configuration turns off."""

RULES: tuple[Rule, ...] = (low_battery, fence_ahead, not_following, gps_loss)
"""What a configuration may set, by name, and turn off."""


def evaluate(
    rulings: tuple[ActiveRule, ...], memories: tuple[Any, ...], facts: FailsafeFacts, now: float
) -> tuple[tuple[Any, ...], tuple[Demand | None, ...]]:
    """What each rule remembers, and what each demands, in their order. `memories` is what this returned the
    last time; empty the first time."""
    judged = [
        ruling.rule.evaluate(ruling.params, memory, facts, now)
        for ruling, memory in zip(rulings, memories or (None,) * len(rulings), strict=True)
    ]
    return tuple(memory for memory, _ in judged), tuple(action for _, action in judged)


def strongest(actions: tuple[Demand | None, ...]) -> Demand | None:
    """Of equal ones the first."""
    there = [action for action in actions if action is not None]
    return max(there, key=lambda action: STRENGTH[action.kind], default=None)
