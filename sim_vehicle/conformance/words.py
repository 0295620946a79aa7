"""Names for numbers, and what a check says when they are wrong."""

from typing import TYPE_CHECKING, Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance.registry import CheckFailed, Skip

if TYPE_CHECKING:
    from sim_vehicle.conformance.peer import Peer


def id_of(kind: str) -> int:
    found: int = getattr(mavlink, f"MAVLINK_MSG_ID_{kind}")
    return found


def _enum_name(enum: str, value: int, prefix: str) -> str:
    entry = mavlink.enums[enum].get(value)
    return entry.name.removeprefix(prefix) if entry is not None else str(value)


def result_name(result: int) -> str:
    return _enum_name("MAV_RESULT", result, "MAV_RESULT_")


def mission_result_name(result: int) -> str:
    return _enum_name("MAV_MISSION_RESULT", result, "MAV_MISSION_")


def command_name(command: int) -> str:
    return _enum_name("MAV_CMD", command, "MAV_CMD_")


def equal(seen: Any, expected: Any, what: str) -> None:
    """CheckFailed unless `seen` is what was expected."""
    if seen != expected:
        raise CheckFailed(f"{what}: expected {expected}, saw {seen}")


def near(seen: float, expected: float, tolerance: float, what: str) -> None:
    """CheckFailed unless two numbers agree."""
    if not abs(seen - expected) <= tolerance:  # also false for NaN
        raise CheckFailed(f"{what}: expected {expected:g} within {tolerance:g}, saw {seen:g}")


def holds(condition: bool, otherwise: str) -> None:
    """CheckFailed with a text unless the condition is true."""
    if not condition:
        raise CheckFailed(otherwise)


_UNSAID = object()


def known(peer: "Peer", *, ardupilot: Any = _UNSAID, px4: Any = _UNSAID) -> Any:
    """What this vehicle's autopilot is known to do; Skip where nobody has observed it."""
    value = {"ardupilot": ardupilot, "px4": px4}.get(peer.dialect.name, _UNSAID)
    if value is _UNSAID:
        raise Skip("the specification leaves this open, and this autopilot's habit is not known")
    return value
