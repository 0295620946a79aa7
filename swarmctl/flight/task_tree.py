"""The tasks of a flight, the signal handlers, and the orders in an emergency.

| task | ends |
|---|---|
| `_simulate`: the simulated vehicles | last, because emergency orders need them |
| `Runner.run`, one for each vehicle: its agent | with the director |
| `_show`: the display | with the director |
| `_watch_callbacks`, `_watch_simulator`, `watch_bus`: errors from elsewhere | with the director |
| `_direct`: the director, with tasks for the vehicles on the ground | after the flight, or a shutdown |

An error in one task ends them all.
"""

from __future__ import annotations

import asyncio
import contextlib
import signal
import time
from collections.abc import Callable, Iterator
from typing import Any

from swarmctl.core.events import FlightOrder
from swarmctl.core.operator_text import extended
from swarmctl.flight import emergency
from swarmctl.flight.simulator import SimulatorFailed, run_simulator
from swarmctl.flight.wiring import Flight
from swarmctl.planners import warm_up
from swarmctl.report.live_rows import SwarmView, vehicle_row
from swarmctl.report.outcome import Ending

REFRESH_S = 0.25
"""time between two updates of the user interface"""
VIRTUAL_PAUSES = 4
"""number of such times between two updates on the virtual clock, where a second passes in some hundredths"""


async def run_tasks(flight: Flight) -> Ending:
    """Run all tasks of a flight until its director ends; return the kind of end.

    After a failure or an abandoned flight, armed vehicles get the order `on_exit`.
    """
    async with asyncio.TaskGroup() as tasks:
        simulating = tasks.create_task(_simulate(flight))
        await _load_planner(flight)
        try:
            ended = await _run_agents(flight, simulating)
        except Exception:
            await _in_emergency(flight, simulating, at_once=False)
            raise
        if ended == "abandoned":
            await _in_emergency(flight, simulating, at_once=True)
        simulating.cancel()
    return ended


async def _run_agents(flight: Flight, simulating: asyncio.Task[Exception | None]) -> Ending:
    async with asyncio.TaskGroup() as tasks:
        helpers = [tasks.create_task(vehicle.runner.run()) for vehicle in flight.vehicles]
        helpers.append(tasks.create_task(_show(flight)))
        helpers.append(tasks.create_task(_watch_callbacks()))
        helpers.append(tasks.create_task(_watch_simulator(flight, simulating)))
        if (watch_bus := flight.run.options.watch_bus) is not None:
            helpers.append(tasks.create_task(watch_bus()))
        ended = await _direct(flight, tasks)
        for helper in helpers:
            helper.cancel()
    return ended


async def _direct(flight: Flight, tasks: asyncio.TaskGroup) -> Ending:
    """Run the director; the first signal begins the shutdown, and the second signal ends it at once."""
    n_signals = 0

    def interrupted() -> None:
        nonlocal n_signals
        n_signals += 1
        asks = "end of the flight" if n_signals == 1 else "leave at once"
        flight.records.evidence.operator(asks, by="signal")
        directing.cancel()

    directing = tasks.create_task(flight.director.fly())
    with _signals(interrupted):
        await asyncio.wait({directing})
        if not directing.cancelled():
            return "ended"
        if n_signals < 2:
            directing = tasks.create_task(flight.director.shut_down())
            await asyncio.wait({directing})
    return "stopped" if n_signals < 2 else "abandoned"


async def _simulate(flight: Flight) -> Exception | None:
    """Run the simulated vehicles until cancelled; return an error that ends them early."""
    try:
        if flight.run.simulated:
            await _run_simulator(flight)
    except Exception as error:  # noqa: BLE001 - `_watch_simulator` raises the error
        return error
    return None


async def _watch_simulator(flight: Flight, simulating: asyncio.Task[Exception | None]) -> None:
    """Raise the error that ends the simulator; a failed simulator does not end a flight of real vehicles."""
    error = await asyncio.shield(simulating)
    if isinstance(error, SimulatorFailed) and len(flight.run.simulated) < len(flight.vehicles):
        flight.run.ui.say(extended(str(error), "; the vehicles that are not simulated fly on"))
    elif error is not None:
        raise error


async def _run_simulator(flight: Flight) -> None:
    run, resources = flight.run, flight.resources
    if run.clock == "virtual":
        # The simulator is another package, and only the virtual clock needs it here.
        from swarmctl.flight import virtual_simulator  # noqa: PLC0415

        simulate = run.options.simulate or virtual_simulator.simulate
        await simulate(resources.wire, run.scenario)
        return
    endpoint = run.endpoint(run.simulated[0])

    def has_unprocessed() -> bool:
        is_behind = any(vehicle.runner.is_behind for vehicle in flight.vehicles)
        return is_behind or resources.front_end.has_unread(endpoint)

    await run_simulator(run.scenario, endpoint, run.folder, has_unprocessed)


async def _load_planner(flight: Flight) -> None:
    """Load machine code that the planners need. This takes a second, too long for a pause in flight."""
    if not flight.run.scenario.config.needs_machine_code:
        return
    if flight.run.clock == "real":
        await asyncio.to_thread(warm_up)
    else:
        warm_up()


async def _in_emergency(flight: Flight, simulating: asyncio.Task[Exception | None], *, at_once: bool) -> None:
    """Order the armed vehicles; simulated vehicles whose simulator has ended get no order."""
    section, say = flight.run.scenario.config.flight, flight.run.ui.say
    reachable = [m for m in flight.vehicles if not (m.spec.simulated and simulating.done())]
    order = FlightOrder(section.on_exit)
    if at_once:
        await emergency.at_once("the operator ends the program at once", reachable, order, say)
    else:
        within_s, speedup = section.on_exit_deadline_s, flight.run.times.speedup
        why = "the flight has failed"
        await emergency.in_turns(why, reachable, order, say, within_s=within_s, speedup=speedup)


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


async def _show(flight: Flight) -> None:
    """Refresh the user interface several times a second until cancelled, and once more at the end."""
    samples: list[tuple[float, float]] = []  # (wall time, latest vehicle clock) [s]
    config, statistics = flight.run.scenario.config, flight.records.statistics
    n_pauses = VIRTUAL_PAUSES if flight.run.clock == "virtual" else 1

    def refresh() -> None:
        nonlocal samples
        clocks = [m.state.vehicle.time_boot_s for m in flight.vehicles if not m.runner.is_untaken]
        samples = [*samples[-20:], (time.monotonic(), max(clocks, default=0.0))]
        (t0, v0), (t1, v1) = samples[0], samples[-1]
        counters = flight.resources.network.counters
        rows = [
            vehicle_row(
                m.state,
                m.runner.link.age_s(),
                m.overdue_because,
                counters[m.spec.sysid].refused.total(),
                lost_timeout_s=config.flight.lost_timeout_s,
            )
            for m in flight.vehicles
        ]
        speed = (v1 - v0) / (t1 - t0) if t1 > t0 and v0 > 0.0 else None
        view = SwarmView(config.name, statistics.longest_flight_s, speed, rows, flight.director.on_ctrl_c)
        flight.run.ui.refresh(view)

    try:
        while True:
            refresh()
            for _ in range(n_pauses):
                await asyncio.sleep(REFRESH_S)
    finally:
        refresh()
