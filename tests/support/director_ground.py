"""A swarm of stub links with its director."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from flights import small

from swarmctl.bus.network import Network, RunClock
from swarmctl.bus.transports.memory import MemoryBus
from swarmctl.config.scenario import Scenario
from swarmctl.core.events import FlightOrder
from swarmctl.core.inference.sensor import PERFECT
from swarmctl.core.mission import FlightPlan, MissionItem
from swarmctl.core.records import replace
from swarmctl.core.vehicle import VehicleState
from swarmctl.flight.director import Director, LaunchMode
from swarmctl.flight.network import network_of
from swarmctl.flight.own_vehicle import OwnVehicle
from swarmctl.flight.permission import PreflightFailed
from swarmctl.flight.runner import Runner
from swarmctl.flight.virtual_clock import run_virtual
from swarmctl.links.base import (
    CommandFailed,
    LaunchFailed,
    NoAnswer,
    NotReady,
    UploadFailed,
)
from swarmctl.mavlink.events import Identity
from swarmctl.mavlink.protocol.outcome import LaunchBlocked, Swapped
from swarmctl.sensors.footprint import Footprint

MARK = b"sim_vehicle\0"
WAITING_FOR = "no position estimate yet"


@dataclass
class StubLink:
    """A link that carries out every call and keeps their names, and the cancelled ones."""

    identity: Identity = field(default_factory=lambda: Identity(1, 3, 2, "", MARK))
    where: tuple[float, float] = (46.0, 14.0)
    fails: Exception | None = None
    takes_s: float = 0.0
    """duration of each call"""
    ends_s: float = 0.0
    """time from the cancellation of a call to its end"""
    calls: list[str] = field(default_factory=list)
    answers: Identity | None = None
    """identity of a different vehicle that answers later"""
    age: float = 0.0
    prepares_s: float = 0.0

    async def _do(self, name: str, *failures: type[Exception]) -> None:
        self.calls.append(name)
        try:
            await asyncio.sleep(self.takes_s)
        except asyncio.CancelledError:
            await asyncio.sleep(self.ends_s)
            self.calls.append(f"{name} cancelled")
            raise
        if isinstance(self.fails, failures):
            raise self.fails

    async def connect(self, timeout_s: float) -> Identity:
        await self._do("connect", NoAnswer)
        return self.identity

    async def identify(self, timeout_s: float) -> Identity:
        await self._do("identify")
        return self.answers or self.identity

    async def prepare(self, timeout_s: float, on_waiting: Callable[[tuple[str, ...]], None]) -> None:
        ready_s = asyncio.get_running_loop().time() + self.prepares_s
        while (remaining_s := ready_s - asyncio.get_running_loop().time()) > 0.0:
            on_waiting((WAITING_FOR,))
            await asyncio.sleep(min(remaining_s, 1.0))
        await self._do("prepare", NotReady)

    async def upload(self, plan: FlightPlan) -> float:
        await self._do("upload", UploadFailed)
        return 0.0

    async def launch(self, in_the_way: Callable[[], str] = lambda: "") -> LaunchBlocked | None:
        if why := in_the_way():
            return LaunchBlocked(why)
        await self._do("launch", LaunchFailed)
        return None

    async def swap(self, plan: FlightPlan) -> Swapped:
        await self._do("swap")
        return Swapped(None, "new", 0.0, 0.5)

    async def follow_setpoints(self) -> None:
        await self._do("follow_setpoints", CommandFailed)

    async def order(self, order: FlightOrder, *, check_mode_first: bool) -> None:
        await self._do(order, CommandFailed)

    def state(self) -> VehicleState:
        return VehicleState(lat_deg=self.where[0], lon_deg=self.where[1], alt_rel_m=0.0, alt_amsl_m=300.0)

    def age_s(self) -> float:
        return self.age

    def items(self) -> tuple[MissionItem, ...]:
        return ()

    def close(self) -> None: ...


@dataclass
class Clearance:
    """Preflight checks that pass, unless `verdicts` holds the failures of the next calls."""

    verdicts: list[list[str]] = field(default_factory=list)
    calls: list[tuple[str, ...]] = field(default_factory=list)
    lasts_s: float = 0.0
    early: dict[str, list[str]] = field(default_factory=dict)
    """failures found early, by vehicle name"""

    async def set_up(self, subject: OwnVehicle) -> None:
        self.calls.append(("set up", subject.name))

    async def failures(self, subjects: Sequence[OwnVehicle], everyone: Sequence[OwnVehicle]) -> list[str]:
        self.calls.append(("check", *(s.name for s in subjects)))
        await asyncio.sleep(self.lasts_s)
        return self.verdicts.pop(0) if self.verdicts else []

    async def early_failures(self, subject: OwnVehicle, everyone: Sequence[OwnVehicle]) -> list[str]:
        self.calls.append(("check early", subject.name))
        return self.early.get(subject.name, [])


@dataclass
class Ground:
    """A swarm of stub links with its director."""

    scenario: Scenario = field(default_factory=small)
    identities: dict[int, bytes] = field(default_factory=dict)
    fails: dict[int, Exception] = field(default_factory=dict)
    moved: dict[int, tuple[float, float]] = field(default_factory=dict)
    simulated: bool = True
    allowed: bool = True
    launch: LaunchMode = "when-ready"
    clearance: Clearance = field(default_factory=Clearance)
    links: list[StubLink] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)
    prepares_s: dict[int, float] = field(default_factory=dict)
    said: list[tuple[float, str]] = field(default_factory=list)
    """time on the virtual clock [s], and text"""

    def fly(self, until: Callable[[Sequence[OwnVehicle]], bool]) -> None:
        run_virtual(self._fly(until))

    async def _fly(self, until: Callable[[Sequence[OwnVehicle]], bool]) -> None:
        network = network_of(self.scenario, MemoryBus(), RunClock(0.0))
        vehicles = [self._vehicle(index, network) for index in range(len(self.scenario.specs))]
        director = Director(
            vehicles,
            self.scenario.config.flight,
            seconds_per_delay=1.0,
            say=lambda text: self.said.append((asyncio.get_running_loop().time(), text)),
            permission=self._permit,
            clearance=self.clearance,
            launch=self.launch,
        )
        runs = [asyncio.create_task(m.runner.run()) for m in vehicles]
        flight = asyncio.create_task(director.fly())
        try:
            async with asyncio.timeout(100.0):
                while not (flight.done() or until(vehicles)):  # noqa: ASYNC110
                    await asyncio.sleep(0.1)
            if flight.done():
                flight.result()
        finally:
            for task in (flight, *runs):
                task.cancel()
            await asyncio.gather(flight, *runs, return_exceptions=True)

    def _vehicle(self, index: int, network: Network) -> OwnVehicle:
        spec = replace(self.scenario.specs[index], simulated=self.simulated)
        uid2 = self.identities.get(spec.sysid, MARK)
        link = StubLink(
            Identity(spec.sysid, 3, 2, "ArduPilot 4.6.2", uid2.ljust(18, b"\0")),
            self.moved.get(spec.sysid, spec.start),
            self.fails.get(spec.sysid),
            prepares_s=self.prepares_s.get(spec.sysid, 0.0),
        )
        self.links.append(link)
        return OwnVehicle(spec, runner_of(self.scenario, link, index, network=network))

    def _permit(self, foreign: Sequence[OwnVehicle]) -> None:
        self.asked += [m.name for m in foreign]
        if not self.allowed:
            raise PreflightFailed(["not allowed"])


def runner_of(
    scenario: Scenario, link: Any, index: int = 0, *observers: Any, network: Network | None = None
) -> Runner:
    """Return the runner of a vehicle with this link."""
    sensor = Footprint(scenario.grid, scenario.hostiles, PERFECT, np.random.default_rng(0))
    network = network or network_of(scenario, MemoryBus(), RunClock(0.0))
    return Runner(scenario.tasks[index], scenario.prior, lambda _: link, sensor, network, observers)


def all_launched(vehicles: Sequence[OwnVehicle]) -> bool:
    return all(m.state.phase == "flying" for m in vehicles)
