"""A fleet on its links until somebody ends it: signals, the table, the first line and the last."""

import asyncio
import contextlib
import signal
import sys
from collections import deque
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import typer

from sim_vehicle.fleet import Fleet
from sim_vehicle.links.url import Url
from sim_vehicle.ranges import ranges
from sim_vehicle.scenarios import Scenario
from sim_vehicle.serving.manual_clock import FORMS, stepped_from
from sim_vehicle.serving.options import OptionError
from sim_vehicle.serving.pace import ByHand, Pace, RealTime
from sim_vehicle.serving.server import Server
from sim_vehicle.wire.outbox import Frames

MAVLINK_MAGIC = b"\xfd\xfe"
MOST_WAITING = 20  # warnings
MANY_FILES = 10_240  # where there is no limit, a system has one all the same


@dataclass(frozen=True, slots=True)
class Serving:
    """How a fleet is served: `speedup` None: by hand; `ready_s` None: the scenario's or the autopilot's."""

    urls: Sequence[Url]
    port_step: int
    ready_s: float | None
    speedup: float | None
    tlog: Path | None
    table: bool
    parent_pid: int | None


def serve(scenario: Scenario, how: Serving) -> None:
    """Run until SIGINT, SIGTERM, the end of time by hand, or of the parent.

    LinkError for bad links, OptionError for what else cannot be done here.
    """
    if sys.platform == "win32":
        raise OptionError(
            "a fleet is served on Linux and macOS only: the event loop of Windows cannot wait for its links"
        )
    if how.speedup is None and sys.stdin is None:
        raise OptionError("--step: standard input, from which `step SECONDS` would be read, is closed")
    asyncio.run(_serve(scenario, how))


class _Lines:
    """What is said to whoever runs the fleet; while a table has their screen, warnings wait for its end."""

    def __init__(self) -> None:
        self._waiting: deque[str] | None = None

    def warn(self, text: str) -> None:
        if self._waiting is not None:
            self._waiting.append(text)
        else:
            typer.echo(f"sim_vehicle: {text}", err=True)

    def last(self) -> str:
        """The last warning that waits, if one does."""
        return self._waiting[-1] if self._waiting else ""

    @contextlib.contextmanager
    def behind_a_table(self) -> Iterator[None]:
        """Warnings wait only if it is the same terminal that would show them."""
        self._waiting = deque(maxlen=MOST_WAITING) if sys.stderr is None or sys.stderr.isatty() else None
        try:
            yield
        finally:
            waiting, self._waiting = self._waiting or (), None
            for text in waiting:
                self.warn(text)


async def _serve(scenario: Scenario, how: Serving) -> None:
    _allow_files()
    lines = _Lines()
    with contextlib.ExitStack() as around:
        record = None if how.tlog is None else around.enter_context(_recorded(how.tlog, scenario, lines.warn))
        await _run(scenario, how, record, lines)


async def _run(
    scenario: Scenario, how: Serving, record: Callable[[Frames, float], None] | None, lines: _Lines
) -> None:
    pace: Pace = ByHand() if how.speedup is None else RealTime(how.speedup, lines.warn)
    server = Server(
        Fleet(scenario, ready_s=how.ready_s),
        how.urls,
        pace,
        warn=lines.warn,
        port_step=how.port_step,
        parent_pid=how.parent_pid,
        record=record,
    )

    def opened() -> None:
        typer.echo(f"sim_vehicle: {fleet_words(scenario)}, {server.ports_words()}, {pace}")
        if isinstance(pace, ByHand) and sys.stdin.isatty():
            typer.echo(f"sim_vehicle: time stands still; type {FORMS}, for example step 0.5")

    running = asyncio.ensure_future(server.run(on_open=opened))
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, running.cancel)
    async with contextlib.AsyncExitStack() as around:
        if isinstance(pace, ByHand):
            # No table, which would cover what is typed and answered.
            around.enter_context(stepped_from(sys.stdin.fileno(), pace, typer.echo, lines.warn))
        elif how.table and sys.stdout is not None and sys.stdout.isatty():
            await around.enter_async_context(_shown(server, lines))
        with contextlib.suppress(asyncio.CancelledError):
            await running
    typer.echo(f"sim_vehicle: {summary(server)}")


def _allow_files() -> None:
    """A log a vehicle and clients on every port may be more than a process is allowed at first."""
    import resource  # noqa: PLC0415 - Windows has none

    allowed, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = MANY_FILES if most == resource.RLIM_INFINITY else most
    if allowed != resource.RLIM_INFINITY and allowed < wanted:
        with contextlib.suppress(OSError, ValueError):  # then what there is has to do
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, most))


@contextlib.contextmanager
def _recorded(
    folder: Path, scenario: Scenario, warn: Callable[[str], None]
) -> Iterator[Callable[[Frames, float], None]]:
    from sim_vehicle.scenarios.report import tlogs  # noqa: PLC0415 - only where it is asked for

    files = contextlib.ExitStack()
    try:
        heard = files.enter_context(tlogs(folder, scenario.vehicles))
    except OSError as error:
        raise OptionError(
            f"--tlog {folder}: cannot be written to ({error.strerror}); choose another folder"
        ) from error
    full = False

    @contextlib.contextmanager
    def writing() -> Iterator[None]:
        nonlocal full
        try:
            yield
        except OSError as error:
            if not full:
                warn(f"--tlog {folder}: not all could be written ({error.strerror}); the logs end early")
            full = True

    def record(frames: Frames, now: float) -> None:
        if full:
            return
        with writing():
            for index, frame in frames:
                if frame[0] in MAVLINK_MAGIC:  # and no boot text
                    heard(index, frame, now)

    try:
        yield record
    finally:
        with writing():  # what is left in the buffers
            files.close()


@contextlib.asynccontextmanager
async def _shown(server: Server, lines: _Lines) -> AsyncIterator[None]:
    from sim_vehicle.serving.display import showing  # noqa: PLC0415 - rich, for terminals only

    with lines.behind_a_table():
        task = asyncio.ensure_future(showing(server, lines.last))
        try:
            yield
        finally:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task


def fleet_words(scenario: Scenario) -> str:
    """`3 ardupilot copters and 2 px4 planes, sysid 1-5`."""
    kinds: dict[str, int] = {}
    for vehicle in scenario.vehicles:
        name = f"{vehicle.personality} {vehicle.kind}"
        kinds[name] = kinds.get(name, 0) + 1
    words = [f"{number} {name}{'s' if number > 1 else ''}" for name, number in kinds.items()]
    return f"{' and '.join(words)}, sysid {ranges(vehicle.sysid for vehicle in scenario.vehicles)}"


def summary(server: Server) -> str:
    """The last line: how far it came, what was said, and how punctually."""
    counters = server.fleet.counters
    words = [
        f"{server.simulated_s:.1f} s simulated",
        f"{sum(server.sent)} messages sent ({server.dropped} datagrams dropped)",
        f"{counters.messages_in} received",
    ]
    if server.lateness.count:
        half, most = (1000 * server.lateness.quantile_s(share) for share in (0.5, 0.99))
        words.append(f"heartbeats late by {half:.1f} ms (p50), {most:.1f} ms (p99)")
    if server.pace.lost_s:
        words.append(f"{server.pace.lost_s:.1f} s lost because the machine was too slow")
    return ", ".join(words)
