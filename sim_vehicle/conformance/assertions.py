"""Comparisons that return the seen value, or raise CheckFailed."""

from collections.abc import Collection
from typing import Any, TypeVar

from sim_vehicle.conformance.outcomes import ACCEPTED, CheckFailed

T = TypeVar("T")


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
    if not seen <= limit:
        raise CheckFailed(f"{label}: expected at most {limit:g}, saw {seen:g}")
    return seen


def at_least(seen: float, limit: float, label: str) -> float:
    """Return `seen`; raise CheckFailed if it is less than the limit."""
    if not seen >= limit:
        raise CheckFailed(f"{label}: expected at least {limit:g}, saw {seen:g}")
    return seen


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
