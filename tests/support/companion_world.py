"""Companions, one agent each, on the virtual clock."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from pathlib import Path

from flights import Ui, small

from swarmctl.agent.phases import Phase
from swarmctl.bus.endpoint import BusEndpoint
from swarmctl.bus.transports.memory import MemoryBus
from swarmctl.config.scenario import Scenario
from swarmctl.core.messages import (
    Request,
)
from swarmctl.flight import companion
from swarmctl.flight.director import LaunchMode
from swarmctl.report.outcome import FlightReport
from swarmctl.report.unfinished_run import UnfinishedRun
from swarmctl.station import client, commands
from swarmctl.station.commands import Answers

NAMES = {1: "uav1", 2: "uav2", 3: "uav3"}


STATION = client.FlightEndpoints("small", BusEndpoint("127.0.0.1", 7447), agents=NAMES)


@dataclass
class Swarm:
    """Companions over one bus, each with a user interface of its own."""

    folder: Path
    scenario: Scenario = field(default_factory=small)
    bus: MemoryBus = field(default_factory=MemoryBus)
    uis: dict[int, Ui] = field(default_factory=dict)
    flights: dict[int, asyncio.Task[FlightReport]] = field(default_factory=dict)

    def start(
        self,
        uav: int,
        launch: LaunchMode = "ordered",
        *,
        name: str = "",
        resumes: UnfinishedRun | None = None,
    ) -> None:
        """Start the agent of a vehicle; its run folder is `name`, or else named like the vehicle."""
        folder = self.folder / (name or f"uav{uav}")
        folder.mkdir()
        self.uis[uav] = Ui()
        self.flights[uav] = asyncio.create_task(
            companion.fly(
                companion.scenario_for(self.scenario, uav),
                folder,
                self.uis[uav],
                clock="virtual",
                permission=lambda foreign: None,
                launch=launch,
                bus=self.bus,
                resumes=resumes,
            )
        )

    def phase(self, uav: int) -> Phase:
        (row,) = self.uis[uav].views[-1].rows
        return row.phase

    async def until(self, uav: int, *phases: Phase) -> None:
        async with asyncio.timeout(300.0):
            while not self.uis[uav].views or self.phase(uav) not in phases:  # noqa: ASYNC110
                await asyncio.sleep(0.25)

    async def give(self, command: Request) -> Answers:
        return await commands.ask(self.bus, STATION, command)
