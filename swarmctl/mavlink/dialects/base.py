"""The questions that every autopilot answers differently."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from swarmctl.core.mission import FlightPlan, MissionItem


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
        """Stands still in the air and takes a new mission there."""

    @property
    def mission_mode(self) -> str: ...

    @property
    def return_mode(self) -> str: ...

    @property
    def land_mode(self) -> str: ...

    @property
    def streams_hz(self) -> Mapping[int, float]:
        """Message id -> rate to ask for."""

    @property
    def required(self) -> tuple[int, ...]:
        """Ids of the messages without which the vehicle is not ready."""

    @property
    def first_waypoint_seq(self) -> int:
        """Where a vehicle that flies already starts a mission."""

    @property
    def upload_timeout_s(self) -> float:
        """How long after the last message of a broken upload the vehicle has surely given it up."""

    def mode_name(self, custom_mode: int) -> str: ...

    def mode_number(self, name: str) -> int: ...

    def not_ready(self, readiness: Readiness) -> tuple[str, ...]:
        """Why it would not arm and fly a mission now; empty when it would."""

    def mission_items(self, plan: FlightPlan) -> tuple[MissionItem, ...]:
        """The plan as this autopilot's mission. Raises ValueError for a plan that cannot be flown."""

    def differences(self, sent: Sequence[MissionItem], found: Sequence[MissionItem]) -> tuple[str, ...]:
        """How a mission read back differs from the one sent, its own roundings aside; empty when equal."""
