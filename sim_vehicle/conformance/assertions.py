"""Failures of checks, comparisons that raise failures, and names of MAVLink numbers."""

import math
from collections.abc import Collection
from typing import Any, TypeVar

from sim_vehicle.station.messages import enum_name

T = TypeVar("T")


class CheckFailed(Exception):
    """The vehicle behaved wrongly; the text gives the expected and the observed behaviour."""


class Skip(Exception):
    """The check does not apply to this vehicle; the text gives the reason."""


ACCEPTED = "ACCEPTED"  # MAV_RESULT_ACCEPTED and MAV_MISSION_ACCEPTED


def result_name(result: int) -> str:
    return enum_name("MAV_RESULT", result, "MAV_RESULT_")


def mission_result_name(result: int) -> str:
    return enum_name("MAV_MISSION_RESULT", result, "MAV_MISSION_")


def command_name(command: int) -> str:
    return enum_name("MAV_CMD", command, "MAV_CMD_")


def equal(seen: T, expected: Any, label: str) -> T:
    """Return `seen`; raise CheckFailed unless it equals the expected value."""
    if seen != expected:
        raise CheckFailed(f"{label}: expected {expected}, saw {seen}")
    return seen


def near(seen: float, expected: float, tolerance: float, label: str) -> float:
    """Return `seen`; raise CheckFailed unless it agrees with the expected number."""
    if not abs(seen - expected) <= tolerance:  # also false for NaN
        raise CheckFailed(f"{label}: expected {expected:g} within {tolerance:g}, saw {seen:g}")
    return seen


def within(seen: float, low: float, high: float, label: str) -> float:
    """Return `seen`; raise CheckFailed unless it is between two limits, both included."""
    if not low <= seen <= high:  # also false for NaN
        raise CheckFailed(f"{label}: expected {low:g} to {high:g}, saw {seen:g}")
    return seen


def at_most(seen: float, limit: float, label: str) -> float:
    """Return `seen`; raise CheckFailed if it is greater than the limit."""
    return within(seen, -math.inf, limit, label)


def at_least(seen: float, limit: float, label: str) -> float:
    """Return `seen`; raise CheckFailed if it is less than the limit."""
    return within(seen, limit, math.inf, label)


def one_of(seen: T, allowed: Collection[Any], label: str) -> T:
    """Return `seen`; raise CheckFailed unless it is one of the allowed values."""
    if seen not in allowed:
        raise CheckFailed(f"{label}: expected one of {allowed}, saw {seen}")
    return seen


def refused(result: str) -> str:
    """Return the result of a refused command or upload; raise CheckFailed for ACCEPTED."""
    if result == ACCEPTED:
        raise CheckFailed("expected a refusal, saw ACCEPTED")
    return result


def holds(condition: bool, otherwise: str) -> None:
    """Raise CheckFailed with a text unless the condition is true."""
    if not condition:
        raise CheckFailed(otherwise)
