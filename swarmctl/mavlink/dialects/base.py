"""`Dialect`: the differences between autopilots, with the usual values."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from math import inf

from swarmctl.core.geo import LatLon
from swarmctl.core.mission import FlightPlan, MissionItem
from swarmctl.mavlink.protocol.command import CommandResult
from swarmctl.mavlink.protocol.conversation import Conversation, MavlinkPeer


class Unsupported(Exception):
    """No dialect for this vehicle."""


class Dialect(ABC):
    """Facts about one autopilot and airframe, and conversions of plans, modes and items."""

    name: str
    """name for messages, e.g. ArduPilot"""
    firmware: str
    """name of the firmware in the tables of parameters (`swarmctl.preflight.policy`)"""
    hold_mode: str
    """mode that holds the vehicle in the air without a pilot; a mission can start from this mode"""
    mission_mode: str
    return_mode: str
    land_mode: str
    """mode that lands without a pilot; the mission mode if landing needs a mission"""
    setpoint_mode: str | None = None
    """mode that follows set-points, possibly the hold mode; None for a vehicle that is never led so"""
    land_command: int | None = None
    """MAV_CMD that leads to the landing of the mission; None if a mode lands"""
    lands_at_nearest = True
    """True if `land_command` leads to the nearest of several landings; otherwise the autopilot knows a single
    landing, and the command may arm the vehicle"""
    speed_type: int
    """SPEED_TYPE for MAV_CMD_DO_CHANGE_SPEED"""
    streams_hz: Mapping[int, float]
    """rates to request [Hz], by message id; readiness needs all these messages except HOME_POSITION"""
    first_seq: int | None = None
    """item that has to be current before a launch; None if `start_mission` sets the item"""
    may_lack_rally = False
    """True if some builds lack rally points; their answer is MAV_MISSION_UNSUPPORTED"""
    arms_at_any_item = True
    """False if `first_seq` has to be made current after a landing, before the vehicle arms"""
    first_waypoint_seq: int
    """index of the first waypoint, after home placeholder and take-off"""
    uncounted_items = 0
    """number of items that MISSION_CURRENT.total leaves out: 1 with a home placeholder"""
    upload_timeout_s: float
    """longest time for which the vehicle keeps an interrupted transfer open"""
    uploads_atomically: bool
    """True if a complete upload replaces the old mission at once, not item by item"""
    flies_stored_within_m = inf
    """distance of a vehicle from the first position of its stored mission up to which it flies it"""
    brakes_m_s2: float | None = None
    """deceleration before the flight to a new current item; None: the vehicle turns without a stop"""
    start_delay_s = 0.0
    """time lost at a start from a stand because the jerk is limited; 0 for a plane"""
    serves_single_items: bool
    """True if the vehicle answers requests for single mission items outside of a transfer"""

    @property
    @abstractmethod
    def start_mission(self) -> tuple[int, tuple[float, ...]]:
        """Command (MAV_CMD, parameters) that makes an armed vehicle on the ground take off."""

    @abstractmethod
    def mode_name(self, custom_mode: int) -> str: ...

    @abstractmethod
    def mode_params(self, name: str) -> tuple[float, ...]:
        """Return the parameters of MAV_CMD_DO_SET_MODE."""

    @abstractmethod
    def mission_items(self, plan: FlightPlan, start: LatLon | None = None) -> tuple[MissionItem, ...]:
        """Return a plan as this autopilot's mission; `start` is the take-off position.

        Raises ValueError for a plan that cannot be flown.
        """

    @abstractmethod
    def is_same(self, seq: int, sent: MissionItem, found: MissionItem) -> bool:
        """Return whether the item read back at index `seq` is the sent item, as the autopilot stores it."""

    @abstractmethod
    def set_current(self, peer: MavlinkPeer, seq: int, attempt: int) -> Conversation[CommandResult]:
        """Return one try to make an item current; `attempt`: number of earlier tries."""

    def differences(
        self, sent: Sequence[MissionItem], found: Sequence[MissionItem], first: int = 0
    ) -> tuple[str, ...]:
        """Return the differences between the items sent and read back, except the autopilot's roundings.

        `first`: index of the first item in the vehicle's list.
        """
        if len(sent) != len(found):
            return (f"{len(found)} items instead of {len(sent)}",)
        return tuple(
            f"item {seq}: sent {a}, found {b}"
            for seq, (a, b) in enumerate(zip(sent, found, strict=True), first)
            if not self.is_same(seq, a, b)
        )
