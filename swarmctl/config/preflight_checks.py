"""What is wrong with the section `preflight` of a configuration, before anything starts. Pure."""

from __future__ import annotations

from collections.abc import Iterator

from swarmctl.config.model import Config, ConfigProblem
from swarmctl.config.yaml_lines import Path as KeyPath
from swarmctl.core.planar import crossing_sides

HERE: KeyPath = ("preflight",)
HEARTBEATS = 3
"""so many may be lost before a link counts as lost; one goes out each second of real time"""


def check_preflight(config: Config) -> Iterator[ConfigProblem]:
    yield from _judge_fence(config)
    yield from _judge_lost_link(config)


def _judge_fence(config: Config) -> Iterator[ConfigProblem]:
    """Whether it has an inside. Autopilots take one that has none."""
    corners = config.preflight.fence.polygon
    if corners is None:
        return
    sides = crossing_sides([(corner.lon_deg, corner.lat_deg) for corner in corners])
    if sides is not None:
        text = f"the sides that begin at [{sides[0]}] and [{sides[1]}] meet, so that it has no certain inside"
        text += "; give the corners in their order around it, each once"
        yield ConfigProblem((*HERE, "fence", "polygon", sides[1]), text)


def _judge_lost_link(config: Config) -> Iterator[ConfigProblem]:
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
        yield ConfigProblem((*HERE, "policy", "lost_link_after_s"), text, given=("simulate", "speedup"))
