"""A fleet on its links until somebody ends it: signals, the table, the first line and the last."""

import asyncio
import contextlib
import os
import resource
import signal
import sys
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import typer

from sim_vehicle.fleet import Fleet
from sim_vehicle.ranges import ranges
from sim_vehicle.scenario import Scenario
from sim_vehicle.serving.hand import stepped_from
from sim_vehicle.serving.options import OptionError
from sim_vehicle.serving.pace import ByHand, Pace, RealTime
from sim_vehicle.serving.server import Server
from sim_vehicle.url import Url
from sim_vehicle.wire.outbox import Frames

MAVLINK_MAGIC = b"\xfd\xfe"
SPARE_FILES = 64


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
    """Run until SIGINT, SIGTERM, the end of time by hand, or of the parent; LinkError for bad links."""
    asyncio.run(_serve(scenario, how))


async def _serve(scenario: Scenario, how: Serving) -> None:
    _allow_files(len(scenario.vehicles) * (len(how.urls) + 1))
    with contextlib.ExitStack() as around:
        record = None if how.tlog is None else around.enter_context(_recorded(how.tlog, scenario))
        await _run(scenario, how, record)


async def _run(scenario: Scenario, how: Serving, record: Callable[[Frames, float], None] | None) -> None:
    pace: Pace = ByHand() if how.speedup is None else RealTime(how.speedup, _warn)
    server = Server(
        Fleet(scenario, ready_s=how.ready_s),
        how.urls,
        pace,
        warn=_warn,
        port_step=how.port_step,
        parent_pid=how.parent_pid,
        record=record,
    )
    running = asyncio.ensure_future(
        server.run(
            on_open=lambda: _say(f"sim_vehicle: {fleet_words(scenario)}, {server.ports_words()}, {pace}")
        )
    )
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, running.cancel)
    async with contextlib.AsyncExitStack() as around:
        if isinstance(pace, ByHand):
            around.enter_context(stepped_from(sys.stdin.fileno(), pace, _say, _warn))
        if how.table and sys.stdout.isatty():
            await around.enter_async_context(_shown(server))
        with contextlib.suppress(asyncio.CancelledError):
            await running
    _say(f"sim_vehicle: {summary(server)}")


def _allow_files(count: int) -> None:
    """A socket, and a log, a vehicle may be more than a process is allowed at first."""
    allowed, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    if allowed != resource.RLIM_INFINITY and allowed < count + SPARE_FILES:
        wanted = count + SPARE_FILES if most == resource.RLIM_INFINITY else min(count + SPARE_FILES, most)
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, most))


def _say(text: str) -> None:
    try:
        typer.echo(text)
    except BrokenPipeError:  # whoever read our lines has left; the ground stations have not
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _warn(text: str) -> None:
    with contextlib.suppress(BrokenPipeError):
        typer.echo(f"sim_vehicle: {text}", err=True)


@contextlib.contextmanager
def _recorded(folder: Path, scenario: Scenario) -> Iterator[Callable[[Frames, float], None]]:
    from sim_vehicle.run.report import tlogs  # noqa: PLC0415 - only where it is asked for

    with contextlib.ExitStack() as files:
        try:
            heard = files.enter_context(tlogs(folder, scenario.vehicles))
        except OSError as error:
            raise OptionError(
                f"--tlog {folder}: cannot be written to ({error.strerror}); choose another folder"
            ) from error

        def record(frames: Frames, now: float) -> None:
            for index, frame in frames:
                if frame[0] in MAVLINK_MAGIC:  # and no boot text
                    heard(index, frame, now)

        yield record


@contextlib.asynccontextmanager
async def _shown(server: Server) -> AsyncIterator[None]:
    from sim_vehicle.serving.display import showing  # noqa: PLC0415 - rich, for terminals only

    task = asyncio.ensure_future(showing(server))
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
