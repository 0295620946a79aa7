"""Failures of checks, comparisons that raise failures, and names of MAVLink numbers."""

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.station.messages import enum_name


class CheckFailed(Exception):
    """The vehicle behaved wrongly; the text gives the expected and the observed behaviour."""


class Skip(Exception):
    """The check does not apply to this vehicle; the text gives the reason."""


def id_of(kind: str) -> int:
    found: int = getattr(mavlink, f"MAVLINK_MSG_ID_{kind}")
    return found


def result_name(result: int) -> str:
    return enum_name("MAV_RESULT", result, "MAV_RESULT_")


def mission_result_name(result: int) -> str:
    return enum_name("MAV_MISSION_RESULT", result, "MAV_MISSION_")


def command_name(command: int) -> str:
    return enum_name("MAV_CMD", command, "MAV_CMD_")


def equal(seen: Any, expected: Any, label: str) -> None:
    """Raise CheckFailed unless `seen` equals the expected value."""
    if seen != expected:
        raise CheckFailed(f"{label}: expected {expected}, saw {seen}")


def near(seen: float, expected: float, tolerance: float, label: str) -> None:
    """Raise CheckFailed unless two numbers agree."""
    if not abs(seen - expected) <= tolerance:  # also false for NaN
        raise CheckFailed(f"{label}: expected {expected:g} within {tolerance:g}, saw {seen:g}")


def holds(condition: bool, otherwise: str) -> None:
    """Raise CheckFailed with a text unless the condition is true."""
    if not condition:
        raise CheckFailed(otherwise)
