"""The composition root: a `Scenario` becomes parts, the parts one task tree, the tree one flight."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import time
from collections.abc import Callable, Coroutine, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Literal

from swarmctl import evidence_run, simulator
from swarmctl.agent import ARRIVED, AgentState, Phase
from swarmctl.bus import looks
from swarmctl.bus import tally as bus_tally
from swarmctl.bus.base import BusError, Transport
from swarmctl.bus.desk import Desk, Tally, Unseal, unsealed
from swarmctl.bus.endpoint import NOBODY, parse_endpoint
from swarmctl.bus.network import Network, RunClock
from swarmctl.core.events import Order
from swarmctl.core.frames import Seal
from swarmctl.core.messages import GiveOrder, Request
from swarmctl.director import (
    Director,
    Launch,
    Member,
    Permission,
    PreflightFailed,
    left_how,
    turns_to_return,
)
from swarmctl.display import Picture, row
from swarmctl.evidence.book import Signer
from swarmctl.evidence.hooks import Evidence
from swarmctl.face import Chatter, Steady, Ui
from swarmctl.links.base import LinkError
from swarmctl.networking import network_of, speedup_of
from swarmctl.parts import Clock, epoch_ns, members_of, parts_of, with_free_port
from swarmctl.preflight.conduct import Checked, Preflight, summary_of
from swarmctl.preflight.waivers import Waiver
from swarmctl.record import Recorder
from swarmctl.runner import Observer
from swarmctl.scenario import Scenario
from swarmctl.summary import Ledger, summary
from swarmctl.supervise import cancelled
from swarmctl.virtual import Carry, undisturbed

Ending = Literal["ended", "stopped", "abandoned", "failed"]
REFRESH_S = 0.25
LAST_RESORT_S = 10.0

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


@dataclass(slots=True)
class Report:
    """How a flight ended."""

    ended: Ending
    trouble: tuple[str, ...]
    """what went wrong before or beside the flight"""
    left: tuple[str, ...]
    """how each vehicle was left"""
    states: dict[int, AgentState]
    ledger: Ledger
    summary: dict[str, Any]
    bug: Exception | None = None
    """what broke the flight and should not have been possible"""
    checked: dict[str, tuple[Checked, ...]] = field(default_factory=dict)
    """what the preflight checks found of each vehicle, by its name"""

    @property
    def arrived(self) -> int:
        return sum(s.outcome == ARRIVED for s in self.states.values())

    @property
    def all_arrived(self) -> bool:
        return bool(self.states) and self.arrived == len(self.states)


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
    names = {task.uav: task.name for task in scenario.tasks}
    began_s, ledger, face = time.monotonic(), Ledger(), Steady(ui)
    members: list[Member] = []
    trouble: list[str] = []
    ended: Ending = "failed"
    bug: Exception | None = None
    failures: list[BaseException] = []
    commands = Tally()
    tallies: dict[int, bus_tally.Tally] = {}
    reports: dict[int, looks.Tally] = {}
    checked: dict[str, tuple[Checked, ...]] = {}
    recorder = Recorder(folder / "run.mcap", scenario.config, names, epoch_ns(clock))
    evidence = evidence_run.begin(scenario, folder, clock, face.say)
    try:
        async with (
            contextlib.AsyncExitStack() as opened,
            parts_of(scenario, folder, clock, carry, bus, face.say, evidence) as parts,
        ):
            run_clock = RunClock(epoch_ns(clock) / 1e9, speedup_of(scenario, clock))
            observers = (recorder, ledger, Chatter(face, names), evidence)
            network = opened.enter_context(
                contextlib.closing(
                    network_of(
                        scenario, parts.transport, run_clock, manner.seal, partial(_refused, observers)
                    )
                )
            )
            desk = _desk(scenario, parts.transport, face, commands, manner, members)
            members += members_of(
                scenario, folder, parts, network, desk, observers, clock, run_clock, face.say, reports
            )
            tallies |= network.tallies()
            director = Director(
                members,
                scenario.config.flight,
                seconds_per_delay=1.0 / run_clock.speedup,
                say=face.say,
                permission=_recorded(permission, evidence),
                clearance=Preflight(
                    scenario,
                    checked,
                    manner.waivers,
                    unix_s_at_zero=run_clock.unix_s_at_zero,
                    speedup=run_clock.speedup,
                    free_clocks=clock == "real",
                    say=face.say,
                    on_waived=partial(_waived, evidence),
                    sets_parameters=manner.launch != "never",
                ),
                launch=manner.launch,
            )
            show = _show(members, ledger, face, scenario, director, network)
            try:
                ended = await _conduct(director, members, parts.played, face, show, evidence)
            except Exception:
                await _last_resort(
                    "the flight is broken", members, parts.played, Order(scenario.config.flight.on_exit), face
                )
                raise
            if ended == "abandoned":
                await _last_resort(
                    "not waited for", members, parts.played, Order(scenario.config.flight.on_exit), face
                )
    except Exception as error:  # noqa: BLE001 - whatever it was, the vehicles are accounted for
        failures += _leaves(error)
        for leaf in failures:
            if isinstance(leaf, EXPECTED):
                trouble += str(leaf).splitlines()
            else:
                bug = error
    finally:
        recorder.close()
        evidence.close(manner.signer)
    trouble += [text for text in (recorder.trouble, evidence.trouble) if text]
    states = {m.spec.sysid: m.state for m in members}
    wall_s = time.monotonic() - began_s if clock == "real" else None
    content = (
        summary(
            scenario,
            states,
            ledger,
            clock=clock,
            wall_s=wall_s,
            commands=asdict(commands),
            networks=tallies,
            looks={uav: asdict(tally) for uav, tally in reports.items()},
        )
        | {"preflight": summary_of(checked)}
        if states
        else {}
    )
    gone = any(isinstance(leaf, simulator.SimulatorFailed) for leaf in failures)
    left = tuple(
        f"{m.name}: gone with the simulator" if gone and m.spec.simulated else left_how(m) for m in members
    )
    return Report(ended, tuple(trouble), left, states, ledger, content, bug, checked)


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


async def _last_resort(
    why: str, members: Sequence[Member], played: asyncio.Task[None] | None, order: Order, ui: Ui
) -> None:
    """Nobody decides for the vehicles any more, so all are told at once to leave the air."""
    reachable = [m for m in members if not (m.spec.simulated and played is not None and played.done())]
    armed = [m for m in reachable if m.state.vehicle.armed and m.state.phase is not Phase.RELEASED]
    if not armed:
        return
    ui.say(f"{why}: {', '.join(m.name for m in armed)} to {order}, all at once")

    async def bring(member: Member) -> None:
        link = member.runner.link
        action = {Order.HOLD: link.hold, Order.LAND: link.land}.get(order, link.return_home)
        with contextlib.suppress(LinkError, TimeoutError):
            async with asyncio.timeout(LAST_RESORT_S):
                await action()

    await asyncio.gather(*map(bring, armed))


def _desk(
    scenario: Scenario,
    transport: Transport,
    ui: Ui,
    commands: Tally,
    manner: Manner,
    members: Sequence[Member],
) -> Desk:
    """`members` may be filled later."""

    def closed(command: Request) -> str:
        if not isinstance(command, GiveOrder):
            return ""
        if manner.orders_closed is not None:
            return manner.orders_closed(members)
        return orders_closed(scenario, members, command)

    return Desk(
        transport,
        scenario.config.name,
        ui.say,
        commands,
        uav=manner.desk_of,
        closed=closed,
        turns=partial(turns_to_return, members, ui.say),
        unseal=manner.unseal,
    )


def orders_closed(scenario: Scenario, members: Sequence[Member], order: GiveOrder) -> str:
    """Why one process that flies all does not take an order; empty if it does.

    Nobody is asked who it is. So nobody launches an aircraft, and others than this machine order it nothing.
    """
    real = [m.name for m in members if m.identity is None or not m.identity.simulated]
    listen = scenario.config.communication.listen
    if not real:
        return ""
    if order.order == "launch":
        return f"{', '.join(real)} is not played by the built-in simulator: only `swarmctl fly` launches it"
    if listen == NOBODY or parse_endpoint(listen).is_loopback:
        return ""
    return (
        f"{', '.join(real)} is not played by the built-in simulator, and others than this machine reach "
        f"{listen}: set communication.listen to tcp/127.0.0.1:0, or fly with `swarmctl agent` and keys"
    )


async def _conduct(
    director: Director,
    members: Sequence[Member],
    played: asyncio.Task[None] | None,
    ui: Ui,
    show: Coroutine[Any, Any, None],
    evidence: Evidence,
) -> Literal["ended", "stopped", "abandoned"]:
    """Everything that runs during a flight, under one task group; ends when the director does."""
    abandoned = False
    async with asyncio.TaskGroup() as tasks:
        helpers = [tasks.create_task(m.runner.run()) for m in members]
        helpers.append(tasks.create_task(show))
        helpers.append(tasks.create_task(_any_bug()))
        if played is not None:
            helpers.append(tasks.create_task(_until_it_fails(played, members, ui)))
        flight = asyncio.create_task(director.fly())

        def interrupted() -> None:
            nonlocal abandoned
            abandoned = director.stop.is_set()
            evidence.operator("leave at once" if abandoned else "end of the flight", by="signal")
            if abandoned:
                flight.cancel()
            director.stop.set()

        with _signals(interrupted):
            try:
                ended = await flight
            except asyncio.CancelledError:
                if not abandoned:
                    await cancelled(flight)
                    raise
                ended = "stopped"
            finally:
                for helper in helpers:
                    helper.cancel()
    return "abandoned" if abandoned else ended


async def _any_bug() -> None:
    """Raises what a callback raised: asyncio would log it and go on, but a bug stops everything."""
    loop = asyncio.get_running_loop()
    bug: asyncio.Future[None] = loop.create_future()

    def caught(_loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        error = context.get("exception")
        if error is not None and not bug.done():
            bug.set_exception(error)

    loop.set_exception_handler(caught)
    try:
        await bug
    finally:
        loop.set_exception_handler(None)


async def _until_it_fails(played: asyncio.Task[None], members: Sequence[Member], ui: Ui) -> None:
    try:
        await asyncio.shield(played)
    except simulator.SimulatorFailed as error:
        if all(m.spec.simulated for m in members):
            raise
        ui.say(f"{error}; the vehicles that are not simulated fly on")


@contextlib.contextmanager
def _signals(interrupted: Any) -> Iterator[None]:
    """Ctrl-C and a polite kill ask for an orderly end; a second one for leaving at once."""
    loop = asyncio.get_running_loop()
    wanted = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    try:
        for number in wanted:
            loop.add_signal_handler(number, interrupted)
    except (ValueError, RuntimeError):  # not the main thread: whoever runs us there has other means
        yield
        return
    try:
        yield
    finally:
        for number in wanted:
            loop.remove_signal_handler(number)


async def _show(
    members: Sequence[Member],
    ledger: Ledger,
    ui: Ui,
    scenario: Scenario,
    director: Director,
    network: Network,
) -> None:
    marks: list[tuple[float, float]] = []

    def refresh() -> None:
        nonlocal marks
        clocks = [m.state.vehicle.time_boot_s for m in members]
        marks = [*marks[-20:], (time.monotonic(), max(clocks, default=0.0))]
        (t0, v0), (t1, v1) = marks[0], marks[-1]
        rows = [
            row(
                m.state,
                m.runner.link.age_s(),
                "; ".join(m.waiting_for),
                network.tally(m.spec.sysid).refused.total(),
            )
            for m in members
        ]
        speed = (v1 - v0) / (t1 - t0) if t1 > t0 and v0 > 0.0 else None
        on_ctrl_c = "leave at once" if director.stop.is_set() else "hold and leave"
        ui.refresh(Picture(scenario.config.name, ledger.flown_s, speed, rows, on_ctrl_c))

    try:
        while True:
            refresh()
            await asyncio.sleep(REFRESH_S)
    finally:
        refresh()  # the last picture is of the end


def _leaves(error: BaseException) -> Iterator[BaseException]:
    if isinstance(error, BaseExceptionGroup):
        for part in error.exceptions:
            yield from _leaves(part)
    else:
        yield error
