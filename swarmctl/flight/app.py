"""The composition root: a `Scenario` becomes parts, the parts one task tree, the tree one flight."""

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
from swarmctl.agent.traffic.separation.conflicts import Crossings
from swarmctl.bus import external_observations
from swarmctl.bus.network import Network, RunClock
from swarmctl.bus.node import counters as bus_tally
from swarmctl.bus.operator_service import Tally, Unseal, unsealed
from swarmctl.bus.transports.base import BusError, Transport
from swarmctl.config.scenario import Scenario
from swarmctl.core.events import Order
from swarmctl.core.frames import Seal
from swarmctl.flight import emergency, evidence_log, simulator
from swarmctl.flight.director import Director, Launch, Permission, PreflightFailed
from swarmctl.flight.live_table import show
from swarmctl.flight.member import Member
from swarmctl.flight.network import network_of, speedup_of
from swarmctl.flight.operator_orders import order_desk
from swarmctl.flight.return_queue import Turns
from swarmctl.flight.runner import Observer
from swarmctl.flight.task_tree import conduct
from swarmctl.flight.virtual_simulator import Carry, undisturbed
from swarmctl.flight.wiring import Clock, Parts, epoch_ns, members_of, parts_of, with_free_port
from swarmctl.links.base import LinkError
from swarmctl.preflight.conversation import Checked, Preflight, summary_of
from swarmctl.preflight.waivers import Waiver
from swarmctl.report.evidence.book import Signer
from swarmctl.report.evidence.hooks import Evidence
from swarmctl.report.final_state import left_how
from swarmctl.report.outcome import Ending, Report
from swarmctl.report.record import Recorder
from swarmctl.report.summary import Ledger, summary
from swarmctl.report.ui import Chatter, Steady, Ui

EXPECTED = (PreflightFailed, simulator.SimulatorFailed, LinkError, BusError)


@dataclass(frozen=True, slots=True)
class Manner:
    """How a process flies the vehicles it has."""

    launch: Launch = "when-ready"
    desk_of: int | None = None
    """the vehicle whose operator's desk it keeps; None: the station's, for all vehicles"""
    orders_closed: Callable[[Sequence[Member]], str] | None = None
    """why operators' orders are not taken now; empty if they are. None: one process flies all, and takes
    those of its own machine"""
    unseal: Unseal = unsealed
    """opens operators' commands"""
    seal: Seal | None = None
    """signs what its UAVs say, and opens what others say; None: nobody signs"""
    signer: Signer | None = None
    """signs the evidence when the run ends; None: nobody does"""
    waivers: tuple[Waiver, ...] = ()
    """preflight checks that an operator lets fail"""


ALL_IN_ONE = Manner()


async def fly(
    scenario: Scenario,
    folder: Path,
    ui: Ui,
    *,
    clock: Clock,
    permission: Permission,
    carry: Carry = undisturbed,
    bus: Transport | None = None,
    manner: Manner = ALL_IN_ONE,
) -> Report:
    """Fly the scenario; leaves `run.mcap` and the tlogs in `folder`. The rest is for `outputs` to write.

    `bus` is one that is open already; else the configuration's, or one in memory on a virtual clock.
    """
    if clock == "real":
        scenario = with_free_port(scenario)
    run = _Run(scenario, folder, clock, manner, Steady(ui))
    recorder = Recorder(folder / "run.mcap", scenario.config, run.names, epoch_ns(clock))
    evidence = evidence_log.begin(scenario, folder, clock, run.face.say)
    try:
        async with (
            contextlib.AsyncExitStack() as opened,
            parts_of(scenario, folder, clock, carry, bus, run.face.say, evidence) as parts,
        ):
            observers = (recorder, run.ledger, Chatter(run.face, run.names), evidence)
            network = opened.enter_context(contextlib.closing(_network(run, parts, observers)))
            _gather(run, parts, network, observers)
            director = _director(run, _recorded(permission, evidence), evidence, network)
            await _conducted(run, director, network, parts)
    except Exception as error:  # noqa: BLE001 - whatever it was, the vehicles are accounted for
        run.failed(error)
    finally:
        recorder.close()
        evidence.close(manner.signer)
    run.trouble += [text for text in (recorder.trouble, evidence.trouble) if text]
    return run.report()


