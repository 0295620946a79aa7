"""The questions that every autopilot answers differently."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from swarmctl.core.geo import LatLon
from swarmctl.core.mission import FlightPlan, MissionItem
from swarmctl.mavlink.protocol.command import CommandResult
from swarmctl.mavlink.protocol.conversation import Conversation, MavlinkPeer


class Unsupported(Exception):
    """No dialect for this vehicle."""


@dataclass(frozen=True, slots=True)
class Readiness:
    """What readiness is judged by; None: not heard yet."""

    mode: str
    prearm_ok: bool | None
    """SYS_STATUS health bit MAV_SYS_STATUS_PREARM_CHECK"""
    ekf_flags: int | None
    """EKF_STATUS_REPORT.flags"""
    complaints: tuple[str, ...]
    """its newest "PreArm: ..." texts"""


class Dialect(Protocol):
    @property
    def name(self) -> str:
        """For people, e.g. ArduPilot."""

    @property
    def hold_mode(self) -> str:
        """Stays in the air where it is, without a pilot's stick, and takes a new mission there."""

    @property
    def mission_mode(self) -> str: ...

    @property
    def return_mode(self) -> str: ...

    @property
    def land_mode(self) -> str:
        """Comes down without a pilot; the mission's mode where a mission has to say how."""

    @property
    def land_command(self) -> int | None:
        """MAV_CMD by which it goes to the landing of its mission; None where its mode lands."""

    @property
    def lands_at_nearest(self) -> bool:
        """That is the nearest of several; else the only one that it knows as such (and it may arm for it)."""

    @property
    def speed_type(self) -> int:
        """Of MAV_CMD_DO_CHANGE_SPEED: what sets how fast it flies."""

    @property
    def streams_hz(self) -> Mapping[int, float]:
        """Message id -> rate to ask for."""

    @property
    def required(self) -> tuple[int, ...]:
        """Ids of the messages without which the vehicle is not ready."""

    @property
    def first_seq(self) -> int | None:
        """The item to be current before a launch; None where starting the mission sees to that."""

    @property
    def may_lack_rally(self) -> bool:
        """It may be built without rally points; then it says that a list of them is unsupported."""

    @property
    def arms_anywhere(self) -> bool:
        """Whichever item is current; else not while that is one of a landing: `first_seq` has to be."""

    @property
    def first_waypoint_seq(self) -> int:
        """Where a vehicle that flies already starts a mission."""

    @property
    def uncounted_items(self) -> int:
        """of a mission, which MISSION_CURRENT.total leaves out: home"""

    @property
    def upload_timeout_s(self) -> float:
        """How long after the last message of a broken upload the vehicle has surely given it up."""

    @property
    def uploads_atomically(self) -> bool:
        """A new mission takes the old one's place when it is complete; else item by item, and the flight
        follows at once."""

    @property
    def brakes_m_s2(self) -> float | None:
        """How hard it brakes, down to a stop, before it flies to another item that is made current; None: it
        turns to that at once."""

    @property
    def serves_single_items(self) -> bool:
        """Items of its mission to whoever asks, outside of a transfer too."""

    @property
    def start_mission(self) -> tuple[int, tuple[float, ...]]:
        """Command (MAV_CMD, parameters) by which a vehicle, armed and on the ground, takes off."""

    def mode_name(self, custom_mode: int) -> str: ...

    def mode_params(self, name: str) -> tuple[float, ...]:
        """Parameters of MAV_CMD_DO_SET_MODE."""

    def not_ready(self, readiness: Readiness) -> tuple[str, ...]:
        """Why it would not arm and fly a mission now; empty when it would."""

    def mission_items(self, plan: FlightPlan, start: LatLon | None = None) -> tuple[MissionItem, ...]:
        """The plan as this autopilot's mission; `start` is where it takes off.

        Raises ValueError for a plan that cannot be flown.
        """

    def differences(
        self, sent: Sequence[MissionItem], found: Sequence[MissionItem], first: int = 0
    ) -> tuple[str, ...]:
        """How a mission read back differs from the one sent, its own roundings aside; empty when equal.

        `first`: the place of the first of them in the vehicle's list.
        """

    def set_current(self, peer: MavlinkPeer, seq: int, attempt: int) -> Conversation[CommandResult]:
        """One try (`attempt` 0 is the first) to make an item the one that is flown."""
