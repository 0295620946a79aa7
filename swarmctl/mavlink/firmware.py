"""Firmware and airframe of a vehicle. Parameter names depend on the firmware."""

from __future__ import annotations

import re

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.vehicle import Airframe
from swarmctl.mavlink.dialects import Unsupported, dialect_for
from swarmctl.mavlink.events import Identity

_VERSION = re.compile(r"(\d+)\.(\d+)")


class Firmware(msgspec.Struct, frozen=True):
    """A firmware and its version."""

    name: str
    """ArduCopter, ArduPlane, PX4 or PX4 plane; empty if unknown"""
    version: tuple[int, int]
    """major and minor number; (0, 0) if unknown"""

    def __str__(self) -> str:
        return f"{self.name or 'an unknown firmware'} {self.version[0]}.{self.version[1]}"


def airframe_of(identity: Identity) -> Airframe:
    """Return the airframe by MAV_TYPE; everything but a fixed wing counts as a copter."""
    return "plane" if identity.vehicle_type == mavlink.MAV_TYPE_FIXED_WING else "copter"


def firmware_of(identity: Identity) -> Firmware:
    """Return the firmware and its version from a vehicle's identity."""
    try:
        name = dialect_for(identity.autopilot, identity.vehicle_type).firmware
    except Unsupported:
        name = ""
    found = _VERSION.search(identity.firmware)
    return Firmware(name, (int(found[1]), int(found[2])) if found else (0, 0))
