"""What is wrong with the section `preflight` of a configuration, before anything starts. Pure."""

from __future__ import annotations

from collections.abc import Iterator

from swarmctl.config import Config, Problem
from swarmctl.yaml_lines import Path as KeyPath

HERE: KeyPath = ("preflight",)
HEARTBEATS = 3
"""so many may be lost before a link counts as lost; one goes out each second of real time"""


def judge_preflight(config: Config) -> Iterator[Problem]:
    """Whether simulated vehicles would take their link for lost between two heartbeats."""
    simulate, policy = config.simulate, config.preflight.policy
    if simulate is None or policy.lost_link == "continue":
        return
    least_s = HEARTBEATS * simulate.speedup
    if policy.lost_link_after_s < least_s:
        text = (
            f"{policy.lost_link_after_s} s is less than {HEARTBEATS} heartbeats at simulate.speedup = "
            f"{simulate.speedup:g}; give at least {least_s:g}, or a lower speedup, or lost_link: continue"
        )
        yield Problem((*HERE, "policy", "lost_link_after_s"), text, given=("simulate", "speedup"))
