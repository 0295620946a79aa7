"""Personalities: the differences between autopilots, one package for each autopilot.

A new personality is a module or a package, and an entry in `PERSONALITIES`.
"""

from collections.abc import Mapping

from sim_vehicle.personalities.ardupilot import ARDUPILOT
from sim_vehicle.personalities.base import Personality
from sim_vehicle.personalities.px4 import PX4

PERSONALITIES: dict[str, Mapping[str, Personality]] = {"ardupilot": ARDUPILOT, "px4": PX4}


def personality_of(name: str, kind: str) -> Personality:
    """Return an autopilot's personality for an airframe (`copter`, `plane`); raise KeyError if unknown."""
    return PERSONALITIES[name][kind]


__all__ = ["PERSONALITIES", "Personality", "personality_of"]
