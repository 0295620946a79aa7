"""Failsafe rules in flight: one rule a file. Pure.

A rule is a module with `NAME`, `DESCRIPTION`, `Params` and `evaluate` (`base.OptionalRule`). It imports
`base` and core alone. `enforcement` follows the strongest new demand (`base.STRENGTH`). A new rule is a file
and a line in `RULES`: its name becomes a key in the section `rules` of configurations.
"""

from __future__ import annotations

from typing import Any

from swarmctl.agent.failsafes import fence_ahead, gps_loss, lost_link, low_battery, not_following, taken_over
from swarmctl.agent.failsafes.base import STRENGTH, ActiveRule, Demand, FailsafeFacts, OptionalRule

ALWAYS_ON: tuple[ActiveRule, ...] = (
    ActiveRule(taken_over, taken_over.Params()),
    ActiveRule(lost_link, lost_link.Params()),
)
"""Rules that no configuration turns off."""

RULES: tuple[OptionalRule, ...] = (low_battery, fence_ahead, not_following, gps_loss)
"""Rules that a configuration sets by name, or turns off."""


def evaluate(
    rules: tuple[ActiveRule, ...], memories: tuple[Any, ...], facts: FailsafeFacts, now: float
) -> tuple[tuple[Any, ...], tuple[Demand | None, ...]]:
    """Return the memories and the demands of all rules, in order.

    `memories` are the memories that the previous call returned, or empty at first.
    """
    results = [
        active.rule.evaluate(active.params, memory, facts, now)
        for active, memory in zip(rules, memories or (None,) * len(rules), strict=True)
    ]
    return tuple(memory for memory, _ in results), tuple(demand for _, demand in results)


def strongest(demands: tuple[Demand | None, ...]) -> Demand | None:
    """Return the strongest demand, the first of equals; None if there is no demand."""
    present = [demand for demand in demands if demand is not None]
    return max(present, key=lambda demand: STRENGTH[demand.kind], default=None)
