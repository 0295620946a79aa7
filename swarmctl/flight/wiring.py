"""The wiring of a flight: vehicles, operator service, preflight checks, director."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from swarmctl.bus.external_observations import ReportReceiver
from swarmctl.bus.sensor_reports import MANUAL_SOURCE, ReportedCells
from swarmctl.config.scenario import RandomStream
from swarmctl.config.specs import Spec
from swarmctl.core import events as ev
from swarmctl.flight.director import Director
from swarmctl.flight.operator_orders import operator_service_for
from swarmctl.flight.own_vehicle import OwnVehicle
from swarmctl.flight.resources import FlightResources, Records
from swarmctl.flight.run import Run
from swarmctl.flight.runner import Runner
from swarmctl.flight.takeover import Takeover
from swarmctl.links import LINKS
from swarmctl.links.base import LinkEvent
from swarmctl.links.direct import DirectLink
from swarmctl.mavlink.telemetry.streams import Streaming
from swarmctl.preflight.collection import FactCollector
from swarmctl.preflight.conversation import Preflight
from swarmctl.preflight.results import CheckResult
from swarmctl.sensors import SOURCES

OFFLOAD_CELLS = 100_000
"""number of cells above which, in real time, a thread searches the area while the loop serves the links"""


class Flight:
    """The parts of one flight, each built from the parts before it."""

    def __init__(self, run: Run, records: Records, resources: FlightResources) -> None:
        self.run = run
        self.records = records
        self.resources = resources
        self.vehicles = tuple(map(self._vehicle, range(len(run.scenario.specs))))
        self.operator_service = operator_service_for(
            run.scenario,
            resources.transport,
            run.ui.say,
            self.vehicles,
            flies_all=run.options.flies_all,
            has_keys=run.options.frame_codec is not None,
            authentication=resources.token_authentication or run.options.authentication,
        )
        may_set, is_check_only = run.scenario.config.preflight.set_parameters, run.options.launch == "never"
        collector = FactCollector(
            run.scenario,
            unix_s_at_zero=run.times.unix_s_at_zero,
            speedup=run.times.speedup,
            free_clocks=run.clock == "real",
            fly_may_set=may_set and is_check_only,
            say=run.ui.say,
        )
        self.preflight = Preflight(
            collector,
            run.options.waivers,
            say=run.ui.say,
            on_waived=self._record_waiver,
            sets_parameters=may_set and not is_check_only,
        )
        self.director = Director(
            self.vehicles,
            run.scenario.config.flight,
            seconds_per_delay=1.0 / run.times.speedup,
            say=run.ui.say,
            permission=self._permit,
            clearance=self.preflight,
            launch=run.options.launch,
            flies_all=run.options.flies_all,
            takeover=self._takeover(),
        )

    def _vehicle(self, index: int) -> OwnVehicle:
        """Return a vehicle with its link, its sensor and its agent."""
        run, scenario, spec = self.run, self.run.scenario, self.run.scenario.specs[index]
        source, recorded = SOURCES[scenario.config.sensor.source], run.recorded.get(spec.sysid)
        rng = scenario.generator(RandomStream.SENSOR, spec.sysid)
        runner = Runner(
            scenario.tasks[index],
            scenario.prior,
            partial(self._open_link, spec),
            source.sensor(scenario.grid, scenario.hostiles, scenario.prior.sensor, rng),
            self.resources.network,
            self.records.observers,
            offload=run.clock == "real" and scenario.grid.n_cells > OFFLOAD_CELLS,
            recorded=None if recorded is None else recorded.state,
        )
        if recorded is not None:
            self.resources.network.restore(spec.sysid, recorded.observations)
        if not source.external:
            return OwnVehicle(spec, runner)
        receiver = ReportReceiver(
            self.resources.transport,
            scenario.config.name,
            spec.sysid,
            scenario.grid,
            run.times.unix_s,
            partial(self._observed, runner),
            lambda text: run.ui.say(f"{spec.name}: {text}"),
            tolerance_s=scenario.config.communication.clock_tolerance_s,
            authentication=self.resources.token_authentication or run.options.report_authentication,
        )
        return OwnVehicle(spec, runner, receiver.counts)

    def _open_link(self, spec: Spec, on_event: Callable[[LinkEvent], None]) -> DirectLink:
        scenario = self.run.scenario
        links, formation = scenario.config.links, scenario.formation_of(spec.sysid)
        position_hz = links.position_hz
        if formation is not None:
            position_hz = max(formation.rate_hz, position_hz or 0.0)  # each position brings a set-point
        return LINKS[spec.link].open(
            self.resources.front_end,
            self.run.endpoint(spec),
            spec.sysid,
            name=spec.name,
            on_event=on_event,
            tlog=self.run.folder / f"{spec.name}.tlog",
            streaming=Streaming(position_hz, links.stop_other_streams),
        )

    def _observed(self, runner: Runner, cells: ReportedCells, source: str) -> None:
        """Pass a payload's report to its vehicle's agent."""
        text = f"{source or 'a payload'} reports {'1 cell' if len(cells) == 1 else f'{len(cells)} cells'}"
        runner.note(text)
        if source == MANUAL_SOURCE:
            self.records.evidence.operator("observe", runner.name, cells=cells)
        runner.post(ev.Observed(cells))

    def _record_waiver(self, waived: CheckResult) -> None:
        self.records.evidence.waived(waived.vehicle, waived.check, f"found {waived.finding.found}")

    def _permit(self, external: Sequence[OwnVehicle]) -> None:
        """Ask for the permission to arm, and record the operator's answer."""
        self.run.permission(external)
        for vehicle in external:
            firmware = vehicle.identity.firmware if vehicle.identity is not None else None
            self.records.evidence.operator(
                "permits arming", vehicle.name, firmware=firmware, url=vehicle.spec.url
            )

    def _takeover(self) -> Takeover | None:
        run = self.run
        if run.options.resumes is None:
            return None
        return Takeover(
            run.recorded,
            run.scenario.config.flight,
            unix_s=run.times.unix_s,
            speedup=run.times.speedup,
            say=run.ui.say,
        )
