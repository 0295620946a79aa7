"""Checks of the section `preflight`: the fence's polygon, and the time of a lost link. Pure."""

from __future__ import annotations

from collections.abc import Iterator

from swarmctl.config.model import Config, ConfigProblem
from swarmctl.config.yaml_lines import Path as KeyPath
from swarmctl.core.planar import crossing_sides

HERE: KeyPath = ("preflight",)
HEARTBEATS = 3
"""heartbeats that may be lost before the link counts as lost; one goes out each second of real time"""


def check_preflight(config: Config) -> Iterator[ConfigProblem]:
    """Yield problems of the fence and of the lost-link policy."""
    yield from _check_fence(config)
    yield from _check_lost_link(config)


def _check_fence(config: Config) -> Iterator[ConfigProblem]:
    """Yield crossing sides of the polygon. Autopilots accept such a polygon, with an undefined inside."""
    corners = config.preflight.fence.polygon
    if corners is None:
        return
    sides = crossing_sides([(corner.lon_deg, corner.lat_deg) for corner in corners])
    if sides is not None:
        text = f"the sides that begin at corners [{sides[0]}] and [{sides[1]}] meet, so the polygon's inside "
        text += "is undefined; list the corners in order around it, each once"
        yield ConfigProblem((*HERE, "fence", "polygon", sides[1]), text)


def _check_lost_link(config: Config) -> Iterator[ConfigProblem]:
    """Yield a timeout so short that simulated vehicles lose the link between two heartbeats."""
    simulate, policy = config.simulate, config.preflight.policy
    if simulate is None or policy.lost_link == "continue":
        return
    least_s = HEARTBEATS * simulate.speedup
    if policy.lost_link_after_s < least_s:
        text = (
            f"{policy.lost_link_after_s} s is less than {HEARTBEATS} heartbeats at simulate.speedup = "
            f"{simulate.speedup:g}; give {least_s:g} or more, a lower speedup, or lost_link: continue"
        )
        yield ConfigProblem((*HERE, "policy", "lost_link_after_s"), text, depends_on=("simulate", "speedup"))
