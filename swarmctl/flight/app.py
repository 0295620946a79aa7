"""The composition root of a flight: resources, members and one task tree, built from a `Scenario`."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from swarmctl.agent.state import ARRIVED, AgentState
from swarmctl.agent.traffic.separation.conflicts import CrossingCounts
from swarmctl.bus import external_observations
from swarmctl.bus.authentication import NO_AUTHENTICATION, Authentication
from swarmctl.bus.network import Network, RunClock
from swarmctl.bus.node.exchange import NetworkCounters
from swarmctl.bus.operator_service import CommandCounts
from swarmctl.bus.transports.base import BusError, Transport
from swarmctl.config.scenario import Scenario
from swarmctl.core.events import FlightOrder
from swarmctl.core.frames import FrameCodec
from swarmctl.flight import emergency, simulator
from swarmctl.flight.director import Director, Launch
from swarmctl.flight.member import Member
from swarmctl.flight.network import network_of, speedup_of
from swarmctl.flight.operator_orders import operator_service_for
from swarmctl.flight.permission import Permission, PreflightFailed
from swarmctl.flight.return_queue import ReturnQueue
from swarmctl.flight.runner import Observer
from swarmctl.flight.simulator import AddressOf, undisturbed
from swarmctl.flight.takeover import Takeover
from swarmctl.flight.task_tree import run_tasks, show
from swarmctl.flight.wiring import (
    Clock,
    FlightResources,
    begin_evidence,
    build_members,
    epoch_ns,
    open_resources,
    with_free_port,
)
from swarmctl.links.base import LinkError
from swarmctl.preflight.conversation import Preflight
from swarmctl.preflight.results import CheckResult, summary_of
from swarmctl.preflight.waivers import Waiver
from swarmctl.report.evidence.log import Evidence, Signer
from swarmctl.report.final_state import describe_final_state
from swarmctl.report.outcome import Ending, FlightReport
from swarmctl.report.record import Recorder
from swarmctl.report.summary import FlightStatistics, summary
from swarmctl.report.ui import SafeUi, Ui, UiObserver
from swarmctl.report.unfinished_run import RecordedVehicle, UnfinishedRun
from swarmctl.security.files import KeyringError

EXPECTED_ERRORS = (PreflightFailed, simulator.SimulatorFailed, LinkError, BusError, KeyringError)


@dataclass(frozen=True, slots=True)
class FlightOptions:
    """Options of a process that flies vehicles."""

    launch: Launch = "when-ready"
    operator_service_of: int | None = None
    """the vehicle that this process flies for a swarm of several processes; None: this process flies all"""
    order_refusal: Callable[[Sequence[Member]], str] | None = None
    """function that returns the reason why operators' orders are refused now, or an empty text; None:
    `operator_orders.unsigned_order_refusal` decides"""
    authentication: Authentication = NO_AUTHENTICATION
    """check of operators' commands on an open bus; a bus that the flight opens has a token of its own"""
    report_authentication: Authentication = NO_AUTHENTICATION
    """check of payloads' reports on an open bus; links with certificates need none"""
    frame_codec: FrameCodec | None = None
    """codec that signs and verifies the messages between vehicles; None: messages are unsigned"""
    signer: Signer | None = None
    """signer of the evidence at the end of the run; None: the evidence stays unsigned"""
    waivers: tuple[Waiver, ...] = ()
    """preflight checks that an operator lets fail"""
    resumes: UnfinishedRun | None = None
    """run whose program died in flight, which this run continues; None: a new flight"""


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
) -> FlightReport:
    """Fly the scenario, record the flight in `folder`, and return the report.

    `bus` is an open transport; None opens the configured transport, or a bus in memory on a virtual clock.
    """
    if clock == "real":
        scenario = with_free_port(scenario)
    run, resumes = _Run(scenario, folder, clock, options, SafeUi(ui)), options.resumes
    earlier = None if resumes is None else resumes.stored
    # The record last: a run with a record can be continued, and that needs the evidence too.
    evidence = begin_evidence(scenario, folder, clock, run.ui.say, resumes)
    recorder = Recorder(folder / "run.mcap", scenario, epoch_ns(clock), earlier)
    if resumes is not None:
        resumes.note_continuation(folder.name)
    try:
        async with (
            contextlib.AsyncExitStack() as opened,
            open_resources(
                scenario, folder, clock, address_of, bus, run.ui.say, evidence, run.is_behind
            ) as resources,
        ):
            observers = (recorder, run.statistics, UiObserver(run.ui, run.names), evidence)
            network = opened.enter_context(contextlib.closing(_network(run, resources, observers)))
            _build_members(run, resources, network, observers)
            director = _director(run, _recording_permission(permission, evidence), evidence, network)
            await _run_flight(run, director, network, resources)
    except Exception as error:  # noqa: BLE001 - the report accounts for the vehicles after any error
        run.note_error(error)
    finally:
        recorder.close()
        evidence.close(options.signer)
    run.trouble += [text for text in (recorder.trouble, evidence.trouble) if text]
    return run.report()


