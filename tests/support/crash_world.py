"""Ground stations that die in flight, on the virtual clock: the vehicles fly on, and a new station goes on.

A crash is what SIGKILL leaves: the flying fleet, and the run's files as they are on the disk. The dead
station's loop is stopped, and its fleet is taken away from it.
"""

from __future__ import annotations

import asyncio
import contextlib
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flight_monitor import FlightMonitor, findings
from flights import Ui, virtual_flight
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from random_flights import RandomFlight
from recorded import effects
from trouble import Trouble, Watched

from sim_vehicle.fleet import Fleet
from swarmctl.config.scenario import Scenario
from swarmctl.core.records import replace
from swarmctl.flight import virtual_simulator
from swarmctl.flight.run import DEFAULT_OPTIONS, VIRTUAL_EPOCH_NS, FlightOptions
from swarmctl.flight.virtual_clock import VirtualTimeLoop
from swarmctl.links.transports.memory import MemoryWire
from swarmctl.report import unfinished_run
from swarmctl.report.outcome import FlightReport

STEP_S = virtual_simulator.STEP_S
TRANSFERS = {
    mavlink.MAVLINK_MSG_ID_MISSION_COUNT,
    mavlink.MAVLINK_MSG_ID_MISSION_WRITE_PARTIAL_LIST,
    mavlink.MAVLINK_MSG_ID_MISSION_ITEM_INT,
    mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_LIST,
    mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_INT,
    mavlink.MAVLINK_MSG_ID_MISSION_SET_CURRENT,
    mavlink.MAVLINK_MSG_ID_MISSION_ACK,
    mavlink.MAVLINK_MSG_ID_COMMAND_LONG,
}
Meanwhile = Callable[[Fleet, float], None]


@dataclass
class Sent:
    """Numbers of messages to the vehicles."""

    messages: int = 0
    transfers: int = 0
    """of mission transfers and commands while a vehicle is armed"""


Moment = Callable[[float, Sent], bool]


@dataclass
class Crash:
    """The remains of a station: the flying fleet, and the files of its run."""

    at_s: float
    fleet: Fleet
    folder: Path


@dataclass
class Resumed:
    """The flight after a crash."""

    report: FlightReport
    ui: Ui
    folder: Path
    monitor: FlightMonitor

    def outcomes(self) -> dict[str, str]:
        return {state.task.name: state.outcome for state in self.report.states.values()}

    def broken_rules(self) -> list[str]:
        for state in self.report.states.values():
            # A vehicle whose flight had ended before has no link.
            (self.folder / f"{state.task.name}.tlog").touch()
        return findings(self.monitor, self.report, self.folder)


class Wire:
    """The fleet as one station knows it; a dead station reaches nothing."""

    def __init__(self, fleet: Fleet, on_use: Callable[[float, Sent], None]) -> None:
        self.sysids = fleet.sysids
        self.is_cut = False
        self.fleet = fleet
        self._on_use = on_use
        self._sent = Sent()

    def step(self, now: float) -> Any:
        if self.is_cut:
            return []
        frames = self.fleet.step(now)
        self._on_use(now, self._sent)
        return frames

    def receive(self, data: bytes, now: float, **more: Any) -> Any:
        if self.is_cut:
            return []
        answer = self.fleet.receive(data, now, **more)
        self._sent.messages += 1
        in_flight = any(vehicle.armed for vehicle in self.fleet.vehicles)
        self._sent.transfers += in_flight and int.from_bytes(data[7:10], "little") in TRANSFERS
        self._on_use(now, self._sent)
        return [] if self.is_cut else answer


