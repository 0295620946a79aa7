"""Simulated vehicles on a memory wire with a link to each: on a virtual clock, or faster than real time."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from flying_bench import north_of_home
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.fleet import Fleet
from sim_vehicle.scenarios import Scenario
from swarmctl.flight.virtual_clock import run_virtual
from swarmctl.links import LINKS
from swarmctl.links.frontend import FrontEnd
from swarmctl.links.signing import TICKS_PER_S, Signing, ticks
from swarmctl.links.transports.memory import MemoryWire
from swarmctl.links.url import Endpoint
from swarmctl.security.mavlink_key import TimestampFile

WIRE, WATCHER = Endpoint("memory", "test"), Endpoint("memory", "watcher")
BEGAN_US = 1_767_225_600_000_000
HURRY = 25.0
"""speed-up: seconds of a copter's time in one second of the machine's clock"""
KEY, KEY_AGE_S = bytes(range(32)), 60
"""key of `SignedWorld`, and its age [s]: the vehicle's time stamps begin after that of the key"""
SHORTEST_SLEEP_S = 0.005
"""least time of the event loop between two steps, so that a busy machine keeps up [s]"""


def play(story, *, real: bool = False) -> None:
    """Run an async story for at most an hour on a virtual clock, or at most a minute of real time."""

    async def bounded():
        async with asyncio.timeout(60 if real else 3600):
            await story

    run = asyncio.run if real else run_virtual
    run(bounded())


class ForwardReceiver:
    """A station that receives forwarded frames over a memory wire, and can also send."""

    def __init__(self) -> None:
        self.wire = MemoryWire()
        self.wire.connect_vehicles(lambda data, _address: self.frames.append(data))
        self.frames: list[bytes] = []

    def received(self) -> list[Any]:
        parser = mavlink.MAVLink(None)
        return [m for frame in self.frames for m in parser.parse_buffer(frame)]

    def say(self, message: Any, codec: mavlink.MAVLink | None = None) -> None:
        """Send a message with this codec; None: a codec that does not sign."""
        codec = codec or mavlink.MAVLink(None, srcSystem=252, srcComponent=190)
        self.wire.from_vehicle(bytes(message.pack(codec)), "station")


class World:
    """Simulated vehicles on a memory wire, a front end with a link to each, and a watching station.

    The vehicles move while the world is entered. Each boot sends from a new port, as ArduPilot's UDP does.
    """

    STEP_S = 0.05

    def __init__(
        self,
        *personalities: str,
        first: int = 1,
        kind: str = "direct",
        ready_s: float = 3.0,
        tlog: Path | None = None,
        evidence: Any = None,
        signing: Signing | None = None,
    ) -> None:
        """Create vehicles with system ids from `first` on, by default one ArduCopter."""
        self.kind, self.tlog = kind, tlog
        self.wire, self.watching = MemoryWire(), ForwardReceiver()
        self.wire.connect_vehicles(self.to_fleet)
        self.to_vehicles: list[tuple[bytes, Any]] = []
        """messages to the vehicles, with their addresses"""
        self.from_vehicles: list[bytes] = []
        self.events: list = []
        self.said: list[str] = []
        self.silent = False
        """True: no message from a vehicle arrives"""
        self.loses = lambda frame: False
        """frames from a vehicle that do not arrive"""
        self.address: dict[int, Any] = {}
        """addresses other than `port`, by system id"""
        self.began_us = BEGAN_US
        """time of the machine's clock at time 0 of the event loop [µs]"""
        self.pace = 1.0 if kind == "direct" else HURRY
        """seconds of a vehicle's time in one second of the event loop's"""
        self._began_s = 0.0
        self.fleet = fleet_of(*(personalities or ("ardupilot",)), first=first, ready_s=ready_s)
        self.vehicles = {vehicle.sysid: vehicle for vehicle in self.fleet.vehicles}
        self.front = FrontEnd(
            wall_time_us=lambda: self.began_us + round(asyncio.get_running_loop().time() * 1e6),
            memory={"test": self.wire, "watcher": self.watching.wire},
            evidence=evidence,
            signing=signing,
            say=self.said.append,
        )

    def link(self, sysid: int = 1, name: str = "alpha"):
        return LINKS[self.kind].open(
            self.front, WIRE, sysid, name=name, on_event=self.events.append, tlog=self.tlog
        )

    def port(self, index: int) -> Any:
        """Return the address from which a vehicle sends."""
        ports = f"vehicle {index + 1}", 14_000 + self.fleet.boots()[index]
        return self.address.get(self.fleet.sysids[index], ports)

    def to_fleet(self, data: bytes, address: Any) -> None:
        """Pass a message to the vehicles at an address, and their answers back."""
        self.to_vehicles.append((data, address))
        targets = [i for i in range(len(self.fleet.vehicles)) if self.port(i) == address]
        if not self.silent:
            self._from(self.fleet.receive(data, self.now_s(), peer=address, reach=targets))

    def _from(self, frames: Iterable[tuple[int, bytes]]) -> None:
        for index, data in frames:
            self.from_vehicles.append(data)
            if not (self.silent or self.loses(data)):
                self.wire.from_vehicle(data, self.port(index))

    def now_s(self) -> float:
        """Time on the vehicles' clocks [s]."""
        return (asyncio.get_running_loop().time() - self._began_s) * self.pace

    def sent(self, kind: str, command: int | None = None) -> list[Any]:
        """Return the messages of a type to the vehicles, or those with a command."""
        parser = mavlink.MAVLink(None)
        parser.robust_parsing = True
        messages = [m for data, _ in self.to_vehicles for m in parser.parse_buffer(data) or []]
        return [
            m for m in messages if m.get_type() == kind and command in (None, getattr(m, "command", None))
        ]

    async def forward(self, *, commands: bool = False) -> None:
        """Forward all frames to the watching station."""
        await self.front.forward(WATCHER, commands=commands)
        self.watching.wire.from_vehicle(b"", "station")  # the first packet shows the station's address
        await asyncio.sleep(0)

    async def _move(self) -> None:
        while True:
            self._from(self.fleet.step(self.now_s()))
            await asyncio.sleep(max(self.STEP_S / self.pace, SHORTEST_SLEEP_S))

    async def __aenter__(self):
        self._began_s = asyncio.get_running_loop().time()
        self._task = asyncio.create_task(self._move())
        return self

    async def __aexit__(self, *error: object) -> None:
        self._task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await self._task
        await self.front.close()


