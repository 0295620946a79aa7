"""MAV_CMD commands, as COMMAND_LONG or COMMAND_INT; each handler returns a MAV_RESULT.

Each personality has a table of handlers. This module has what the tables share.
"""

import math

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.vehicle.command import Command
from sim_vehicle.vehicle.interface import CommandHandler, Vehicle
from sim_vehicle.vehicle.numbers import to_int

FORCE = 21_196  # param2 of arm and disarm: skip the checks
ACCEPTED = int(mavlink.MAV_RESULT_ACCEPTED)
DENIED = int(mavlink.MAV_RESULT_DENIED)
FAILED = int(mavlink.MAV_RESULT_FAILED)
UNSUPPORTED = int(mavlink.MAV_RESULT_UNSUPPORTED)
TEMPORARILY_REJECTED = int(mavlink.MAV_RESULT_TEMPORARILY_REJECTED)
IN_PROGRESS = int(mavlink.MAV_RESULT_IN_PROGRESS)
NO_ANSWER = -1  # no acknowledgement is sent
MAX_INTERVAL_US = 2**31 - 1


def execute(vehicle: Vehicle, command: Command, now: float) -> int:
    """Carry out `command` and return its MAV_RESULT."""
    handler = vehicle.personality.commands.handlers.get(command.command)
    return UNSUPPORTED if handler is None else handler(vehicle, command, now)


def set_message_interval(vehicle: Vehicle, command: Command, now: float) -> int:
    message_id = to_int(command.param1)
    if not vehicle.rates.can_stream(message_id):
        return DENIED
    interval_us = command.param2 if math.isfinite(command.param2) else -1
    if interval_us == 0:
        vehicle.rates.reset(message_id, now)
    else:
        vehicle.rates.set(message_id, interval_us / 1e6, now)
    return ACCEPTED


def get_message_interval(vehicle: Vehicle, command: Command, _now: float) -> int:
    message_id = to_int(command.param1)
    if not 0 <= message_id <= 0xFFFF:
        return DENIED
    interval_us = reported_interval_us(vehicle, message_id)
    # MESSAGE_INTERVAL is 0 for an unknown message and -1 for a known message that is not streamed.
    one_shot = vehicle.personality.messages.one_shot
    known = vehicle.rates.can_stream(message_id) or message_id in one_shot
    vehicle.send(mavlink.MAVLink_message_interval_message(message_id, interval_us if known else 0))
    return ACCEPTED if known else FAILED


def reported_interval_us(vehicle: Vehicle, message_id: int) -> int:
    """Return the interval for MESSAGE_INTERVAL [us]; -1: the message is not streamed."""
    interval_s = vehicle.rates.interval_s(message_id)
    return -1 if interval_s is None else round(min(interval_s * 1e6, MAX_INTERVAL_US))


def send_message(message_id: int, otherwise: int = FAILED) -> CommandHandler:
    """Return a handler that sends a message; `otherwise` is the result if the vehicle has no data for it."""

    def handler(vehicle: Vehicle, _command: Command, now: float) -> int:
        return ACCEPTED if vehicle.send_now(message_id, now) else otherwise

    return handler
