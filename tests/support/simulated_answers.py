"""Answers of a simulated vehicle to commands that differ from those of its autopilot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.vehicle.behaviour import Behaviour
from sim_vehicle.vehicle.command import Command

MISSION_INT = int(mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT)
Handler = Callable[[Any, Command, float], int]
"""From the vehicle, a command and the time to its MAV_RESULT."""


def answer(vehicle: Any, number: int, handler: Callable[[Handler], Handler]) -> None:
    """Replace a vehicle's handler of a command; `handler` gets the present one."""
    rules = vehicle.personality.commands
    handlers = {**rules.handlers, number: handler(rules.handlers[number])}
    vehicle.personality = replace(vehicle.personality, commands=replace(rules, handlers=handlers))


def refuse(
    vehicle: Any,
    number: int,
    result: int = mavlink.MAV_RESULT_FAILED,
    text: str = "",
    *,
    when: Callable[[Command], bool] = lambda command: True,
) -> None:
    """Let a vehicle refuse a command with this result, after a critical text if there is one."""

    def handler(usual: Handler) -> Handler:
        def refused(vehicle: Any, command: Command, now: float) -> int:
            if not when(command):
                return usual(vehicle, command, now)
            if text:
                vehicle.send_text(mavlink.MAV_SEVERITY_CRITICAL, text)
            return result

        return refused

    answer(vehicle, number, handler)


def refuse_heartbeats(vehicle: Any) -> None:
    """Let a vehicle send a heartbeat every second, but none on request."""
    number, heartbeat = mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_HEARTBEAT
    refuse(vehicle, number, mavlink.MAV_RESULT_UNSUPPORTED, when=lambda c: c.param1 == heartbeat)


def stay_on_ground(vehicle: Any) -> None:
    """Let a copter start its mission without the clearance for a take-off."""

    def start(vehicle: Any, _command: Command, _now: float) -> int:
        vehicle.modes.enter_behaviour(Behaviour.MISSION)
        return int(mavlink.MAV_RESULT_ACCEPTED)

    vehicle.set_parameter("DISARM_DELAY", 0.0)
    answer(vehicle, mavlink.MAV_CMD_MISSION_START, lambda _usual: start)


def identify_as(vehicle: Any, uid2: bytes, capabilities: int = MISSION_INT) -> None:
    """Let a vehicle send another AUTOPILOT_VERSION on request."""
    version = mavlink.MAVLink_autopilot_version_message(
        capabilities, 0x04060200, 0, 0, 0, bytes(8), bytes(8), bytes(8), 0, 0, 0, uid2.ljust(18, b"\0")
    )

    def handler(usual: Handler) -> Handler:
        def requested(vehicle: Any, command: Command, now: float) -> int:
            if command.param1 != mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION:
                return usual(vehicle, command, now)
            vehicle.send(version)
            return int(mavlink.MAV_RESULT_ACCEPTED)

        return requested

    answer(vehicle, mavlink.MAV_CMD_REQUEST_MESSAGE, handler)
