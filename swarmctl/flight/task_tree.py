"""The tasks of a flight: agents, director, simulator, display, and the signal handlers."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import time
from collections.abc import Callable, Coroutine, Iterator, Sequence
from typing import Any, Literal

from swarmctl.bus.network import Network
from swarmctl.config.scenario import Scenario
from swarmctl.core.operator_text import extended
from swarmctl.flight import simulator
from swarmctl.flight.director import Director
from swarmctl.flight.member import Member
from swarmctl.flight.supervise import cancelled
from swarmctl.report.evidence.log import Evidence
from swarmctl.report.live_rows import SwarmView, vehicle_row
from swarmctl.report.summary import FlightStatistics
from swarmctl.report.ui import Ui

REFRESH_S = 0.25
"""time between two updates of the user interface"""


async def run_tasks(
    director: Director,
    members: Sequence[Member],
    simulator_task: asyncio.Task[None] | None,
    ui: Ui,
    show: Callable[[], Coroutine[Any, Any, None]],
    evidence: Evidence,
) -> Literal["ended", "stopped", "abandoned"]:
    """Run all tasks of a flight in one group until the director ends; "abandoned": after a second signal."""
    abandoned = False
    async with asyncio.TaskGroup() as tasks:
        helpers = [tasks.create_task(m.runner.run()) for m in members]
        helpers.append(tasks.create_task(show()))
        helpers.append(tasks.create_task(_watch_callbacks()))
        if simulator_task is not None:
            helpers.append(tasks.create_task(_watch_simulator(simulator_task, members, ui)))
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


async def _watch_callbacks() -> None:
    """Raise the first exception of a callback: asyncio would only log it, but a bug stops the flight."""
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


async def _watch_simulator(simulator_task: asyncio.Task[None], members: Sequence[Member], ui: Ui) -> None:
    try:
        await asyncio.shield(simulator_task)
    except simulator.SimulatorFailed as error:
        if all(m.spec.simulated for m in members):
            raise
        ui.say(extended(str(error), "; the vehicles that are not simulated fly on"))


@contextlib.contextmanager
def _signals(interrupted: Callable[[], None]) -> Iterator[None]:
    """Call `interrupted` on SIGINT, SIGTERM and SIGHUP."""
    loop = asyncio.get_running_loop()
    signals = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    try:
        for number in signals:
            loop.add_signal_handler(number, interrupted)
    except (ValueError, RuntimeError):  # only the main thread can handle signals
        yield
        return
    try:
        yield
    finally:
        for number in signals:
            loop.remove_signal_handler(number)


async def show(
    members: Sequence[Member],
    statistics: FlightStatistics,
    ui: Ui,
    scenario: Scenario,
    director: Director,
    network: Network,
) -> None:
    """Refresh the user interface several times a second until cancelled, and once more at the end."""
    samples: list[tuple[float, float]] = []  # (wall time, latest vehicle clock) [s]

    def refresh() -> None:
        nonlocal samples
        clocks = [m.state.vehicle.time_boot_s for m in members if not m.runner.is_untaken]
        samples = [*samples[-20:], (time.monotonic(), max(clocks, default=0.0))]
        (t0, v0), (t1, v1) = samples[0], samples[-1]
        rows = [
            vehicle_row(
                m.state,
                m.runner.link.age_s(),
                "; ".join(m.waiting_for) if m.is_overdue else "",
                network.counters(m.spec.sysid).refused.total(),
                lost_timeout_s=scenario.config.flight.lost_timeout_s,
            )
            for m in members
        ]
        speed = (v1 - v0) / (t1 - t0) if t1 > t0 and v0 > 0.0 else None
        flown_s = statistics.longest_flight_s
        ui.refresh(SwarmView(scenario.config.name, flown_s, speed, rows, director.on_ctrl_c))

    try:
        while True:
            refresh()
            await asyncio.sleep(REFRESH_S)
    finally:
        refresh()
