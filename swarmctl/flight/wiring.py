"""The wiring of a flight: its I/O (front end, bus, simulator) and the members built on it."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import time
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

from swarmctl.bus import external_observations
from swarmctl.bus.authentication import Authentication
from swarmctl.bus.network import Network, RunClock
from swarmctl.bus.operator_service import OperatorService
from swarmctl.bus.sensor_reports import MANUAL_SOURCE, ReportedCells
from swarmctl.bus.transports.base import Transport
from swarmctl.bus.transports.memory import MemoryBus
from swarmctl.bus.transports.open import open_bus
from swarmctl.bus.transports.subscriptions import ReportOnce
from swarmctl.config.links import Links
from swarmctl.config.scenario import RandomStream, Scenario
from swarmctl.core import events as ev
from swarmctl.flight import simulator
from swarmctl.flight.member import Member
from swarmctl.flight.runner import Runner
from swarmctl.flight.sensors import SOURCES
from swarmctl.links import LINKS
from swarmctl.links.base import LinkError, Streaming
from swarmctl.links.frontend import FrontEnd
from swarmctl.links.signing import Signing
from swarmctl.links.transports.memory import MemoryWire
from swarmctl.links.url import Endpoint, parse_url
from swarmctl.planners import is_small, warm_up
from swarmctl.report.evidence.chain import Opened, sha256
from swarmctl.report.evidence.log import FILE_NAME, Evidence
from swarmctl.report.unfinished_run import RecordedVehicle, UnfinishedRun
from swarmctl.security.files import KeyringError
from swarmctl.security.mavlink_key import TimestampFile, read_mavlink_key
from swarmctl.security.requests import by_token
from swarmctl.security.token import new_token, token_of_environment

Clock = Literal["real", "virtual"]
VIRTUAL_EPOCH_NS = 1_767_225_600 * 10**9
"""2026-01-01, the wall time of virtual runs at loop time 0 [ns since 1970]: equal runs write equal files"""
OFFLOAD_CELLS = 100_000
"""number of cells above which, in real time, a thread searches the area while the loop serves the links"""


@dataclass(frozen=True, slots=True)
class FlightResources:
    """Open resources that all members of a flight share."""

    front_end: FrontEnd
    transport: Transport
    simulator_task: asyncio.Task[None] | None
    """the task that runs the simulated vehicles; None without simulated vehicles"""
    evidence: Evidence
    token_authentication: Authentication | None
    """check of requests on a bus that this flight has opened; None for a bus that was already open"""


def begin_evidence(
    scenario: Scenario,
    folder: Path,
    clock: Clock,
    say: Callable[[str], None],
    resumes: UnfinishedRun | None = None,
) -> Evidence:
    """Open the evidence of a run in its folder, in a running loop. Raises OSError."""
    opened = Opened(
        run=scenario.config.name,
        configuration_sha256=sha256(scenario.config.model_dump_json().encode()),
        clock=clock,
        vehicles={spec.name: spec.sysid for spec in scenario.specs},
        continues=None if resumes is None else resumes.evidence,
    )
    return Evidence(
        folder / FILE_NAME,
        opened,
        now=asyncio.get_running_loop().time,
        unix_s_at_zero=epoch_ns(clock) / 1e9,
        say=say,
        waits_in_thread=clock == "real",
    )


@contextlib.asynccontextmanager
async def open_resources(
    scenario: Scenario,
    folder: Path,
    clock: Clock,
    address_of: simulator.AddressOf,
    bus: Transport | None,
    say: Callable[[str], None],
    evidence: Evidence,
    is_behind: Callable[[], bool],
) -> AsyncIterator[FlightResources]:
    """Open the resources of a flight; close them at the end, except `bus`, an already open bus.

    is_behind: function that returns whether an agent has unprocessed events; a simulator process waits then.
    """
    wire, began_ns = MemoryWire(), epoch_ns(clock)
    loop = asyncio.get_running_loop()

    def wall_time_us() -> int:
        return (began_ns + round(loop.time() * 1e9)) // 1000

    async with contextlib.AsyncExitStack() as stack:
        simulator_task: asyncio.Task[None] | None = None
        links = scenario.config.links
        pool = ThreadPoolExecutor(1, "timestamps") if clock == "real" else None
        if pool is not None:
            # The shutdown does not wait: a disk that hangs must not delay the reports.
            stack.callback(pool.shutdown, wait=False)
        front_end = await stack.enter_async_context(
            FrontEnd(
                wall_time_us=wall_time_us,
                memory={"fleet": wire},
                evidence=evidence,
                signing=_signing(links, pool),
                say=partial(_report, evidence, say),
            )
        )
        stack.callback(_report_refused, front_end, evidence, say)
        for receiver in links.forward:
            await front_end.forward(parse_url(receiver), commands=links.forward_commands)
        if any(spec.simulated for spec in scenario.specs):
            if clock == "virtual":
                # The simulator is another package, and only the virtual clock needs it here.
                from swarmctl.flight.virtual_simulator import fleet_on  # noqa: PLC0415

                simulator_task = await stack.enter_async_context(fleet_on(wire, scenario, address_of))
            else:
                # The front end opens the port first, so a port in use is reported at once.
                endpoint = parse_url(_simulated_url(scenario))
                await front_end.open(endpoint)
                url = f"{'udpout' if endpoint.kind == 'udpin' else 'tcpout'}://{_connect_address(endpoint)}"
                simulator_task = await stack.enter_async_context(
                    simulator.running(
                        scenario, url, folder, lambda: front_end.has_unread(endpoint) or is_behind()
                    )
                )
        if not is_small(scenario.grid.n_cells):
            # Loading the planner's machine code takes at least a second, too long for a pause in flight.
            if clock == "real":
                await asyncio.to_thread(warm_up)
            else:
                warm_up()
        communication = scenario.config.communication
        authentication: Authentication | None = None
        if bus is None and communication.bus == "zenoh" and clock == "real":
            name, token = scenario.config.name, token_of_environment() or new_token()
            authentication = by_token(name, token, communication.clock_tolerance_s, time.time)
            bus = stack.enter_context(open_bus(name, communication.listen, token.text, say, ReportOnce(say)))
        transport = bus or MemoryBus(ReportOnce(say))
        yield FlightResources(front_end, transport, simulator_task, evidence, authentication)


def _report_refused(front_end: FrontEnd, evidence: Evidence, say: Callable[[str], None]) -> None:
    if front_end.refusal_summary:
        _report(evidence, say, front_end.refusal_summary)


def _report(evidence: Evidence, say: Callable[[str], None], text: str) -> None:
    say(text)
    evidence.remark(text)


def _signing(links: Links, pool: Executor | None) -> Signing | None:
    """Return the MAVLink signing of the links; None without a key. `pool` writes the timestamps to the disk.

    Raises LinkError if the key or its timestamps cannot be used.
    """
    if links.signing_key is None:
        return None
    file = Path(links.signing_key)
    try:
        return Signing(read_mavlink_key(file), TimestampFile(file), links.signing_link_id, pool)
    except (KeyringError, OSError, ValueError) as error:
        raise LinkError(f"links.signing_key: {error}") from error


def build_members(
    scenario: Scenario,
    folder: Path,
    resources: FlightResources,
    network: Network,
    operator_service: OperatorService,
    observers: tuple[Any, ...],
    clock: Clock,
    run_clock: RunClock,
    say: Callable[[str], None],
    report_counts: dict[int, external_observations.ReportCounts],
    report_authentication: Authentication,
    recorded: Mapping[int, RecordedVehicle],
) -> Iterator[Member]:
    """Build the members of this process, each with its link, its sensor and its agent.

    `report_counts` is filled with each vehicle's counters of payload reports, by system id. `recorded` are
    the vehicles of a run that this process continues.
    """
    source = SOURCES[scenario.config.sensor.source]
    links = scenario.config.links
    streaming = Streaming(links.position_hz, links.stop_other_streams)
    for spec, task in zip(scenario.specs, scenario.tasks, strict=True):
        endpoint = parse_url(spec.url)
        if spec.simulated and clock == "virtual":
            endpoint = Endpoint("memory", "fleet")
        relay = _EventRelay()
        link = LINKS[spec.link](
            resources.front_end,
            endpoint,
            spec.sysid,
            name=spec.name,
            on_event=relay,
            tlog=folder / f"{spec.name}.tlog",
            streaming=streaming,
        )
        rng = scenario.generator(RandomStream.SENSOR, spec.sysid)
        sensor = source.sensor(scenario.grid, scenario.hostiles, scenario.prior.sensor, rng)
        runner = Runner(
            task,
            scenario.prior,
            link,
            sensor,
            network,
            observers,
            operator_service=operator_service,
            offload=clock == "real" and scenario.grid.n_cells > OFFLOAD_CELLS,
            recorded=recorded[spec.sysid].state if spec.sysid in recorded else None,
        )
        relay.runner = runner
        if source.external:
            on_observed = partial(_on_observed, resources.evidence, runner)
            report_counts[spec.sysid] = external_observations.ReportReceiver(
                resources.transport,
                scenario.config.name,
                spec.sysid,
                scenario.grid,
                run_clock.unix_s,
                on_observed,
                partial(_say_about, say, spec.name),
                tolerance_s=scenario.config.communication.clock_tolerance_s,
                authentication=report_authentication,
            ).counts
        yield Member(spec, runner)


def _say_about(say: Callable[[str], None], name: str, text: str) -> None:
    say(f"{name}: {text}")


def _on_observed(evidence: Evidence, runner: Runner, cells: ReportedCells, source: str) -> None:
    text = f"{source or 'a payload'} reports {'1 cell' if len(cells) == 1 else f'{len(cells)} cells'}"
    runner.note(text)
    if source == MANUAL_SOURCE:
        evidence.operator("observe", runner.state.task.name, cells=cells)
    runner.post(ev.Observed(cells))


class _EventRelay:
    """Event handler of a link that is built before its runner."""

    runner: Runner

    def __call__(self, event: Any) -> None:
        self.runner.on_link_event(event)


def epoch_ns(clock: Clock) -> int:
    """Return the wall time at which the loop's clock showed 0 [ns]."""
    if clock == "virtual":
        return VIRTUAL_EPOCH_NS
    return time.time_ns() - round(asyncio.get_running_loop().time() * 1e9)


def _connect_address(endpoint: Endpoint) -> str:
    host = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(endpoint.host, endpoint.host)
    return f"[{host}]:{endpoint.port}" if ":" in host else f"{host}:{endpoint.port}"


def with_free_port(scenario: Scenario) -> Scenario:
    """Return the scenario with a free port in place of port 0 of simulated vehicles."""
    if not any(spec.simulated for spec in scenario.specs):
        return scenario
    endpoint = parse_url(_simulated_url(scenario))
    if endpoint.port != 0:
        return scenario
    kind = socket.SOCK_DGRAM if endpoint.kind == "udpin" else socket.SOCK_STREAM
    family = socket.AF_INET6 if ":" in endpoint.host else socket.AF_INET
    with socket.socket(family, kind) as probe:
        probe.bind((endpoint.host, 0))
        url = str(replace(endpoint, port=probe.getsockname()[1]))
    specs = tuple(replace(spec, url=url) if spec.simulated else spec for spec in scenario.specs)
    return replace(scenario, specs=specs)


def _simulated_url(scenario: Scenario) -> str:
    return next(spec.url for spec in scenario.specs if spec.simulated)
