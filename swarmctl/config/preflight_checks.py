"""Checks of the section `preflight`: the fence's polygon, and the time until a lost link. Pure."""

from __future__ import annotations

from collections.abc import Iterator

from swarmctl.config.model import Config
from swarmctl.config.preflight import MAX_LOST_LINK_S
from swarmctl.config.problems import ConfigProblem
from swarmctl.config.yaml_lines import KeyPath
from swarmctl.core.planar import crossing_sides

SECTION: KeyPath = ("preflight",)
MIN_HEARTBEATS = 3
"""least time until a lost link [heartbeats]; the ground station sends one each second of real time"""


def check_preflight(config: Config) -> Iterator[ConfigProblem]:
    """Yield problems of the fence and of the lost-link policy."""
    yield from _check_fence(config)
    yield from _check_lost_link(config)


def _check_fence(config: Config) -> Iterator[ConfigProblem]:
    """Yield the problem of crossing sides: autopilots accept such a polygon, but its inside is undefined."""
    corners = config.preflight.fence.polygon
    if corners is None:
        return
    sides = crossing_sides([(corner.lon_deg, corner.lat_deg) for corner in corners])
    if sides is not None:
        text = f"the sides that begin at corners [{sides[0]}] and [{sides[1]}] meet, so the polygon's inside "
        text += "is undefined; list the corners in order around the polygon, each once"
        yield ConfigProblem((*SECTION, "fence", "polygon", sides[1]), text)


def _check_lost_link(config: Config) -> Iterator[ConfigProblem]:
    """Yield the problem of a timeout that is too short for the simulated vehicles' clocks."""
    simulate, policy = config.simulate, config.preflight.policy
    if simulate is None or policy.lost_link == "continue":
        return
    least_s = MIN_HEARTBEATS * simulate.speedup
    if policy.lost_link_after_s < least_s:
        longer = f"{least_s:g} s or more, " if least_s <= MAX_LOST_LINK_S else ""
        text = (
            f"{policy.lost_link_after_s} s is less than {MIN_HEARTBEATS} heartbeats at simulate.speedup = "
            f"{simulate.speedup:g}; give {longer}a lower speedup, or lost_link: continue"
        )
        yield ConfigProblem(
            (*SECTION, "policy", "lost_link_after_s"), text, depends_on=("simulate", "speedup")
        )
