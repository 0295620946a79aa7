"""The composition root: a `Scenario` becomes parts, the parts one task tree, the tree one flight."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import time
from collections.abc import Callable, Coroutine, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

from swarmctl import simulator
from swarmctl.agent import ARRIVED, AgentState, Phase
from swarmctl.bus import keys, looks
from swarmctl.bus import tally as bus_tally
from swarmctl.bus.base import BusError, Transport
from swarmctl.bus.desk import Desk, Tally, Unseal, unsealed
from swarmctl.bus.network import Network, RunClock
from swarmctl.core.events import Order
from swarmctl.core.frames import Seal
from swarmctl.director import Director, Launch, Member, Permission, PreflightFailed, left_how
from swarmctl.display import Picture, row
from swarmctl.face import Chatter, Steady, Ui
from swarmctl.links.base import LinkError
from swarmctl.networking import network_of, speedup_of
from swarmctl.parts import Clock, epoch_ns, members_of, parts_of, with_free_port
from swarmctl.record import Recorder
from swarmctl.runner import Observer
from swarmctl.scenario import Scenario
from swarmctl.summary import Ledger, summary
from swarmctl.supervise import cancelled
from swarmctl.virtual import Carry, undisturbed

Ending = Literal["ended", "stopped", "abandoned", "failed"]
REFRESH_S = 0.25
LAST_RESORT_S = 10.0
NO_ORDERS = (
    "one process flies this swarm and takes new weights only; Ctrl-C there makes all hold, and then do what "
    "flight.on_exit says; vehicles flown by `swarmctl agent` take orders"
)

EXPECTED = (PreflightFailed, simulator.SimulatorFailed, LinkError, BusError)


@dataclass(frozen=True, slots=True)
class Manner:
    """How a process flies the vehicles it has."""

    launch: Launch = "when-ready"
    desk_of: int | None = None
    """the vehicle whose operator's desk it keeps; None: the station's, for all vehicles"""
    orders_closed: Callable[[Sequence[Member]], str] = lambda _members: NO_ORDERS
    """why operators' orders are not taken now; empty if they are"""
    unseal: Unseal = unsealed
    """opens operators' commands"""
    seal: Seal | None = None
    """signs what its UAVs say, and opens what others say; None: nobody signs"""


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
    recorder = Recorder(folder / "run.mcap", scenario.config, names, epoch_ns(clock))
    try:
        async with (
            contextlib.AsyncExitStack() as opened,
            parts_of(scenario, folder, clock, carry, bus, face.say) as parts,
        ):
            run_clock = RunClock(epoch_ns(clock) / 1e9, speedup_of(scenario, clock))
            observers = (recorder, ledger, Chatter(face, names))
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
                permission=permission,
                launch=manner.launch,
            )
            show = _show(members, ledger, face, scenario, director, network)
            try:
                ended = await _conduct(director, members, parts.played, face, show)
            except Exception:
                await _last_resort(members, parts.played, Order(scenario.config.flight.on_exit), face)
                raise
    except Exception as error:  # noqa: BLE001 - whatever it was, the vehicles are accounted for
        failures += _leaves(error)
        for leaf in failures:
            if isinstance(leaf, EXPECTED):
                trouble += str(leaf).splitlines()
            else:
                bug = error
    finally:
        recorder.close()
    trouble += [recorder.trouble] if recorder.trouble else []
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
        if states
        else {}
    )
    gone = any(isinstance(leaf, simulator.SimulatorFailed) for leaf in failures)
    left = tuple(
        f"{m.name}: gone with the simulator" if gone and m.spec.simulated else left_how(m) for m in members
    )
    return Report(ended, tuple(trouble), left, states, ledger, content, bug)


def _refused(observers: Sequence[Observer], uav: int, text: str) -> None:
    """What a vehicle's network would not take, and who tells what it saw otherwise."""
    now = asyncio.get_running_loop().time()
    for observer in observers:
        observer.said(uav, text, now, aloud=False)


async def _last_resort(
    members: Sequence[Member], played: asyncio.Task[None] | None, order: Order, ui: Ui
) -> None:
    """The flight is broken: nobody decides for the vehicles any more, so each is told to leave the air."""
    reachable = [m for m in members if not (m.spec.simulated and played is not None and played.done())]
    armed = [m for m in reachable if m.state.vehicle.armed and m.state.phase is not Phase.RELEASED]
    if not armed:
        return
    ui.say(f"the flight is broken: {', '.join(m.name for m in armed)} to {order}")

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

    def closed(kind: keys.Kind) -> str:
        return manner.orders_closed(members) if kind == "order" else ""

    return Desk(
        transport,
        scenario.config.name,
        ui.say,
        commands,
        uav=manner.desk_of,
        closed=closed,
        unseal=manner.unseal,
    )


async def _conduct(
    director: Director,
    members: Sequence[Member],
    played: asyncio.Task[None] | None,
    ui: Ui,
    show: Coroutine[Any, Any, None],
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