@dataclass(slots=True)
class _Run:
    """The state of one flight, from its resources to its report."""

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
    network_counters: dict[int, NetworkCounters] = field(default_factory=dict)
    reports: dict[int, external_observations.ReportCounts] = field(default_factory=dict)
    checked: dict[str, tuple[CheckResult, ...]] = field(default_factory=dict)
    crossings: deque[CrossingCounts] = field(default_factory=partial(deque, maxlen=1))

    def __post_init__(self) -> None:
        self.run_clock = RunClock(epoch_ns(self.clock) / 1e9, speedup_of(self.scenario, self.clock))
        if self.options.resumes is not None:
            self.statistics = self.options.resumes.statistics

    @property
    def recorded(self) -> Mapping[int, RecordedVehicle]:
        """The vehicles of the continued run by system id; empty for a new flight."""
        return {} if self.options.resumes is None else self.options.resumes.vehicles

    @property
    def names(self) -> dict[int, str]:
        """The vehicles' names by system id."""
        return {task.uav: task.name for task in self.scenario.tasks}

    def is_behind(self) -> bool:
        """Return whether an agent has unprocessed events."""
        return any(member.runner.is_behind for member in self.members)

    def note_error(self, error: Exception) -> None:
        self.failures += _single_errors(error)
        for failure in self.failures:
            if isinstance(failure, EXPECTED_ERRORS):
                self.trouble += str(failure).splitlines()
            else:
                self.bug = error

    def report(self) -> FlightReport:
        states = {m.spec.sysid: m.state for m in self.members}
        simulator_failed = any(isinstance(error, simulator.SimulatorFailed) for error in self.failures)
        final_states = tuple(
            f"{m.name}: ended with the simulator [simulator-ended]"
            if simulator_failed and m.spec.simulated
            else describe_final_state(m)
            for m in self.members
            if m.state.outcome != ARRIVED
        )
        content = self._summary(states) if states else {}
        trouble = tuple(self.trouble)
        return FlightReport(
            self.ended, trouble, final_states, states, self.statistics, content, self.bug, self.checked
        )

    def _summary(self, states: dict[int, AgentState]) -> dict[str, Any]:
        content = summary(
            self.scenario,
            states,
            self.statistics,
            clock=self.clock,
            wall_s=time.monotonic() - self.began_s if self.clock == "real" else None,
            commands=asdict(self.commands),
            networks=self.network_counters,
            payload_reports={uav: asdict(counts) for uav, counts in self.reports.items()},
            crossings=self.crossings[-1] if self.crossings else None,
        )
        resumes = self.options.resumes
        continued = None if resumes is None else resumes.folder.name
        return content | {"preflight": summary_of(self.checked), "continues": continued}


def _network(run: _Run, resources: FlightResources, observers: Sequence[Observer]) -> Network:
    refused = partial(_note_refusal, observers)
    return network_of(run.scenario, resources.transport, run.run_clock, run.options.frame_codec, refused)


