"""The run of a served fleet: signals, the live table, the logs, the first and the last line of output."""

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
MAX_HELD_WARNINGS = 20
MAX_OPEN_FILES = 10_240  # limit of open files if the system sets no hard limit


@dataclass(frozen=True, slots=True)
class ServeSettings:
    """Settings of a served fleet.

    ready_s: time from boot to a position estimate [s]; None for the time of the scenario or autopilot
    speedup: simulated seconds per second of wall time; None for the manual clock
    tlog: folder of the telemetry logs; None without logs
    """

    urls: Sequence[Url]
    port_step: int
    ready_s: float | None
    speedup: float | None
    tlog: Path | None
    table: bool
    parent_pid: int | None


def serve(scenario: Scenario, settings: ServeSettings) -> None:
    """Serve until SIGINT, SIGTERM, the end of the manual clock, or the end of the parent process.

    Raises LinkError for unusable links, and OptionError for an unusable platform, standard input or folder.
    """
    if sys.platform == "win32":
        raise OptionError(
            "a fleet can be served on Linux and macOS only, because the event loop of Windows "
            "does not support the links; use WSL on Windows"
        )
    if settings.speedup is None and sys.stdin is None:
        raise OptionError("--step: standard input is closed; open it for the `step SECONDS` lines")
    asyncio.run(_serve(scenario, settings))


class _OperatorWarnings:
    """Warnings on standard error."""

    def __init__(self) -> None:
        self._held: deque[str] | None = None

    def warn(self, text: str) -> None:
        if self._held is not None:
            self._held.append(text)
        else:
            typer.echo(f"sim_vehicle: {text}", err=True)

    def last_held(self) -> str:
        """Return the last held warning, or an empty text."""
        return self._held[-1] if self._held else ""

    @contextlib.contextmanager
    def held(self) -> Iterator[None]:
        """Hold the last 20 warnings during a table, unless standard error is redirected; then print them."""
        self._held = deque(maxlen=MAX_HELD_WARNINGS) if sys.stderr is None or sys.stderr.isatty() else None
        try:
            yield
        finally:
            held, self._held = self._held or (), None
            for text in held:
                self.warn(text)


async def _serve(scenario: Scenario, settings: ServeSettings) -> None:
    _allow_files()
    warnings = _OperatorWarnings()
    pace: Pace = ManualPace() if settings.speedup is None else RealTime(settings.speedup, warnings.warn)
    with contextlib.ExitStack() as logs:
        record = None
        if settings.tlog is not None:
            record = logs.enter_context(_recorded(settings.tlog, scenario, warnings.warn))
        server = Server(
            Fleet(scenario, ready_s=settings.ready_s),
            settings.urls,
            pace,
            warn=warnings.warn,
            port_step=settings.port_step,
            parent_pid=settings.parent_pid,
            record=record,
        )

        def print_first_lines() -> None:
            typer.echo(f"sim_vehicle: {describe_fleet(scenario)}, {server.describe_ports()}, {pace}")
            if isinstance(pace, ManualPace) and sys.stdin.isatty():
                typer.echo(f"sim_vehicle: manual clock; enter {FORMS}, for example step 0.5")

        running = asyncio.ensure_future(server.run(on_open=print_first_lines))
        loop = asyncio.get_running_loop()
        for signal_number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(signal_number, running.cancel)
        async with contextlib.AsyncExitStack() as stack:
            if isinstance(pace, ManualPace):
                # A table would cover the typed lines.
                stack.enter_context(stepped_from(sys.stdin.fileno(), pace, typer.echo, warnings.warn))
            elif settings.table and sys.stdout is not None and sys.stdout.isatty():
                await stack.enter_async_context(_table_shown(server, warnings))
            with contextlib.suppress(asyncio.CancelledError):
                await running
        typer.echo(f"sim_vehicle: {summary(server)}")


def _allow_files() -> None:
    """Raise the limit of open files, for a log of each vehicle and clients on every port."""
    import resource  # noqa: PLC0415 - Windows has no such module

    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    raised = MAX_OPEN_FILES if hard == resource.RLIM_INFINITY else hard
    if soft != resource.RLIM_INFINITY and soft < raised:
        with contextlib.suppress(OSError, ValueError):  # the present limit remains
            resource.setrlimit(resource.RLIMIT_NOFILE, (raised, hard))


@contextlib.contextmanager
def _recorded(
    folder: Path, scenario: Scenario, warn: Callable[[str], None]
) -> Iterator[Callable[[Frames, float], None]]:
    from sim_vehicle.serving.tlog import tlogs  # noqa: PLC0415 - only for --tlog

    files = contextlib.ExitStack()
    try:
        record_frame = files.enter_context(tlogs(folder, scenario.vehicles))
    except OSError as error:
        raise OptionError(
            f"--tlog {folder}: the folder cannot be written to ({error.strerror}); choose another folder"
        ) from error
    failed = False

    @contextlib.contextmanager
    def writing() -> Iterator[None]:
        nonlocal failed
        try:
            yield
        except OSError as error:
            if not failed:
                warn(f"--tlog {folder}: writing failed ({error.strerror}); the logs end early [tlog-full]")
            failed = True

    def record(frames: Frames, now: float) -> None:
        if failed:
            return
        with writing():
            for index, frame in frames:
                if frame[0] in MAVLINK_MAGIC:  # not a boot text
                    record_frame(index, frame, now)

    try:
        yield record
    finally:
        with writing():  # closing writes the buffered rest
            files.close()


@contextlib.asynccontextmanager
async def _table_shown(server: Server, warnings: _OperatorWarnings) -> AsyncIterator[None]:
    from sim_vehicle.serving.display import show_table  # noqa: PLC0415 - rich, for terminals only

    with warnings.held():
        task = asyncio.ensure_future(show_table(server, warnings.last_held))
        try:
            yield
        finally:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task


def describe_fleet(scenario: Scenario) -> str:
    """Return the fleet in words: `3 ardupilot copters and 2 px4 planes, sysid 1-5`."""
    kinds: dict[str, int] = {}
    for vehicle in scenario.vehicles:
        name = f"{vehicle.personality} {vehicle.kind}"
        kinds[name] = kinds.get(name, 0) + 1
    words = [f"{number} {name}{'s' if number > 1 else ''}" for name, number in kinds.items()]
    return f"{' and '.join(words)}, sysid {ranges(vehicle.sysid for vehicle in scenario.vehicles)}"


def summary(server: Server) -> str:
    """Return the last line: simulated time, messages, lateness, lost time."""
    counters = server.fleet.counters
    words = [
        f"{server.simulated_s:.1f} s simulated",
        f"{sum(server.sent)} messages sent ({server.dropped} datagrams dropped)",
        f"{counters.messages_in} received",
    ]
    if server.lateness.count:
        p50_ms, p99_ms = (1000 * server.lateness.quantile_s(share) for share in (0.5, 0.99))
        words.append(f"heartbeats late by {p50_ms:.1f} ms (p50), {p99_ms:.1f} ms (p99)")
    if server.pace.lost_s:
        words.append(f"{server.pace.lost_s:.1f} s of wall time lost because the machine was too slow")
    return ", ".join(words)
