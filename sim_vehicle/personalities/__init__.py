"""What differs between autopilots, one module each, as data where it can be."""

from sim_vehicle.personalities.ardupilot import ARDUPILOT
from sim_vehicle.personalities.base import Behaviour, Mode, Personality

PERSONALITIES: dict[str, Personality] = {"ardupilot": ARDUPILOT}

__all__ = ["PERSONALITIES", "Behaviour", "Mode", "Personality"]
