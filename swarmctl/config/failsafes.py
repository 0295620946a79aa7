"""The section `rules` of a configuration: one key a rule."""

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
    """What becomes of a vehicle in flight when something is not as it should be; null turns a rule off."""

    low_battery: LowBattery | None = Field(
        LowBattery(), description="the charge runs out: it returns, or lands"
    )
    fence_ahead: FenceAhead | None = Field(
        FenceAhead(), description="off its route it is about to leave the fence: it holds; outside it returns"
    )
    not_following: NotFollowing | None = Field(
        NotFollowing(), description="it says that it flies its mission, and does not"
    )
    gps_loss: GpsLoss | None = Field(
        GpsLoss(), description="it has no GPS fix: that is said, and in the end it lands"
    )


def rulings(section: Rules, agreed: LostLink) -> tuple[ActiveRule, ...]:
    """The rules that are on, those that nobody turns off first; `agreed` is what vehicles do that hear
    nothing."""
    chosen = ((rule, getattr(section, rule.NAME)) for rule in RULES)
    always = (ActiveRule(lost_link, agreed) if ruling.rule is lost_link else ruling for ruling in ALWAYS_ON)
    return (*always, *(ActiveRule(rule, params) for rule, params in chosen if params is not None))
