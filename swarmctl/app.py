"""The composition root: a `Scenario` becomes parts, the parts one task tree, the tree one flight."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import socket
import time
from collections.abc import AsyncIterator, Coroutine, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

from swarmctl import simulator
from swarmctl.agent import ARRIVED, AgentState, Phase
from swarmctl.bus.base import BusError, Transport
from swarmctl.bus.desk import Desk, Tally
from swarmctl.bus.memory import MemoryBus
from swarmctl.bus.network import Network
from swarmctl.bus.open import opened
from swarmctl.core.events import Order
from swarmctl.director import Director, Member, Permission, PreflightFailed, left_how
from swarmctl.display import Picture, row
from swarmctl.face import Chatter, Steady, Ui
from swarmctl.links import LINKS
from swarmctl.links.base import LinkError
from swarmctl.links.frontend import FrontEnd
from swarmctl.links.memory import MemoryWire
from swarmctl.links.url import Endpoint, parse_url
from swarmctl.planners import warm_up
from swarmctl.record import Recorder
from swarmctl.runner import Runner
from swarmctl.scenario import Purpose, Scenario, build
from swarmctl.sensors.footprint import Footprint
from swarmctl.summary import Ledger, summary
from swarmctl.supervise import cancelled
from swarmctl.virtual import Carry, fleet_on, undisturbed

Clock = Literal["real", "virtual"]
Ending = Literal["ended", "stopped", "abandoned", "failed"]
VIRTUAL_EPOCH_NS = 1_767_225_600 * 10**9
"""Virtual runs happen at the beginning of 2026, so that equal runs leave equal files."""
REFRESH_S = 0.25
LAST_RESORT_S = 10.0
OFFLOAD_CELLS = 100_000
"""Areas of more cells are searched in a thread, so that the loop serves the links meanwhile."""

EXPECTED = (PreflightFailed, simulator.SimulatorFailed, LinkError, BusError)


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
) -> Report:
    """Fly the scenario; leaves `run.mcap` and the tlogs in `folder`. The rest is for `outputs` to write.

    `bus` is one that is open already; else the configuration's, or one in memory on a virtual clock.
    """
    if clock == "real":
        scenario = _with_free_port(scenario)
    names = {task.uav: task.name for task in scenario.tasks}
    began_s, ledger, face = time.monotonic(), Ledger(), Steady(ui)
    members: list[Member] = []
    trouble: list[str] = []
    ended: Ending = "failed"
    bug: Exception | None = None
    failures: list[BaseException] = []
    commands = Tally()
    recorder = Recorder(folder / "run.mcap", scenario.config, names, _epoch_ns(clock))
    try:
        async with _parts(scenario, folder, clock, carry, bus, face) as (front_end, transport, played):
            network = Network(transport, scenario.config.name, _reach(scenario))
            desk = Desk(transport, scenario.config.name, face.say, commands)
            observers = (recorder, ledger, Chatter(face, names))
            members += _members(scenario, folder, front_end, network, desk, observers, clock)
            director = _director(scenario, members, face, clock, permission)
            show = _show(members, ledger, face, scenario, director)
            try:
                ended = await _conduct(director, members, played, face, show)
            except Exception:
                await _last_resort(members, played, Order(scenario.config.flight.on_exit), face)
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
        summary(scenario, states, ledger, clock=clock, wall_s=wall_s, commands=asdict(commands))
        if states
        else {}
    )
    gone = any(isinstance(leaf, simulator.SimulatorFailed) for leaf in failures)
    left = tuple(
        f"{m.name}: gone with the simulator" if gone and m.spec.simulated else left_how(m) for m in members
    )
    return Report(ended, tuple(trouble), left, states, ledger, content, bug)


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


@contextlib.asynccontextmanager
async def _parts(
    scenario: Scenario, folder: Path, clock: Clock, carry: Carry, bus: Transport | None, ui: Ui
) -> AsyncIterator[tuple[FrontEnd, Transport, asyncio.Task[None] | None]]:
    """What does the I/O: the front end, the bus, and whoever plays the simulated vehicles."""
    wire, epoch_ns = MemoryWire(), _epoch_ns(clock)
    loop = asyncio.get_running_loop()

    def wall_time_us() -> int:
        return (epoch_ns + round(loop.time() * 1e9)) // 1000

    async with contextlib.AsyncExitStack() as stack:
        played: asyncio.Task[None] | None = None
        front_end = await stack.enter_async_context(
            FrontEnd(wall_time_us=wall_time_us, memory={"fleet": wire})
        )
        if scenario.config.simulate is not None:
            if clock == "virtual":
                played = await stack.enter_async_context(fleet_on(wire, scenario, carry))
            else:
                # The port is ours before anybody sends to it, and a taken one is said before all else.
                endpoint = parse_url(scenario.config.simulate.url)
                await front_end.open(endpoint)
                url = f"{'udpout' if endpoint.kind == 'udpin' else 'tcpout'}://{_reachable(endpoint)}"
                played = await stack.enter_async_context(simulator.running(scenario, url, folder))
        if clock == "real":
            # The first time on a machine this compiles for some seconds: before anything listens to us.
            await asyncio.to_thread(warm_up)
        else:
            warm_up()
        communication = scenario.config.communication
        if bus is None and communication.bus == "zenoh" and clock == "real":
            bus = stack.enter_context(opened(scenario.config.name, communication.listen, ui.say))
        yield front_end, bus or MemoryBus(), played


def _members(
    scenario: Scenario,
    folder: Path,
    front_end: FrontEnd,
    network: Network,
    desk: Desk,
    observers: tuple[Any, ...],
    clock: Clock,
) -> Iterator[Member]:
    for spec, task in zip(scenario.specs, scenario.tasks, strict=True):
        endpoint = parse_url(spec.url)
        if spec.simulated and clock == "virtual":
            endpoint = Endpoint("memory", "fleet")
        inlet = _Inlet()
        link = LINKS[spec.link](
            front_end,
            endpoint,
            spec.sysid,
            name=spec.name,
            on_event=inlet,
            tlog=folder / f"{spec.name}.tlog",
        )
        runner = Runner(
            task,
            scenario.prior,
            link,
            Footprint(
                scenario.grid,
                scenario.hostiles,
                scenario.prior.sensor,
                scenario.generator(Purpose.SENSOR, spec.sysid),
            ),
            network,
            observers,
            desk=desk,
            offload=clock == "real" and scenario.grid.n_cells > OFFLOAD_CELLS,
        )
        inlet.runner = runner
        yield Member(spec, runner)


class _Inlet:
    """A link needs somebody to report to before the runner that owns it exists."""

    runner: Runner

    def __call__(self, event: Any) -> None:
        self.runner.on_link_event(event)


def _director(
    scenario: Scenario, members: Sequence[Member], ui: Ui, clock: Clock, permission: Permission
) -> Director:
    simulate = scenario.config.simulate
    speedup = simulate.speedup if simulate is not None and clock == "real" else 1.0
    return Director(
        members, scenario.config.flight, seconds_per_delay=1.0 / speedup, say=ui.say, permission=permission
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
    members: Sequence[Member], ledger: Ledger, ui: Ui, scenario: Scenario, director: Director
) -> None:
    marks: list[tuple[float, float]] = []

    def refresh() -> None:
        nonlocal marks
        clocks = [m.state.vehicle.time_boot_s for m in members]
        marks = [*marks[-20:], (time.monotonic(), max(clocks, default=0.0))]
        (t0, v0), (t1, v1) = marks[0], marks[-1]
        rows = [row(m.state, m.runner.link.age_s(), "; ".join(m.waiting_for)) for m in members]
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


def _reach(scenario: Scenario) -> int | None:
    reach = scenario.config.communication.range
    return None if reach == "all" else reach


def _epoch_ns(clock: Clock) -> int:
    """The wall time at which the loop's clock showed zero."""
    if clock == "virtual":
        return VIRTUAL_EPOCH_NS
    return time.time_ns() - round(asyncio.get_running_loop().time() * 1e9)


def _reachable(endpoint: Endpoint) -> str:
    host = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(endpoint.host, endpoint.host)
    return f"[{host}]:{endpoint.port}" if ":" in host else f"{host}:{endpoint.port}"


def _with_free_port(scenario: Scenario) -> Scenario:
    """Port 0 means any free one: the simulator has to be told which."""
    simulate = scenario.config.simulate
    if simulate is None or (endpoint := parse_url(simulate.url)).port != 0:
        return scenario
    kind = socket.SOCK_DGRAM if endpoint.kind == "udpin" else socket.SOCK_STREAM
    family = socket.AF_INET6 if ":" in endpoint.host else socket.AF_INET
    with socket.socket(family, kind) as probe:
        probe.bind((endpoint.host, 0))
        url = str(replace(endpoint, port=probe.getsockname()[1]))
    config = scenario.config
    return build(config.model_copy(update={"simulate": simulate.model_copy(update={"url": url})}))
