"""The composition root: a `Scenario` becomes resources, the resources one task tree, the tree one flight."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.separation.conflicts import CrossingCounts
from swarmctl.bus import external_observations
from swarmctl.bus.network import Network, RunClock
from swarmctl.bus.node import counters as bus_tally
from swarmctl.bus.operator_service import CommandCounts, CommandSeal, NO_SEAL
from swarmctl.bus.transports.base import BusError, Transport
from swarmctl.config.scenario import Scenario
from swarmctl.core.events import FlightOrder
from swarmctl.core.frames import FrameCodec
from swarmctl.flight import emergency, evidence_log, simulator
from swarmctl.flight.director import Director, Launch, Permission, PreflightFailed
from swarmctl.flight.live_table import show
from swarmctl.flight.member import Member
from swarmctl.flight.network import network_of, speedup_of
from swarmctl.flight.operator_orders import order_desk
from swarmctl.flight.return_queue import ReturnQueue
from swarmctl.flight.runner import Observer
from swarmctl.flight.task_tree import run_tasks
from swarmctl.flight.virtual_simulator import AddressOf, undisturbed
from swarmctl.flight.wiring import Clock, FlightResources, epoch_ns, build_members, open_resources, with_free_port
from swarmctl.links.base import LinkError
from swarmctl.preflight.conversation import CheckResult, Preflight, summary_of
from swarmctl.preflight.waivers import Waiver
from swarmctl.report.evidence.book import Signer
from swarmctl.report.evidence.hooks import Evidence
from swarmctl.report.final_state import describe_final_state
from swarmctl.report.outcome import Ending, Report
from swarmctl.report.record import Recorder
from swarmctl.report.summary import FlightStatistics, summary
from swarmctl.report.ui import UiObserver, SafeUi, Ui

EXPECTED = (PreflightFailed, simulator.SimulatorFailed, LinkError, BusError)


@dataclass(frozen=True, slots=True)
class FlightOptions:
    """How a process flies the vehicles it has."""

    launch: Launch = "when-ready"
    desk_of: int | None = None
    """the vehicle whose operator's desk it keeps; None: the station's, for all vehicles"""
    orders_closed: Callable[[Sequence[Member]], str] | None = None
    """why operators' orders are not taken now; empty if they are. None: one process flies all, and takes
    those of its own machine"""
    unseal: CommandSeal = NO_SEAL
    """opens operators' commands"""
    seal: FrameCodec | None = None
    """signs what its UAVs say, and opens what others say; None: nobody signs"""
    signer: Signer | None = None
    """signs the evidence when the run ends; None: nobody does"""
    waivers: tuple[Waiver, ...] = ()
    """preflight checks that an operator lets fail"""


DEFAULT_OPTIONS = FlightOptions()


async def fly(
    scenario: Scenario,
    folder: Path,
    ui: Ui,
    *,
    clock: Clock,
    permission: Permission,
    address_of: AddressOf = undisturbed,
    bus: Transport | None = None,
    options: FlightOptions = DEFAULT_OPTIONS,
) -> Report:
    """Fly the scenario; leaves `run.mcap` and the tlogs in `folder`. The rest is for `outputs` to write.

    `bus` is one that is open already; else the configuration's, or one in memory on a virtual clock.
    """
    if clock == "real":
        scenario = with_free_port(scenario)
    run = _Run(scenario, folder, clock, options, SafeUi(ui))
    recorder = Recorder(folder / "run.mcap", scenario.config, run.names, epoch_ns(clock))
    evidence = evidence_log.begin(scenario, folder, clock, run.ui.say)
    try:
        async with (
            contextlib.AsyncExitStack() as opened,
            open_resources(scenario, folder, clock, address_of, bus, run.ui.say, evidence) as resources,
        ):
            observers = (recorder, run.statistics, UiObserver(run.ui, run.names), evidence)
            network = opened.enter_context(contextlib.closing(_network(run, resources, observers)))
            _gather(run, resources, network, observers)
            director = _director(run, _recorded(permission, evidence), evidence, network)
            await _conducted(run, director, network, resources)
    except Exception as error:  # noqa: BLE001 - whatever it was, the vehicles are accounted for
        run.failed(error)
    finally:
        recorder.close()
        evidence.close(options.signer)
    run.trouble += [text for text in (recorder.trouble, evidence.trouble) if text]
    return run.report()


