"""Vehicles on a memory wire with a link to each: on a virtual clock, or faster than real time."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Iterable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scripted_copter import Copter
from wire_bench import north_of_home

from sim_vehicle.fleet import Fleet
from sim_vehicle.scenarios import Scenario
from swarmctl.flight.virtual_clock import run_virtual
from swarmctl.links import LINKS
from swarmctl.links.direct import DirectLink
from swarmctl.links.frontend import FrontEnd
from swarmctl.links.signing import Signing
from swarmctl.links.transports.memory import MemoryWire
from swarmctl.links.url import Endpoint

WIRE, WATCHER = Endpoint("memory", "test"), Endpoint("memory", "watcher")
BEGAN_US = 1_767_225_600_000_000
HURRY = 25.0
"""speed-up: seconds of a copter's time in one second of the machine's clock"""


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


class MemoryWorld:
    """A front end, vehicles on a memory wire that move while the world is entered, and a watching station."""

    STEP_S = 0.05

    def __init__(self, *, evidence=None, signing: Signing | None = None) -> None:
        self.wire, self.watching = MemoryWire(), ForwardReceiver()
        self.wire.connect_vehicles(self._to_vehicles)
        self.to_vehicles: list[tuple[bytes, Any]] = []
        """messages to the vehicles, with their addresses"""
        self.events: list = []
        self.said: list[str] = []
        self.silent = False
        """True: no message from a vehicle arrives"""
        self.began_us = BEGAN_US
        """time of the machine's clock at time 0 of the event loop [µs]"""
        self.pace = 1.0
        """seconds of a vehicle's time in one second of the event loop's"""
        self._began_s = 0.0
        self.front = FrontEnd(
            wall_time_us=lambda: self.began_us + round(asyncio.get_running_loop().time() * 1e6),
            memory={"test": self.wire, "watcher": self.watching.wire},
            evidence=evidence,
            signing=signing,
            say=self.said.append,
        )

    def _to_vehicles(self, data: bytes, address: Any) -> None:
        """Pass a message to the vehicles, and their answers back."""
        raise NotImplementedError

    def _step(self) -> None:
        """Move the vehicles until now."""
        raise NotImplementedError

    def now_s(self) -> float:
        """Time on the vehicles' clocks [s]."""
        return (asyncio.get_running_loop().time() - self._began_s) * self.pace

    async def forward(self, *, commands: bool = False) -> None:
        """Forward all frames to the watching station."""
        await self.front.forward(WATCHER, commands=commands)
        self.watching.wire.from_vehicle(b"", "station")  # the first packet shows the station's address
        await asyncio.sleep(0)

    async def _move(self) -> None:
        while True:
            self._step()
            await asyncio.sleep(self.STEP_S / self.pace)

    async def __aenter__(self):
        self._began_s = asyncio.get_running_loop().time()
        self._task = asyncio.create_task(self._move())
        return self

    async def __aexit__(self, *error: object) -> None:
        self._task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await self._task
        await self.front.close()


class World(MemoryWorld):
    """Scripted copters, and a link to each."""

    STEP_S = 0.1

    def __init__(self, *copters: Copter, tlog=None, kind: str = "direct", evidence=None) -> None:
        super().__init__(evidence=evidence)
        self.kind, self.tlog = kind, tlog
        self.pace = 1.0 if kind == "direct" else HURRY
        self.copters = {c.sysid: c for c in copters}
        self.address = {c.sysid: "fleet" for c in copters}

    def link(self, sysid: int = 1, name: str = "alpha"):
        return LINKS[self.kind].open(
            self.front, WIRE, sysid, name=name, on_event=self.events.append, tlog=self.tlog
        )

    def _to_vehicles(self, data: bytes, address: Any) -> None:
        self.to_vehicles.append((data, address))
        for copter in self.copters.values():
            if not self.silent and self.address[copter.sysid] == address:
                self._from(copter, copter.receive(data, self.now_s()))

    def _from(self, copter: Copter, frames: list[bytes]) -> None:
        for frame in frames:
            if not self.silent:
                self.wire.from_vehicle(frame, self.address[copter.sysid])

    def _step(self) -> None:
        for copter in self.copters.values():
            self._from(copter, copter.step(self.now_s()))


class FleetWorld(MemoryWorld):
    """Simulated vehicles; each boot sends from a new port, as ArduPilot's UDP does."""

    def __init__(self, *personalities: str, signing: Signing | None = None) -> None:
        super().__init__(signing=signing)
        vehicles = [
            {"sysid": n, "lat_deg": 46.048 + 0.001 * n, "lon_deg": 14.506, "personality": personality}
            for n, personality in enumerate(personalities, 1)
        ]
        self.fleet = Fleet(Scenario.model_validate({"seed": 1, "vehicles": vehicles}), ready_s=3.0)
        self.from_vehicles: list[bytes] = []

    def port(self, index: int) -> tuple[str, int]:
        return f"vehicle {index + 1}", 14_000 + self.fleet.boots()[index]

    def link(self, sysid: int = 1) -> DirectLink:
        return DirectLink(self.front, WIRE, sysid, name=f"uav{sysid}", on_event=self.events.append)

    def _to_vehicles(self, data: bytes, address: Any) -> None:
        self.to_vehicles.append((data, address))
        targets = [i for i in range(len(self.fleet.vehicles)) if self.port(i) == address]
        self._from(self.fleet.receive(data, self.now_s(), peer=address, reach=targets))

    def _from(self, frames: Iterable[tuple[int, bytes]]) -> None:
        for index, data in frames:
            self.from_vehicles.append(data)
            if not self.silent:
                self.wire.from_vehicle(data, self.port(index))

    def _step(self) -> None:
        self._from(self.fleet.step(self.now_s()))


async def until(condition, limit_s: float = 60.0) -> None:
    async with asyncio.timeout(limit_s):
        while not condition():  # noqa: ASYNC110 - not every condition has an event
            await asyncio.sleep(0.02)


async def connected(world: World | FleetWorld):
    link = world.link()
    await link.connect(10)
    return link


async def uploaded(world: World | FleetWorld, count: int = 8):
    """Return a link to a vehicle with a mission of `count` waypoints, ready for its launch."""
    link = await connected(world)
    await link.prepare(60, lambda _: None)
    await link.upload(north_of_home(count))
    return link


async def flying(world: World | FleetWorld):
    link = await uploaded(world)
    await link.launch()
    await until(lambda: link.state().mission_seq == 3)
    return link


def asked_of(world: World) -> set[tuple[str, float]]:
    """Return (message, first parameter) of all messages to the vehicles, without heartbeats."""
    parser = mavlink.MAVLink(None)
    parser.robust_parsing = True
    messages = [m for data, _ in world.to_vehicles for m in parser.parse_buffer(data) or []]
    return {(m.get_type(), getattr(m, "param1", 0.0)) for m in messages if m.get_type() != "HEARTBEAT"}
