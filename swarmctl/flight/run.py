"""A run: the facts of a flight that are fixed before anything is opened."""

from __future__ import annotations

import asyncio
import socket
import time
from collections.abc import Awaitable, Callable, Coroutine, Mapping
from pathlib import Path
from typing import Any, Literal

import msgspec

from swarmctl.bus.authentication import NO_AUTHENTICATION, Authentication
from swarmctl.bus.network import RunClock
from swarmctl.config.scenario import Scenario
from swarmctl.config.specs import Spec
from swarmctl.core.frames import FrameCodec
from swarmctl.core.records import replace
from swarmctl.flight.director import LaunchMode
from swarmctl.flight.permission import Permission
from swarmctl.links import LINKS
from swarmctl.links.transports.memory import MemoryWire
from swarmctl.links.url import Endpoint, parse_url
from swarmctl.preflight.waivers import Waiver
from swarmctl.report.evidence.log import Signer
from swarmctl.report.ui import SafeUi, Ui
from swarmctl.report.unfinished_run import RecordedVehicle, UnfinishedRun

Clock = Literal["real", "virtual"]
VIRTUAL_EPOCH_NS = 1_767_225_600 * 10**9
"""2026-01-01, the wall time of virtual runs at loop time 0 [ns since 1970]: equal runs write equal files"""


class FlightOptions(msgspec.Struct, frozen=True):
    """Options of a process that flies vehicles."""

    launch: LaunchMode = "when-ready"
    flies_all: bool = True
    """False: other processes fly the other vehicles of the swarm"""
    authentication: Authentication = NO_AUTHENTICATION
    """check of operators' commands on an open bus; a bus that the flight opens has a token of its own"""
    report_authentication: Authentication = NO_AUTHENTICATION
    """check of payloads' reports on an open bus; links with certificates need none"""
    frame_codec: FrameCodec | None = None
    """codec that signs and verifies messages by the swarm's keys; None: there are no keys"""
    watch_bus: Callable[[], Coroutine[Any, Any, None]] | None = None
    """a task that reports the state of an open bus until it is cancelled"""
    signer: Signer | None = None
    """signer of the evidence at the end of the run; None: the evidence stays unsigned"""
    waivers: tuple[Waiver, ...] = ()
    """preflight checks that an operator lets fail"""
    resumes: UnfinishedRun | None = None
    """run whose program died in flight, which this run continues; None: a new flight"""
    simulate: Callable[[MemoryWire, Scenario], Awaitable[None]] | None = None
    """the simulator of a run on the virtual clock, until cancelled; None: that of `virtual_simulator`"""


DEFAULT_OPTIONS = FlightOptions()


class Run(msgspec.Struct, frozen=True):
    """The facts of one run."""

    scenario: Scenario
    folder: Path
    ui: SafeUi
    clock: Clock
    epoch_ns: int
    """wall time at time 0 of the loop's clock [ns since 1970]"""
    permission: Permission
    options: FlightOptions

    @property
    def times(self) -> RunClock:
        simulate = self.scenario.config.simulate
        speedup = simulate.speedup if simulate is not None and self.clock == "real" else 1.0
        return RunClock(self.epoch_ns / 1e9, speedup)

    @property
    def names(self) -> dict[int, str]:
        """The names of this process's vehicles, by system id."""
        return {spec.sysid: spec.name for spec in self.scenario.specs}

    @property
    def simulated(self) -> tuple[Spec, ...]:
        """The simulated vehicles of this process; all have one URL."""
        return tuple(spec for spec in self.scenario.specs if spec.simulated)

    @property
    def recorded(self) -> Mapping[int, RecordedVehicle]:
        """The vehicles of the continued run, by system id; empty for a new flight."""
        return {} if self.options.resumes is None else self.options.resumes.vehicles

    def endpoint(self, spec: Spec) -> Endpoint:
        """Return the endpoint at which this process reaches a vehicle."""
        is_in_process = spec.simulated and self.clock == "virtual"
        return Endpoint("memory", "fleet") if is_in_process else parse_url(spec.url)


def real_clock_need(scenario: Scenario) -> str | None:
    """Return the key that needs the machine's clock, with the reason; None if a virtual clock fits."""
    if scenario.config.vehicles:
        return "vehicles: vehicles with a URL fly in real time only"
    simulate = scenario.config.simulate
    if simulate is not None and not LINKS[simulate.link].fits_virtual_clock:
        return f"simulate.link: {simulate.link} uses the machine's clock, and `link: direct` does not"
    return None


def run_of(
    scenario: Scenario,
    folder: Path,
    ui: Ui,
    clock: Clock,
    permission: Permission,
    options: FlightOptions,
) -> Run:
    """Return the run of a scenario on the running loop."""
    epoch_ns = VIRTUAL_EPOCH_NS
    if clock == "real":
        scenario = _with_free_port(scenario)
        epoch_ns = time.time_ns() - round(asyncio.get_running_loop().time() * 1e9)
    return Run(scenario, folder, SafeUi(ui), clock, epoch_ns, permission, options)


def _with_free_port(scenario: Scenario) -> Scenario:
    """Return the scenario with a free port in place of port 0 of simulated vehicles."""
    simulated = [spec for spec in scenario.specs if spec.simulated]
    if not simulated or (endpoint := parse_url(simulated[0].url)).port != 0:
        return scenario
    kind = socket.SOCK_DGRAM if endpoint.kind == "udpin" else socket.SOCK_STREAM
    family = socket.AF_INET6 if ":" in endpoint.host else socket.AF_INET
    with socket.socket(family, kind) as probe:
        probe.bind((endpoint.host, 0))
        url = str(replace(endpoint, port=probe.getsockname()[1]))
    specs = tuple(replace(spec, url=url) if spec.simulated else spec for spec in scenario.specs)
    return replace(scenario, specs=specs)
