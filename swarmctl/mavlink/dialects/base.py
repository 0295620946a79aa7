"""`Dialect`: the interface of every autopilot's dialect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

from swarmctl.core.geo import LatLon
from swarmctl.core.mission import FlightPlan, MissionItem
from swarmctl.mavlink.protocol.command import CommandResult
from swarmctl.mavlink.protocol.conversation import Conversation, MavlinkPeer


class Unsupported(Exception):
    """No dialect for this vehicle."""


class Dialect(Protocol):
    """Facts about one autopilot and airframe, and conversions of plans, modes and items."""

    @property
    def name(self) -> str:
        """Name for messages, e.g. ArduPilot."""

    @property
    def firmware(self) -> str:
        """Name of the firmware in the tables of parameters (`swarmctl.preflight.policy`)."""

    @property
    def hold_mode(self) -> str:
        """Mode that holds the vehicle in the air without a pilot; a mission can start from this mode."""

    @property
    def mission_mode(self) -> str: ...

    @property
    def return_mode(self) -> str: ...

    @property
    def land_mode(self) -> str:
        """Mode that lands without a pilot; the mission mode if landing needs a mission."""

    @property
    def setpoint_mode(self) -> str | None:
        """Mode that follows set-points, possibly the hold mode; None for a vehicle that is never led so."""

    @property
    def land_command(self) -> int | None:
        """MAV_CMD that leads to the landing of the mission; None if a mode lands."""

    @property
    def lands_at_nearest(self) -> bool:
        """Return whether `land_command` leads to the nearest of several landings.

        Otherwise the autopilot knows a single landing, and the command may arm the vehicle.
        """

    @property
    def speed_type(self) -> int:
        """SPEED_TYPE for MAV_CMD_DO_CHANGE_SPEED."""

    @property
    def streams_hz(self) -> Mapping[int, float]:
        """Rates to request [Hz], by message id. Readiness needs all these messages except HOME_POSITION."""

    @property
    def first_seq(self) -> int | None:
        """Item that has to be current before a launch; None if `start_mission` sets the item."""

    @property
    def may_lack_rally(self) -> bool:
        """Return whether some builds lack rally points; their answer is MAV_MISSION_UNSUPPORTED."""

    @property
    def arms_at_any_item(self) -> bool:
        """Return whether the vehicle arms at any current item.

        Otherwise `first_seq` has to be made current after a landing.
        """

    @property
    def first_waypoint_seq(self) -> int:
        """Index of the first waypoint, after home placeholder and take-off."""

    @property
    def uncounted_items(self) -> int:
        """Number of items that MISSION_CURRENT.total leaves out: 1 with a home placeholder, else 0."""

    @property
    def upload_timeout_s(self) -> float:
        """Longest time for which the vehicle keeps an interrupted transfer open [s]."""

    @property
    def uploads_atomically(self) -> bool:
        """Return whether a complete upload replaces the old mission at once, not item by item."""

    @property
    def flies_stored_within_m(self) -> float:
        """Distance of a vehicle from the first position of its stored mission up to which it flies it [m]."""

    @property
    def brakes_m_s2(self) -> float | None:
        """Deceleration before the flight to a new current item; None: the vehicle turns without a stop."""

    @property
    def start_delay_s(self) -> float:
        """Time lost at a start from a stand because the jerk is limited [s]; 0 for a plane."""

    @property
    def serves_single_items(self) -> bool:
        """Return whether the vehicle answers requests for single mission items outside of a transfer."""

    @property
    def start_mission(self) -> tuple[int, tuple[float, ...]]:
        """Command (MAV_CMD, parameters) that makes an armed vehicle on the ground take off."""

    def mode_name(self, custom_mode: int) -> str: ...

    def mode_params(self, name: str) -> tuple[float, ...]:
        """Return the parameters of MAV_CMD_DO_SET_MODE."""

    def mission_items(self, plan: FlightPlan, start: LatLon | None = None) -> tuple[MissionItem, ...]:
        """Return a plan as this autopilot's mission; `start` is the take-off position.

        Raises ValueError for a plan that cannot be flown.
        """

    def differences(
        self, sent: Sequence[MissionItem], found: Sequence[MissionItem], first: int = 0
    ) -> tuple[str, ...]:
        """Return the differences between the items sent and read back, except the autopilot's roundings.

        `first`: index of the first item in the vehicle's list.
        """

    def set_current(self, peer: MavlinkPeer, seq: int, attempt: int) -> Conversation[CommandResult]:
        """Return one try to make an item current; `attempt`: number of earlier tries."""
