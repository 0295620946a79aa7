"""The composition root: a flight from its configuration to its report.

| `fly` | in |
|---|---|
| fixes the facts of the run | `run` |
| opens files, front end, bus and network | `resources` |
| builds vehicles, operator service, checks and director | `wiring` |
| runs all tasks | `task_tree` |
| returns the report | here |
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

from swarmctl.agent.state import ARRIVED, AgentState
from swarmctl.bus.transports.base import BusError, Transport
from swarmctl.config.scenario import Scenario
from swarmctl.flight.permission import Permission, PreflightFailed
from swarmctl.flight.resources import Records, open_records, open_resources
from swarmctl.flight.run import DEFAULT_OPTIONS, Clock, FlightOptions, run_of
from swarmctl.flight.simulator import SimulatorFailed
from swarmctl.flight.task_tree import run_tasks
from swarmctl.flight.wiring import Flight
from swarmctl.links.base import LinkError
from swarmctl.preflight.results import summary_of
from swarmctl.report.outcome import Ending, FlightReport, ended_by_operator
from swarmctl.report.summary import summary
from swarmctl.report.ui import Ui
from swarmctl.security.files import KeyringError

EXPECTED_ERRORS = (PreflightFailed, SimulatorFailed, LinkError, BusError, KeyringError)


async def fly(
    scenario: Scenario,
    folder: Path,
    ui: Ui,
    *,
    clock: Clock,
    permission: Permission,
    bus: Transport | None = None,
    options: FlightOptions = DEFAULT_OPTIONS,
) -> FlightReport:
    """Fly the scenario, record the flight in `folder`, and return the report.

    `bus` is an open transport; None opens the configured transport, or a bus in memory on a virtual clock.
    """
    began_s = time.monotonic()
    run = run_of(scenario, folder, ui, clock, permission, options)
    flight: Flight | None = None
    ended: Ending = "failed"
    error: Exception | None = None
    with open_records(run) as records:
        try:
            async with open_resources(run, bus, records) as resources:
                flight = Flight(run, records, resources)
                ended = await run_tasks(flight)
        except Exception as raised:  # noqa: BLE001 - the report accounts for the vehicles after any error
            error = raised
    return _report(records, flight, ended, error, time.monotonic() - began_s)


def _report(
    records: Records, flight: Flight | None, ended: Ending, error: Exception | None, wall_s: float
) -> FlightReport:
    """Return the report; `flight` is None if its parts could not be built, and `error` ended the flight."""
    failures = () if error is None else tuple(_single_errors(error))
    expected = [str(failure) for failure in failures if isinstance(failure, EXPECTED_ERRORS)]
    return FlightReport(
        ended,
        trouble=(*(line for text in expected for line in text.splitlines()), *records.trouble),
        final_states=() if flight is None else tuple(_final_states(flight, failures)),
        states={} if flight is None else _states(flight),
        statistics=records.statistics,
        summary={} if flight is None else _summary(flight, ended, wall_s),
        bug=error if len(expected) < len(failures) else None,
        checked={} if flight is None else flight.preflight.checked,
    )


def _states(flight: Flight) -> dict[int, AgentState]:
    return {vehicle.spec.sysid: vehicle.state for vehicle in flight.vehicles}


def _final_states(flight: Flight, failures: tuple[BaseException, ...]) -> Iterator[str]:
    """Yield a line for each vehicle that has not arrived."""
    simulator_failed = any(isinstance(failure, SimulatorFailed) for failure in failures)
    for vehicle in flight.vehicles:
        if simulator_failed and vehicle.spec.simulated and vehicle.state.outcome != ARRIVED:
            yield f"{vehicle.name}: ended with the simulator [simulator-ended]"
        elif vehicle.state.outcome != ARRIVED:
            yield vehicle.final_state()


def _summary(flight: Flight, ended: Ending, wall_s: float) -> dict[str, Any]:
    """Return the content of `summary.json`."""
    run, states = flight.run, _states(flight)
    reports = {vehicle.spec.sysid: vehicle.report_counts for vehicle in flight.vehicles}
    content = summary(
        run.scenario,
        states,
        flight.records.statistics,
        clock=run.clock,
        speedup=run.times.speedup,
        wall_s=wall_s if run.clock == "real" else None,
        commands=asdict(flight.operator_service.counts),
        networks=flight.resources.network.counters,
        payload_reports={uav: asdict(counts) for uav, counts in reports.items() if counts is not None},
        crossings=flight.preflight.crossings,
    )
    resumes = run.options.resumes
    content["preflight"] = summary_of(flight.preflight.checked)
    content["continues"] = None if resumes is None else resumes.folder.name
    if not run.options.flies_all:
        content["ended_by_operator"] = ended_by_operator(ended, states)
    return content


def _single_errors(error: BaseException) -> Iterator[BaseException]:
    if isinstance(error, BaseExceptionGroup):
        for part in error.exceptions:
            yield from _single_errors(part)
    else:
        yield error
