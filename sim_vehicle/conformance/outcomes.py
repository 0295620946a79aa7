"""Outcomes of checks, and names of results."""

from enum import Enum

from sim_vehicle.station.messages import enum_name


class Outcome(Enum):
    PASSED = "passed"
    FAILED = "failed"
    SKIPPED = "skipped"


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