@dataclass(slots=True)
class _Run:
    """One flight from its parts to its report."""

    scenario: Scenario
    folder: Path
    clock: Clock
    manner: Manner
    face: Steady
    run_clock: RunClock = field(init=False)
    began_s: float = field(default_factory=time.monotonic)
    ledger: Ledger = field(default_factory=Ledger)
    members: list[Member] = field(default_factory=list)
    ended: Ending = "failed"
    trouble: list[str] = field(default_factory=list)
    failures: list[BaseException] = field(default_factory=list)
    bug: Exception | None = None
    commands: Tally = field(default_factory=Tally)
    tallies: dict[int, bus_tally.Tally] = field(default_factory=dict)
    reports: dict[int, external_observations.Tally] = field(default_factory=dict)
    checked: dict[str, tuple[Checked, ...]] = field(default_factory=dict)
    crossings: deque[Crossings] = field(default_factory=partial(deque, maxlen=1))

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
            f"{m.name}: gone with the simulator" if gone and m.spec.simulated else left_how(m)
            for m in self.members
        )
        content = self._summary(states) if states else {}
        return Report(
            self.ended, tuple(self.trouble), left, states, self.ledger, content, self.bug, self.checked
        )

    def _summary(self, states: dict[int, AgentState]) -> dict[str, Any]:
        content = summary(
            self.scenario,
            states,
            self.ledger,
            clock=self.clock,
            wall_s=time.monotonic() - self.began_s if self.clock == "real" else None,
            commands=asdict(self.commands),
            networks=self.tallies,
            looks={uav: asdict(tally) for uav, tally in self.reports.items()},
            crossings=self.crossings[-1] if self.crossings else None,
        )
        return content | {"preflight": summary_of(self.checked)}


def _network(run: _Run, parts: Parts, observers: Sequence[Observer]) -> Network:
    refused = partial(_refused, observers)
    return network_of(run.scenario, parts.transport, run.run_clock, run.manner.seal, refused)


def _gather(run: _Run, parts: Parts, network: Network, observers: tuple[Observer, ...]) -> None:
    """The members of the flight, and the desk at which they are ordered."""
    desk = order_desk(
        run.scenario,
        parts.transport,
        run.face,
        run.commands,
        run.members,
        uav=run.manner.desk_of,
        closed_by=run.manner.orders_closed,
        unseal=run.manner.unseal,
    )
    # All of them or none: what has no link cannot be summed up.
    run.members += list(
        members_of(
            run.scenario,
            run.folder,
            parts,
            network,
            desk,
            observers,
            run.clock,
            run.run_clock,
            run.face.say,
            run.reports,
        )
    )
    run.tallies |= network.tallies()


def _director(run: _Run, permission: Permission, evidence: Evidence, network: Network) -> Director:
    clearance = Preflight(
        run.scenario,
        run.checked,
        run.manner.waivers,
        unix_s_at_zero=run.run_clock.unix_s_at_zero,
        speedup=run.run_clock.speedup,
        free_clocks=run.clock == "real",
        say=run.face.say,
        on_waived=partial(_waived, evidence),
        sets_parameters=run.manner.launch != "never",
        crossings=run.crossings,
    )
    return Director(
        run.members,
        run.scenario.config.flight,
        seconds_per_delay=1.0 / run.run_clock.speedup,
        say=run.face.say,
        permission=permission,
        clearance=clearance,
        launch=run.manner.launch,
        elsewhere=_elsewhere(run, network),
    )


def _elsewhere(run: _Run, network: Network) -> Turns | None:
    """Where this process flies one vehicle of a swarm: it knows of the others what they tell."""
    uav = run.manner.desk_of
    return None if uav is None else Turns(uav, partial(network.states, uav))


async def _conducted(run: _Run, director: Director, network: Network, parts: Parts) -> None:
    """The flight, and what becomes of vehicles when it breaks or is left at once."""
    flight, say = run.scenario.config.flight, run.face.say
    order = Order(flight.on_exit)
    shown = partial(show, run.members, run.ledger, run.face, run.scenario, director, network)
    try:
        run.ended = await conduct(director, run.members, parts.played, run.face, shown, parts.evidence)
    except Exception:
        await emergency.in_turns(
            "the flight is broken",
            _reachable(run.members, parts.played),
            order,
            say,
            within_s=flight.on_exit_deadline_s,
            speedup=run.run_clock.speedup,
        )
        raise
    if run.ended == "abandoned":
        await emergency.at_once("not waited for", _reachable(run.members, parts.played), order, say)


def _recorded(permission: Permission, evidence: Evidence) -> Permission:
    """The permission, which an operator has given, and evidence of it."""

    def permit(foreign: Sequence[Member]) -> None:
        permission(foreign)
        for member in foreign:
            firmware = member.identity.firmware if member.identity is not None else None
            evidence.operator("permits arming", member.name, firmware=firmware, url=member.spec.url)

    return permit


def _waived(evidence: Evidence, checked: Checked) -> None:
    evidence.waived(checked.vehicle, checked.check, f"found {checked.finding.found}")


def _refused(observers: Sequence[Observer], uav: int, text: str) -> None:
    """What a vehicle's network would not take, and who tells what it saw otherwise."""
    now = asyncio.get_running_loop().time()
    for observer in observers:
        observer.said(uav, text, now, aloud=False)


def _reachable(members: Sequence[Member], played: asyncio.Task[None] | None) -> list[Member]:
    """Those that have not gone with the simulator."""
    return [m for m in members if not (m.spec.simulated and played is not None and played.done())]


def _leaves(error: BaseException) -> Iterator[BaseException]:
    if isinstance(error, BaseExceptionGroup):
        for part in error.exceptions:
            yield from _leaves(part)
    else:
        yield error