def _build_members(
    run: _Run, resources: FlightResources, network: Network, observers: tuple[Observer, ...]
) -> None:
    operator_service = operator_service_for(
        run.scenario,
        resources.transport,
        run.ui,
        run.commands,
        run.members,
        uav=run.options.operator_service_of,
        order_refusal=run.options.order_refusal,
        authentication=resources.token_authentication or run.options.authentication,
    )
    # The summary needs the links of all members, so after an error `members` has all members or none.
    run.members += list(
        build_members(
            run.scenario,
            run.folder,
            resources,
            network,
            operator_service,
            observers,
            run.clock,
            run.run_clock,
            run.ui.say,
            run.reports,
            resources.token_authentication or run.options.report_authentication,
            run.recorded,
        )
    )
    for uav, vehicle in run.recorded.items():
        network.restore(uav, vehicle.observations)
    run.network_counters |= network.all_counters()


def _director(run: _Run, permission: Permission, evidence: Evidence, network: Network) -> Director:
    clearance = Preflight(
        run.scenario,
        run.checked,
        run.options.waivers,
        unix_s_at_zero=run.run_clock.unix_s_at_zero,
        speedup=run.run_clock.speedup,
        free_clocks=run.clock == "real",
        say=run.ui.say,
        on_waived=partial(_record_waiver, evidence),
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
        return_queue=_return_queue(run, network),
        takeover=_takeover(run),
    )


def _takeover(run: _Run) -> Takeover | None:
    if run.options.resumes is None:
        return None
    clock = run.run_clock
    return Takeover(
        run.recorded, run.scenario.config.flight, unix_s=clock.unix_s, speedup=clock.speedup, say=run.ui.say
    )


def _return_queue(run: _Run, network: Network) -> ReturnQueue | None:
    """Return the queue for one vehicle of a swarm of several processes; None if this process flies all."""
    uav = run.options.operator_service_of
    return None if uav is None else ReturnQueue(uav, partial(network.states, uav))


async def _run_flight(run: _Run, director: Director, network: Network, resources: FlightResources) -> None:
    """Run the task tree. After a failure or an abandoned flight, armed vehicles get the order `on_exit`."""
    flight, say = run.scenario.config.flight, run.ui.say
    order = FlightOrder(flight.on_exit)
    show_states = partial(show, run.members, run.statistics, run.ui, run.scenario, director, network)
    try:
        run.ended = await run_tasks(
            director, run.members, resources.simulator_task, run.ui, show_states, resources.evidence
        )
    except Exception:
        await emergency.in_turns(
            "the flight has failed",
            _reachable(run.members, resources.simulator_task),
            order,
            say,
            within_s=flight.on_exit_deadline_s,
            speedup=run.run_clock.speedup,
        )
        raise
    if run.ended == "abandoned":
        reachable = _reachable(run.members, resources.simulator_task)
        await emergency.at_once("the operator ends the program at once", reachable, order, say)


def _recording_permission(permission: Permission, evidence: Evidence) -> Permission:
    """Return a permission that also records the operator's answer as evidence."""

    def permit(external: Sequence[Member]) -> None:
        permission(external)
        for member in external:
            firmware = member.identity.firmware if member.identity is not None else None
            evidence.operator("permits arming", member.name, firmware=firmware, url=member.spec.url)

    return permit


def _record_waiver(evidence: Evidence, checked: CheckResult) -> None:
    evidence.waived(checked.vehicle, checked.check, f"found {checked.finding.found}")


def _note_refusal(observers: Sequence[Observer], uav: int, text: str) -> None:
    """Note a message that vehicle `uav` refused, or a report that contradicts its own observations."""
    now = asyncio.get_running_loop().time()
    for observer in observers:
        observer.noted(uav, text, now, to_operator=False)


def _reachable(members: Sequence[Member], simulator_task: asyncio.Task[None] | None) -> list[Member]:
    """Return the members, without simulated vehicles if the simulator has ended."""
    return [
        m for m in members if not (m.spec.simulated and simulator_task is not None and simulator_task.done())
    ]


def _single_errors(error: BaseException) -> Iterator[BaseException]:
    if isinstance(error, BaseExceptionGroup):
        for part in error.exceptions:
            yield from _single_errors(part)
    else:
        yield error
