"""A station that receives a forwarded link."""

from __future__ import annotations

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.links.transports.memory import MemoryWire
from swarmctl.links.url import Endpoint

WATCHER = Endpoint("memory", "watcher")


class ForwardReceiver:
    """A receiver of forwarded frames on a memory wire, which can also send."""

    def __init__(self) -> None:
        self.wire = MemoryWire()
        self.wire.connect_vehicles(lambda data, _address: self.frames.append(data))
        self.frames: list[bytes] = []

    def received(self) -> list[Any]:
        parser = mavlink.MAVLink(None)
        return [m for frame in self.frames for m in parser.parse_buffer(frame)]

    def say(self, message: Any) -> None:
        station = mavlink.MAVLink(None, srcSystem=252, srcComponent=190)
        self.wire.from_vehicle(bytes(message.pack(station)), "station")