class SignedWorld(World):
    """A simulated copter with a key, and a ground station with the same key, another key or no key."""

    key = KEY

    def __init__(self, folder: Path, *, key: bytes | None = KEY, behind_s: int = 0) -> None:
        self.signing = None if key is None else Signing(key, TimestampFile(folder / "key"))
        super().__init__("ardupilot", signing=self.signing)
        self.give_key(KEY, ticks(BEGAN_US) - (KEY_AGE_S + behind_s) * TICKS_PER_S)

    def give_key(self, key: bytes, timestamp: int) -> None:
        """Give the vehicle a key, as Mission Planner does over USB; all zeros take it away."""
        codec = signing_codec(self.key)
        codec.signing.timestamp = ticks(BEGAN_US)
        message = mavlink.MAVLink_setup_signing_message(1, 1, list(key), timestamp)
        self.fleet.receive(bytes(message.pack(codec)), 0.0)
        self.key = key


def signing_codec(key: bytes = KEY) -> mavlink.MAVLink:
    codec = mavlink.MAVLink(None, srcSystem=252, srcComponent=190)
    codec.robust_parsing = True
    codec.signing.secret_key, codec.signing.sign_outgoing = key, True
    codec.signing.timestamp, codec.signing.link_id = ticks(BEGAN_US), 9
    return codec


def fleet_of(*personalities: str, first: int = 1, ready_s: float = 3.0) -> Fleet:
    vehicles = [
        {"sysid": first + n, "lat_deg": 46.049 + 0.001 * n, "lon_deg": 14.506, "personality": personality}
        for n, personality in enumerate(personalities)
    ]
    content = {"seed": 1, "vehicles": vehicles}
    return Fleet(Scenario.model_validate(content), ready_s=ready_s, keeps_logs=False)


async def until(condition, limit_s: float = 60.0) -> None:
    async with asyncio.timeout(limit_s):
        while not condition():  # noqa: ASYNC110 - not every condition has an event
            await asyncio.sleep(0.02)


async def connected(world: World):
    link = world.link()
    await link.connect(10)
    return link


async def uploaded(world: World, count: int = 8):
    """Return a link to a vehicle with a mission of `count` waypoints, ready for its launch."""
    link = await connected(world)
    await link.prepare(60, lambda _: None)
    await link.upload(north_of_home(count))
    return link


async def flying(world: World):
    link = await uploaded(world)
    await link.launch()
    await until(lambda: link.state().mission_seq == 3)
    return link
