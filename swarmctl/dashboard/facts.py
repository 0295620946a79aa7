"""The known facts of one vehicle, with their times: positions, states, plans and messages. Pure."""

from __future__ import annotations

import math
from array import array
from bisect import bisect_right
from collections import defaultdict
from typing import NamedTuple

import msgspec

from swarmctl.core.frames import IntentShared
from swarmctl.core.geo import LatLon
from swarmctl.core.messages import CommunicationRange
from swarmctl.core.threat import FiringStrength
from swarmctl.dashboard.belief_history import BeliefHistory
from swarmctl.dashboard.history import Items, Steps
from swarmctl.dashboard.picture import MapPoint, ShownRoute


class Motion(NamedTuple):
    """A row of numbers at one time; None for an unknown number."""

    lat_deg: float | None = None
    lon_deg: float | None = None
    height_m: float | None = None
    speed_m_s: float | None = None
    course_deg: float | None = None
    battery_percent: float | None = None
    strikes: float | None = None
    boot_s: float | None = None
    """vehicle's clock"""
    delay_s: float | None = None
    """age of the position at its arrival"""
    flown_m: float | None = None
    """length of the flown track so far"""
    to_go_m: float | None = None
    """distance along the route to its last waypoint"""

    @property
    def lat_lon(self) -> LatLon | None:
        return None if self.lat_deg is None or self.lon_deg is None else (self.lat_deg, self.lon_deg)


class Motions:
    """The rows of a vehicle, packed: an hour has ten thousands. NaN stands for an unknown number."""

    __slots__ = ("_numbers", "_times_s", "last")

    def __init__(self) -> None:
        self._times_s = array("d")
        self._numbers = array("d")
        self.last = Motion()
        """the newest row"""

    def add(self, time_s: float, row: Motion) -> None:
        self.last = row
        self._times_s.append(time_s)
        self._numbers.extend([math.nan if number is None else number for number in row])

    def at(self, time_s: float) -> Motion:
        """Return the last row up to a time; before the first row all numbers are unknown."""
        end = len(Motion._fields) * bisect_right(self._times_s, time_s)
        row = self._numbers[max(end - len(Motion._fields), 0) : end]
        return Motion(*(None if math.isnan(number) else number for number in row))


class Words(msgspec.Struct, frozen=True):
    """The values that change now and then."""

    phase: str = ""
    mode: str = ""
    armed: bool | None = None
    outcome: str = ""
    trouble: str = ""
    waiting: str = ""
    group: str = ""
    """group, shape, leader and place error, in words"""
    leads: bool = False
    """True if the vehicle tells its group that it leads"""
    place_error_m: int | None = None
    """distance from the own place in the group [m], as told to the group"""
    replans: int = 0
    n_observed: int = 0
    n_found: int = 0
    w: float | None = None
    strength: FiringStrength | None = None
    range: CommunicationRange | None = None
    """range of communication that an operator has set"""
    lost_since_s: float | None = None
    """time of the last telemetry of a vehicle whose link is lost"""


class SentIntent(NamedTuple):
    boot_s: float | None
    """vehicle's clock at the time of sending; None: unknown"""
    packed: bytes

    @property
    def intent(self) -> IntentShared:
        return _intents.decode(self.packed)


_intents = msgspec.msgpack.Decoder(IntentShared)


class VehicleFacts:
    """The histories of one vehicle."""

    def __init__(self, name: str, uav: int, beliefs: BeliefHistory) -> None:
        self.name = name
        self.uav = uav
        self.motion = Motions()
        self.words = Steps(Words())
        self.word_s = array("d")
        """times of the vehicle's words"""
        self.track: Items[MapPoint] = Items()
        self.route: Steps[ShownRoute | None] = Steps(None)
        self.plans: dict[int, ShownRoute] = {}
        """routes by plan number"""
        self.beliefs = beliefs
        self.intents: Items[SentIntent] = Items()
        self.heard_s: defaultdict[int, array[float]] = defaultdict(lambda: array("d"))
        """times at which messages of each other vehicle had arrived"""
        self.intents_heard_s: defaultdict[int, array[float]] = defaultdict(lambda: array("d"))
        """the same, of intents"""
        self.is_silent = False
        """True if an alarm has told that the vehicle is silent"""