@contextlib.contextmanager
def crashed(
    scenario: Scenario,
    folder: Path,
    *,
    when: Moment,
    trouble: Trouble | None = None,
    options: FlightOptions = DEFAULT_OPTIONS,
    earlier: Crash | None = None,
) -> Iterator[Crash]:
    """Fly until `when(time, messages to the vehicles)`, before the end of the flight; yield the crash.

    `earlier`: a crash after which this station goes on.
    """
    loop, found, wires = VirtualTimeLoop(), list[Crash](), list[Wire]()
    if earlier is not None:
        loop.advance(earlier.at_s)

    def on_use(now: float, sent: Sent) -> None:
        if found or not when(now, sent):
            return
        copied = folder.with_name(f"{folder.name}-crash")
        shutil.copytree(folder, copied)
        found.append(Crash(now, wires[0].fleet, copied))
        wires[0].is_cut = True
        loop.stop()

    async def simulate(memory: MemoryWire, scenario: Scenario) -> None:
        fleet = (trouble or Trouble()).fleet_of(scenario) if earlier is None else earlier.fleet
        wires.append(Wire(fleet, on_use))
        await virtual_simulator.serve(memory, wires[0])

    folder.mkdir(parents=True)
    flight = loop.create_task(virtual_flight(scenario, folder, options=replace(options, simulate=simulate)))
    flight.add_done_callback(lambda _: loop.stop())
    loop.run_forever()
    try:
        assert found, "the flight ended before its crash"
        yield found[0]
    finally:
        flight.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            loop.run_until_complete(flight)
        loop.run_until_complete(loop.shutdown_asyncgens())
        loop.close()


def resume(
    scenario: Scenario,
    crash: Crash,
    folder: Path,
    *,
    outage_s: float = 5.0,
    meanwhile: Meanwhile = lambda _fleet, _now: None,
    later: tuple[float, Callable[[Fleet], None]] | None = None,
) -> Resumed:
    """Let the vehicles fly on alone, then go on with a new station. `meanwhile` acts amid the outage.

    `later`: an action in the flight of the new station, at this time.
    """
    drift(crash, outage_s, meanwhile)
    monitor = FlightMonitor(RandomFlight(scenario, Trouble()))
    monitor.attend()
    if later is not None:
        monitor.drawn.trouble.actions.append(later)
    loop, ui = VirtualTimeLoop(), Ui()
    loop.advance(crash.at_s)

    async def simulate(wire: MemoryWire, _scenario: Scenario) -> None:
        await virtual_simulator.serve(wire, Watched(crash.fleet, monitor.drawn.trouble))

    folder.mkdir(parents=True)
    run = unfinished(scenario, crash)
    options = replace(DEFAULT_OPTIONS, resumes=run, simulate=simulate)
    with run.file, asyncio.Runner(loop_factory=lambda: loop) as runner:
        report = runner.run(virtual_flight(scenario, folder, ui, options=options))
    if report.bug is not None:
        raise report.bug
    return Resumed(report, ui, folder, monitor)


def unfinished(scenario: Scenario, crash: Crash) -> unfinished_run.UnfinishedRun:
    return unfinished_run.load(crash.folder, lambda _config: scenario, VIRTUAL_EPOCH_NS)[1]


def drift(crash: Crash, outage_s: float, meanwhile: Meanwhile = lambda _fleet, _now: None) -> None:
    """Let the vehicles fly on without a station."""
    n_steps = round(outage_s / STEP_S)
    for k in range(1, n_steps + 1):
        crash.at_s += STEP_S
        crash.fleet.step(crash.at_s)
        if k == (n_steps + 1) // 2:
            meanwhile(crash.fleet, crash.at_s)


def lost_observations(resumed: Resumed) -> list[str]:
    """Return the recorded observations that no agent knows at the end."""
    held: dict[tuple[int, int], int] = {}
    for state in resumed.report.states.values():
        for item in state.belief.items():
            number = getattr(item, "upto", None) or item.seq
            held[item.source] = max(held.get(item.source, 0), number)
    published = [entry["effect"]["message"] for entry in effects(resumed.folder, "Publish")]
    names = [(o["observer"], o["incarnation"], o["seq"]) for o in published if "seq" in o]
    return [str(name) for name in names if held.get(name[:2], 0) < name[2]]
