"""An agent that died on its companion, and its successor: the other agents fly on meanwhile."""

from __future__ import annotations

import asyncio
import contextlib
import shutil
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from companion_world import Swarm
from crash_world import STEP_S, Wire
from flights import small

from sim_vehicle.fleet import Fleet
from swarmctl.config.scenario import Scenario
from swarmctl.flight import companion, virtual_simulator
from swarmctl.flight.run import VIRTUAL_EPOCH_NS
from swarmctl.flight.virtual_clock import run_virtual
from swarmctl.links.transports.memory import MemoryWire
from swarmctl.report import unfinished_run
from swarmctl.report.outcome import FlightReport
from swarmctl.report.unfinished_run import UnfinishedRun

UAVS = (1, 2)
DIES_S, RESTARTS_S = 30.0, 45.0


@dataclass
class Companions(Swarm):
    wires: dict[int, Wire] = field(default_factory=dict)
    fleets: dict[int, Fleet] = field(default_factory=dict)

    async def simulate(self, memory: MemoryWire, scenario: Scenario) -> None:
        (spec,) = scenario.specs
        if spec.sysid not in self.fleets:
            self.fleets[spec.sysid] = virtual_simulator.fleet_of(scenario)
        wire = self.wires[spec.sysid] = Wire(self.fleets[spec.sysid], lambda _now, _n: None)
        await virtual_simulator.serve(memory, wire)

    async def fly_on(self, uav: int, until_s: float) -> None:
        """Let a vehicle fly without an agent."""
        loop = asyncio.get_running_loop()
        while loop.time() < until_s:
            await asyncio.sleep(STEP_S)
            self.fleets[uav].step(loop.time())

    async def story(self) -> tuple[UnfinishedRun, dict[int, FlightReport]]:
        for uav in UAVS:
            self.start(uav, "when-ready")
        await asyncio.sleep(DIES_S)
        shutil.copytree(self.folder / "uav1", self.folder / "crash")
        self.wires[1].is_cut = True
        self.flights[1].cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await self.flights[1]
        await self.fly_on(1, RESTARTS_S)
        alone = companion.scenario_for(self.scenario, 1)
        _, run = unfinished_run.load(self.folder / "crash", lambda _config: alone, VIRTUAL_EPOCH_NS)
        with run.file:
            self.start(1, "when-ready", name="uav1-on", resumes=run)
            return run, {uav: await flight for uav, flight in self.flights.items()}


@pytest.mark.full
def test_the_successor_learns_from_the_record_and_from_its_peers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = small(simulate={"count": len(UAVS), "ready_s": 3.0})
    companions = Companions(tmp_path, scenario)
    monkeypatch.setattr(virtual_simulator, "simulate", companions.simulate)
    run, reports = run_virtual(companions.story())
    first, second = (reports[uav].states[uav] for uav in UAVS)
    assert (first.outcome, second.outcome) == ("arrived", "arrived")
    recorded = {(*seen.source, seen.seq) for _, seen in run.vehicles[1].observations}
    assert recorded
    for belief in (first.belief, second.belief):
        sources = {item.source for item in belief.items()}
        # Its own observations of both lives, and those of its peer.
        assert {(uav, incarnation) for uav, incarnation, _ in recorded} <= sources
        assert len({incarnation for uav, incarnation in sources if uav == 1}) == 2
    assert first.belief.n_observed == second.belief.n_observed
    assert first.belief.n_cells_from(2) == second.belief.n_cells_from(2)
