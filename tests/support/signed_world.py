"""A vehicle and a link that sign."""

from __future__ import annotations

import asyncio
import contextlib
from pathlib import Path
from typing import Any

from link_world import WIRE
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.fleet import Fleet
from sim_vehicle.scenarios import Scenario
from swarmctl.links import LINKS
from swarmctl.links.frontend import FrontEnd
from swarmctl.links.signing import TICKS_PER_S, Signing, ticks
from swarmctl.links.transports.memory import MemoryWire
from swarmctl.links.url import Endpoint
from swarmctl.security.mavlink_key import TimestampFile

KEY = bytes(range(32))


BEGAN_US = 1_767_225_600_000_000
KEY_AGE_S = 60  # the vehicle's time stamps begin a minute after that of the key


WATCHER = Endpoint("memory", "watcher")


class SignedWorld:
    """A simulated copter with a key, and a ground station with the same key, another key or no key."""

    key = KEY

    def __init__(self, folder: Path, *, key: bytes | None = KEY, behind_s: int = 0) -> None:
        scenario = {"seed": 1, "vehicles": [{"sysid": 1, "lat_deg": 46.049, "lon_deg": 14.506}]}
        self.fleet = Fleet(Scenario.model_validate(scenario), ready_s=3.0)
        self.vehicle = self.fleet.vehicles[0]
        self.give_key(KEY, ticks(BEGAN_US) - (KEY_AGE_S + behind_s) * TICKS_PER_S)
        self.wire, self.watcher = MemoryWire(), MemoryWire()
        self.wire.connect_vehicles(self._to_vehicles)
        self.to_vehicles: list[bytes] = []
        self.from_vehicles: list[bytes] = []
        self.watched: list[bytes] = []
        self.watcher.connect_vehicles(lambda data, _address: self.watched.append(data))
        self.events: list[Any] = []
        self.said: list[str] = []
        self.deaf = False
        self.signing = None if key is None else Signing(key, TimestampFile(folder / "key"))
        self.front = FrontEnd(
            wall_time_us=lambda: BEGAN_US + round(asyncio.get_running_loop().time() * 1e6),
            memory={"test": self.wire, "watcher": self.watcher},
            signing=self.signing,
            say=self.said.append,
        )

    def give_key(self, key: bytes, timestamp: int) -> None:
        """Give the vehicle a key, as Mission Planner does over USB; all zeros take it away."""
        codec = station(self.key)
        codec.signing.timestamp = ticks(BEGAN_US)
        message = mavlink.MAVLink_setup_signing_message(1, 1, list(key), timestamp)
        self.fleet.receive(bytes(message.pack(codec)), 0.0)
        self.key = key

    def link(self) -> Any:
        return LINKS["direct"].open(self.front, WIRE, 1, name="alpha", on_event=self.events.append)

    def _to_vehicles(self, data: bytes, address: object) -> None:
        self.to_vehicles.append(data)
        self._from(self.fleet.receive(data, asyncio.get_running_loop().time(), peer=address))

    def _from(self, frames: list[tuple[int, bytes]]) -> None:
        for _, data in frames:
            self.from_vehicles.append(data)
            if not self.deaf:
                self.wire.from_vehicle(data, "fleet")

    async def _move(self) -> None:
        while True:
            self._from(self.fleet.step(asyncio.get_running_loop().time()))
            await asyncio.sleep(0.05)

    async def __aenter__(self) -> SignedWorld:
        self._task = asyncio.create_task(self._move())
        return self

    async def __aexit__(self, *error: object) -> None:
        self._task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await self._task
        await self.front.close()


def station(key: bytes = KEY) -> mavlink.MAVLink:
    codec = mavlink.MAVLink(None, srcSystem=252, srcComponent=190)
    codec.robust_parsing = True
    codec.signing.secret_key, codec.signing.sign_outgoing = key, True
    codec.signing.timestamp, codec.signing.link_id = ticks(BEGAN_US), 9
    return codec
