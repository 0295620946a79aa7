"""Copters on a memory wire with a link to each: on a virtual clock, or faster than real time."""

from __future__ import annotations

import asyncio
import contextlib

from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scripted_copter import Copter

from swarmctl.core.mission import FlightPlan, Waypoint
from swarmctl.links import LINKS
from swarmctl.links.frontend import FrontEnd
from swarmctl.links.transports.memory import MemoryWire
from swarmctl.links.url import Endpoint

WIRE = Endpoint("memory", "test")
HURRY = 25.0
"""speed-up: seconds of a copter's time in one second of the machine's clock"""


class VirtualLoop(asyncio.SelectorEventLoop):
    """An event loop whose time jumps to the next timer when no task is ready."""

    virtual_s = 0.0

    def time(self) -> float:
        return self.virtual_s

    def _run_once(self) -> None:
        if not self._ready and self._scheduled:
            self.virtual_s = max(self.virtual_s, self._scheduled[0].when())
        super()._run_once()


def play(story, *, real: bool = False) -> None:
    """Run an async story for at most an hour on a virtual clock, or at most a minute of real time."""

    async def bounded():
        async with asyncio.timeout(60 if real else 3600):
            await story

    with asyncio.Runner(loop_factory=None if real else VirtualLoop) as runner:
        runner.run(bounded())


def north(count: int, east: float = 0.0) -> FlightPlan:
    points = tuple(Waypoint(46.049 + 0.001 * i, 14.506 + east, 20.0) for i in range(1, count + 1))
    return FlightPlan(20.0, points, points[-1])


class World:
    """Copters on a memory wire, and a link to each."""

    def __init__(self, *copters: Copter, tlog=None, kind: str = "direct") -> None:
        self.kind = kind
        self.pace = 1.0 if kind == "direct" else HURRY
        self._began_s = 0.0
        self.copters = {c.sysid: c for c in copters}
        self.address = {c.sysid: "fleet" for c in copters}
        self.wire = MemoryWire()
        self.wire.connect_vehicles(self._to_vehicles)
        self.silent = False
        self.to_vehicles: list[tuple[bytes, object]] = []
        self.events: list = []
        self._wall_us = 1_700_000_000_000_000
        self.said: list[str] = []
        self.front = FrontEnd(wall_time_us=self._wall, memory={"test": self.wire}, say=self.said.append)
        self.tlog = tlog

    def _wall(self) -> int:
        self._wall_us += 1000
        return self._wall_us

    def link(self, sysid: int = 1, name: str = "alpha"):
        return LINKS[self.kind].open(
            self.front, WIRE, sysid, name=name, on_event=self.events.append, tlog=self.tlog
        )

    def _to_vehicles(self, data: bytes, address) -> None:
        self.to_vehicles.append((data, address))
        now = self.now_s()
        for copter in self.copters.values():
            if not self.silent and self.address[copter.sysid] == address:
                self._from(copter, copter.receive(data, now))

    def _from(self, copter: Copter, frames: list[bytes]) -> None:
        for frame in frames:
            if not self.silent:
                self.wire.from_vehicle(frame, self.address[copter.sysid])

    def now_s(self) -> float:
        """Time on the copters' clocks [s]."""
        return (asyncio.get_running_loop().time() - self._began_s) * self.pace

    async def _fly(self) -> None:
        while True:
            await asyncio.sleep(0.1 / self.pace)
            for copter in self.copters.values():
                self._from(copter, copter.step(self.now_s()))

    async def __aenter__(self):
        self._began_s = asyncio.get_running_loop().time()
        self._task = asyncio.create_task(self._fly())
        return self

    async def __aexit__(self, *error) -> None:
        self._task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await self._task
        await self.front.close()


async def until(condition, limit_s: float = 60.0) -> None:
    async with asyncio.timeout(limit_s):
        while not condition():  # noqa: ASYNC110 - not every condition has an event
            await asyncio.sleep(0.02)


async def flying(world: World):
    link = world.link()
    await link.connect(10)
    await link.prepare(30, lambda _: None)
    await link.upload(north(8))
    await link.launch()
    await until(lambda: link.state().mission_seq == 3)
    return link


def asked_of(world: World) -> set[tuple[str, float]]:
    """Return (message, first parameter) of all messages to the vehicles, without heartbeats."""
    parser = mavlink.MAVLink(None)
    parser.robust_parsing = True
    messages = [m for data, _ in world.to_vehicles for m in parser.parse_buffer(data) or []]
    return {(m.get_type(), getattr(m, "param1", 0.0)) for m in messages if m.get_type() != "HEARTBEAT"}