@dataclass(slots=True)
class _Run:
    """One flight from its resources to its report."""

    scenario: Scenario
    folder: Path
    clock: Clock
    options: FlightOptions
    ui: SafeUi
    run_clock: RunClock = field(init=False)
    began_s: float = field(default_factory=time.monotonic)
    statistics: FlightStatistics = field(default_factory=FlightStatistics)
    members: list[Member] = field(default_factory=list)
    ended: Ending = "failed"
    trouble: list[str] = field(default_factory=list)
    failures: list[BaseException] = field(default_factory=list)
    bug: Exception | None = None
    commands: CommandCounts = field(default_factory=CommandCounts)
    tallies: dict[int, bus_tally.NetworkCounters] = field(default_factory=dict)
    reports: dict[int, external_observations.ReportCounts] = field(default_factory=dict)
    checked: dict[str, tuple[CheckResult, ...]] = field(default_factory=dict)
    crossings: deque[CrossingCounts] = field(default_factory=partial(deque, maxlen=1))

    def __post_init__(self) -> None:
        self.run_clock = RunClock(epoch_ns(self.clock) / 1e9, speedup_of(self.scenario, self.clock))

    @property
    def names(self) -> dict[int, str]:
        """By system id."""
        return {task.uav: task.name for task in self.scenario.tasks}

    def failed(self, error: Exception) -> None:
        self.failures += _leaves(error)
        for leaf in self.failures:
            if isinstance(leaf, EXPECTED):
                self.trouble += str(leaf).splitlines()
            else:
                self.bug = error

    def report(self) -> Report:
        states = {m.spec.sysid: m.state for m in self.members}
        gone = any(isinstance(leaf, simulator.SimulatorFailed) for leaf in self.failures)
        left = tuple(
            f"{m.name}: gone with the simulator" if gone and m.spec.simulated else describe_final_state(m)
            for m in self.members
        )
        content = self._summary(states) if states else {}
        return Report(
            self.ended, tuple(self.trouble), left, states, self.statistics, content, self.bug, self.checked
        )

    def _summary(self, states: dict[int, AgentState]) -> dict[str, Any]:
        content = summary(
            self.scenario,
            states,
            self.statistics,
            clock=self.clock,
            wall_s=time.monotonic() - self.began_s if self.clock == "real" else None,
            commands=asdict(self.commands),
            networks=self.tallies,
            looks={uav: asdict(tally) for uav, tally in self.reports.items()},
            crossings=self.crossings[-1] if self.crossings else None,
        )
        return content | {"preflight": summary_of(self.checked)}


def _network(run: _Run, resources: FlightResources, observers: Sequence[Observer]) -> Network:
    refused = partial(_refused, observers)
    return network_of(run.scenario, resources.transport, run.run_clock, run.options.seal, refused)


def _gather(run: _Run, resources: FlightResources, network: Network, observers: tuple[Observer, ...]) -> None:
    """The members of the flight, and the desk at which they are ordered."""
    desk = order_desk(
        run.scenario,
        resources.transport,
        run.ui,
        run.commands,
        run.members,
        uav=run.options.desk_of,
        closed_by=run.options.orders_closed,
        unseal=run.options.unseal,
    )
    # All of them or none: what has no link cannot be summed up.
    run.members += list(
        build_members(
            run.scenario,
            run.folder,
            resources,
            network,
            desk,
            observers,
            run.clock,
            run.run_clock,
            run.ui.say,
            run.reports,
        )
    )
    run.tallies |= network.all_counters()


def _director(run: _Run, permission: Permission, evidence: Evidence, network: Network) -> Director:
    clearance = Preflight(
        run.scenario,
        run.checked,
        run.options.waivers,
        unix_s_at_zero=run.run_clock.unix_s_at_zero,
        speedup=run.run_clock.speedup,
        free_clocks=run.clock == "real",
        say=run.ui.say,
        on_waived=partial(_waived, evidence),
        sets_parameters=run.options.launch != "never",
        crossings=run.crossings,
    )
    return Director(
        run.members,
        run.scenario.config.flight,
        seconds_per_delay=1.0 / run.run_clock.speedup,
        say=run.ui.say,
        permission=permission,
        clearance=clearance,
        launch=run.options.launch,
        elsewhere=_elsewhere(run, network),
    )


def _elsewhere(run: _Run, network: Network) -> ReturnQueue | None:
    """Where this process flies one vehicle of a swarm: it knows of the others what they tell."""
    uav = run.options.desk_of
    return None if uav is None else ReturnQueue(uav, partial(network.states, uav))


async def _conducted(run: _Run, director: Director, network: Network, resources: FlightResources) -> None:
    """The flight, and what becomes of vehicles when it breaks or is left at once."""
    flight, say = run.scenario.config.flight, run.ui.say
    order = FlightOrder(flight.on_exit)
    shown = partial(show, run.members, run.statistics, run.ui, run.scenario, director, network)
    try:
        run.ended = await run_tasks(director, run.members, resources.simulator_task, run.ui, shown, resources.evidence)
    except Exception:
        await emergency.in_turns(
            "the flight is broken",
            _reachable(run.members, resources.simulator_task),
            order,
            say,
            within_s=flight.on_exit_deadline_s,
            speedup=run.run_clock.speedup,
        )
        raise
    if run.ended == "abandoned":
        await emergency.at_once("not waited for", _reachable(run.members, resources.simulator_task), order, say)


def _recorded(permission: Permission, evidence: Evidence) -> Permission:
    """The permission, which an operator has given, and evidence of it."""

    def permit(foreign: Sequence[Member]) -> None:
        permission(foreign)
        for member in foreign:
            firmware = member.identity.firmware if member.identity is not None else None
            evidence.operator("permits arming", member.name, firmware=firmware, url=member.spec.url)

    return permit


def _waived(evidence: Evidence, checked: CheckResult) -> None:
    evidence.waived(checked.vehicle, checked.check, f"found {checked.finding.found}")


def _refused(observers: Sequence[Observer], uav: int, text: str) -> None:
    """What a vehicle's network would not take, and who tells what it saw otherwise."""
    now = asyncio.get_running_loop().time()
    for observer in observers:
        observer.noted(uav, text, now, to_operator=False)


def _reachable(members: Sequence[Member], simulator_task: asyncio.Task[None] | None) -> list[Member]:
    """Those that have not gone with the simulator."""
    return [m for m in members if not (m.spec.simulated and simulator_task is not None and simulator_task.done())]


def _leaves(error: BaseException) -> Iterator[BaseException]:
    if isinstance(error, BaseExceptionGroup):
        for part in error.exceptions:
            yield from _leaves(part)
    else:
        yield error
