"""The section `rules` of a configuration: one key for each failsafe rule."""

from __future__ import annotations

from pydantic import Field

from swarmctl.agent.failsafes import ALWAYS_ON, RULES, lost_link
from swarmctl.agent.failsafes.base import ActiveRule
from swarmctl.agent.failsafes.fence_ahead import Params as FenceAhead
from swarmctl.agent.failsafes.gps_loss import Params as GpsLoss
from swarmctl.agent.failsafes.lost_link import Params as LostLink
from swarmctl.agent.failsafes.low_battery import Params as LowBattery
from swarmctl.agent.failsafes.not_following import Params as NotFollowing
from swarmctl.core.section import Section


class Rules(Section):
    """Failsafe rules of each vehicle in flight. null turns a rule off."""

    low_battery: LowBattery | None = Field(
        LowBattery(), description="Low battery: the vehicle returns, or lands at its position."
    )
    fence_ahead: FenceAhead | None = Field(
        FenceAhead(),
        description="Fence ahead: a copter off its route holds before the fence, a fixed wing returns. "
        "Outside the fence every vehicle returns.",
    )
    not_following: NotFollowing | None = Field(
        NotFollowing(), description="Not following: a vehicle in mission mode leaves its route or stops."
    )
    gps_loss: GpsLoss | None = Field(
        GpsLoss(), description="Loss of the GPS fix or position: a warning, later a landing or a return."
    )


def active_rules(section: Rules, declared: LostLink) -> tuple[ActiveRule, ...]:
    """Return the active rules, permanent rules first; `declared` is the reaction to a lost link."""
    chosen = ((rule, getattr(section, rule.NAME)) for rule in RULES)
    always = (ActiveRule(lost_link, declared) if active.rule is lost_link else active for active in ALWAYS_ON)
    return (*always, *(ActiveRule(rule, params) for rule, params in chosen if params is not None))
