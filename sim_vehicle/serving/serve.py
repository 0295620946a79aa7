"""A served fleet: signals, the live table, the first and the last line of output."""

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
from sim_vehicle.serving.pace import ManualPace, Pace, RealTime
from sim_vehicle.serving.server import Server
from sim_vehicle.wire.outbox import Frames

MAVLINK_MAGIC = b"\xfd\xfe"
MOST_WAITING = 20  # most warnings kept behind a table
MANY_FILES = 10_240  # limit used where the system reports none


@dataclass(frozen=True, slots=True)
class Serving:
    """Settings of serving; `speedup` None: manual clock; `ready_s` None: the scenario's or autopilot's."""

    urls: Sequence[Url]
    port_step: int
    ready_s: float | None
    speedup: float | None
    tlog: Path | None
    table: bool
    parent_pid: int | None


def serve(scenario: Scenario, how: Serving) -> None:
    """Serve until SIGINT, SIGTERM, the end of manual time, or the end of the parent process.

    LinkError for bad links, OptionError for other problems.
    """
    if sys.platform == "win32":
        raise OptionError(
            "a fleet is served on Linux and macOS only: the event loop of Windows cannot wait for its links"
        )
    if how.speedup is None and sys.stdin is None:
        raise OptionError("--step: standard input is closed, but the `step SECONDS` lines come from it")
    asyncio.run(_serve(scenario, how))


class _Lines:
    """Lines to the operator; behind a live table warnings wait for its end."""

    def __init__(self) -> None:
        self._waiting: deque[str] | None = None

    def warn(self, text: str) -> None:
        if self._waiting is not None:
            self._waiting.append(text)
        else:
            typer.echo(f"sim_vehicle: {text}", err=True)

    def last(self) -> str:
        """Return the last waiting warning, or an empty text."""
        return self._waiting[-1] if self._waiting else ""

    @contextlib.contextmanager
    def behind_a_table(self) -> Iterator[None]:
        """Hold warnings back if they would appear on the table's terminal."""
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
    pace: Pace = ManualPace() if how.speedup is None else RealTime(how.speedup, lines.warn)
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
        if isinstance(pace, ManualPace) and sys.stdin.isatty():
            typer.echo(f"sim_vehicle: manual clock; enter {FORMS}, for example step 0.5")

    running = asyncio.ensure_future(server.run(on_open=opened))
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, running.cancel)
    async with contextlib.AsyncExitStack() as around:
        if isinstance(pace, ManualPace):
            # No table, because it would cover the typed lines.
            around.enter_context(stepped_from(sys.stdin.fileno(), pace, typer.echo, lines.warn))
        elif how.table and sys.stdout is not None and sys.stdout.isatty():
            await around.enter_async_context(_shown(server, lines))
        with contextlib.suppress(asyncio.CancelledError):
            await running
    typer.echo(f"sim_vehicle: {summary(server)}")


def _allow_files() -> None:
    """Raise the limit of open files: one log a vehicle, and clients on every port."""
    import resource  # noqa: PLC0415 - Windows has none

    allowed, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = MANY_FILES if most == resource.RLIM_INFINITY else most
    if allowed != resource.RLIM_INFINITY and allowed < wanted:
        with contextlib.suppress(OSError, ValueError):  # the present limit remains
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, most))


@contextlib.contextmanager
def _recorded(
    folder: Path, scenario: Scenario, warn: Callable[[str], None]
) -> Iterator[Callable[[Frames, float], None]]:
    from sim_vehicle.serving.tlog import tlogs  # noqa: PLC0415 - only where it is asked for

    files = contextlib.ExitStack()
    try:
        record_frame = files.enter_context(tlogs(folder, scenario.vehicles))
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
                warn(
                    f"--tlog {folder}: not all was written ({error.strerror}); the logs end early [tlog-full]"
                )
            full = True

    def record(frames: Frames, now: float) -> None:
        if full:
            return
        with writing():
            for index, frame in frames:
                if frame[0] in MAVLINK_MAGIC:  # boot text is no frame
                    record_frame(index, frame, now)

    try:
        yield record
    finally:
        with writing():  # the buffered rest
            files.close()


@contextlib.asynccontextmanager
async def _shown(server: Server, lines: _Lines) -> AsyncIterator[None]:
    from sim_vehicle.serving.display import show_table  # noqa: PLC0415 - rich, for terminals only

    with lines.behind_a_table():
        task = asyncio.ensure_future(show_table(server, lines.last))
        try:
            yield
        finally:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task


def fleet_words(scenario: Scenario) -> str:
    """Return the fleet in words: `3 ardupilot copters and 2 px4 planes, sysid 1-5`."""
    kinds: dict[str, int] = {}
    for vehicle in scenario.vehicles:
        name = f"{vehicle.personality} {vehicle.kind}"
        kinds[name] = kinds.get(name, 0) + 1
    words = [f"{number} {name}{'s' if number > 1 else ''}" for name, number in kinds.items()]
    return f"{' and '.join(words)}, sysid {ranges(vehicle.sysid for vehicle in scenario.vehicles)}"


def summary(server: Server) -> str:
    """Return the last line: simulated time, messages, lateness."""
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
