"""The section `rules` of a configuration: one key for each failsafe rule that can be turned off."""

from __future__ import annotations

from typing import Any

from pydantic import Field, create_model

from swarmctl.agent.failsafes import ALWAYS_ON, RULES, lost_link
from swarmctl.agent.failsafes.base import ActiveRule
from swarmctl.agent.failsafes.lost_link import Params as LostLink
from swarmctl.core.section import Section

_KEYS: dict[str, Any] = {
    rule.NAME: (rule.Params | None, Field(rule.Params(), description=rule.DESCRIPTION)) for rule in RULES
}


class Rules(create_model("RuleKeys", __base__=Section, **_KEYS)):  # type: ignore[misc]
    """Failsafe rules of each vehicle in flight. null turns a rule off."""


def active_rules(section: Rules, declared: LostLink) -> tuple[ActiveRule, ...]:
    """Return the active rules, permanent rules first; `declared` is the reaction to a lost link."""
    chosen = ((rule, getattr(section, rule.NAME)) for rule in RULES)
    always = (ActiveRule(lost_link, declared) if active.rule is lost_link else active for active in ALWAYS_ON)
    return (*always, *(ActiveRule(rule, params) for rule, params in chosen if params is not None))
