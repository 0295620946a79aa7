"""The collector of facts, from vehicles' answers over their links and from the configuration."""

from __future__ import annotations

import asyncio
import math
import statistics
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Protocol

from swarmctl.agent.phases import IN_FLIGHT, ON_GROUND, Phase
from swarmctl.agent.replan.copter_trajectory import from_takeoff
from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.separation.trajectory import Trajectory
from swarmctl.config.scenario import Scenario, separation_of
from swarmctl.config.specs import Spec
from swarmctl.core.mission import FlightPlan
from swarmctl.links.base import LinkError
from swarmctl.links.direct import DirectLink
from swarmctl.mavlink.events import Identity
from swarmctl.mavlink.firmware import firmware_of
from swarmctl.mavlink.telemetry.instruments import Instruments
from swarmctl.preflight.checks.battery import SIMULATED_ENDURANCE_S
from swarmctl.preflight.declared import declared_behaviour
from swarmctl.preflight.facts import Answers, OtherVehicle, PreflightFacts
from swarmctl.preflight.inspection import inspect
from swarmctl.preflight.policy import NoParameterTable, RequiredParameter, parameters_for
from swarmctl.preflight.policy.required import corrections

RequiredParameters = tuple[tuple[RequiredParameter, ...], str]
"""the required parameters of a vehicle, and the reason as text if they are unknown"""


class ConnectedAgent(Protocol):
    """The link of a vehicle, and the state of its agent."""

    @property
    def link(self) -> DirectLink: ...
    @property
    def state(self) -> AgentState: ...
    @property
    def sysid_conflict(self) -> str:
        """A second vehicle with the same system id, as text; empty if there is none."""


class VehicleToCheck(Protocol):
    """A vehicle of this process."""

    @property
    def spec(self) -> Spec: ...
    @property
    def runner(self) -> ConnectedAgent: ...
    @property
    def identity(self) -> Identity | None: ...
    @property
    def not_ready_because(self) -> str:
        """The reason why the vehicle cannot be made ready, as text; empty if there is none."""


class FactCollector:
    """The collector of one run's facts; the collector keeps every vehicle's last trajectory and clock.

    unix_s_at_zero: wall time at which the clock of the running loop showed 0 [s]
    speedup: simulated seconds in a second of the loop's clock
    free_clocks: True if the dates of simulated vehicles differ from this machine's date
    fly_may_set: True in a run of checks only, if `fly` will set parameters
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        unix_s_at_zero: float,
        speedup: float,
        free_clocks: bool,
        fly_may_set: bool,
        say: Callable[[str], None],
    ) -> None:
        self._scenario = scenario
        self._unix_s_at_zero = unix_s_at_zero
        self._speedup = speedup
        self._free_clocks = free_clocks
        self._fly_may_set = fly_may_set
        self._say = say
        self.fence_polygon = scenario.fence_polygon
        self.limits = separation_of(scenario.config).limits
        self.trajectories: dict[str, Trajectory | None] = {}
        """positions over time on the first routes of this process's vehicles; None: unknown"""
        self._instruments: dict[str, Instruments] = {}

    async def collect(
        self, vehicles: Sequence[VehicleToCheck], everyone: Sequence[VehicleToCheck]
    ) -> list[PreflightFacts]:
        """Return the facts of `vehicles`; `everyone` are all vehicles of this process."""
        required_of = [self.required_parameters(vehicle) for vehicle in vehicles]
        answers_of = await asyncio.gather(*map(self._ask, vehicles, required_of))
        # The first route begins at the take-off position, so a vehicle in the air keeps its last trajectory.
        standing = ON_GROUND | {Phase.LAUNCHING}
        self.trajectories |= {
            v.spec.name: _trajectory(v) for v in everyone if v.runner.state.phase in standing
        }
        for vehicle, answers in zip(vehicles, answers_of, strict=True):
            self._instruments[vehicle.spec.name] = answers.instruments
        asked = zip(vehicles, required_of, answers_of, strict=True)
        return [self._facts(vehicle, everyone, required, found) for vehicle, required, found in asked]

    def required_parameters(self, vehicle: VehicleToCheck) -> RequiredParameters:
        if vehicle.identity is None:
            return (), "unknown firmware: AUTOPILOT_VERSION has not arrived"
        try:
            firmware = firmware_of(vehicle.identity)
            return parameters_for(firmware, declared_behaviour(self._scenario, vehicle.spec)), ""
        except NoParameterTable as error:
            return (), str(error)

    async def _ask(self, vehicle: VehicleToCheck, required: RequiredParameters) -> Answers:
        """Return the answers of a vehicle; none after an interruption, so that the checks fail."""
        try:
            answers = await vehicle.runner.link.ask("preflight", partial(inspect, required=required[0]))
        except LinkError as error:
            self._say(str(error))
            return Answers()
        for failure in answers.failures:
            self._say(f"{vehicle.spec.name}: {failure}")
        return answers

    def _facts(
        self,
        vehicle: VehicleToCheck,
        everyone: Sequence[VehicleToCheck],
        required: RequiredParameters,
        answers: Answers,
    ) -> PreflightFacts:
        spec, runner, section = vehicle.spec, vehicle.runner, self._scenario.config.preflight
        parameters, no_table_because = required
        state = runner.link.state()
        return PreflightFacts(
            spec=spec,
            identity=vehicle.identity,
            sysid_conflict=runner.sysid_conflict,
            state=state,
            age_s=runner.link.age_s(),
            position_age_s=_age_s(state.position_s),
            status_age_s=_age_s(state.status_s),
            answers=answers,
            clock_offset_s=self._clock_offset_s(vehicle, everyone),
            clock_tolerance_s=section.clock_tolerance_s * (self._speedup if spec.simulated else 1.0),
            required_parameters=parameters,
            no_table_because=no_table_because,
            fly_sets=corrections(parameters, answers.parameters) if self._fly_may_set else {},
            may_set_parameters=section.set_parameters,
            fence=self.fence_polygon,
            ceiling_m=self._scenario.ceiling_m,
            plan=_verified_plan(vehicle),
            no_route_because=vehicle.not_ready_because or runner.state.outcome or runner.state.trouble,
            trajectory=self.trajectories.get(spec.name),
            endurance_s=section.endurance_s or (SIMULATED_ENDURANCE_S if _is_simulated(vehicle) else None),
            reserve_percent=section.reserve_percent,
            frame=self._scenario.grid.frame,
            others=tuple(self._others(spec, everyone)),
            limits=self.limits,
        )

    def _others(self, spec: Spec, everyone: Sequence[VehicleToCheck]) -> Iterable[OtherVehicle]:
        identities = {vehicle.spec.name: vehicle.identity for vehicle in everyone}
        flown = IN_FLIGHT | {Phase.DONE}
        taken_over = {
            v.spec.name
            for v in everyone
            if v.runner.state.phase in flown and self.trajectories.get(v.spec.name) is None
        }
        for other in self._scenario.swarm:
            if other.name != spec.name:
                identity, trajectory = identities.get(other.name), self.trajectories.get(other.name)
                yield OtherVehicle(other, identity, trajectory, other.name in taken_over)

    def _clock_offset_s(self, vehicle: VehicleToCheck, everyone: Sequence[VehicleToCheck]) -> float | None:
        """Return a vehicle's clock less its reference [s]; None if the vehicle reports no time.

        The reference is this machine's clock. If `free_clocks` is true, the reference of simulated vehicles
        is the median of their clocks.
        """
        offset_s = self._offset_from_machine_s(vehicle)
        if offset_s is None or not (self._free_clocks and _is_simulated(vehicle)):
            return offset_s
        if not vehicle.spec.simulated:
            return 0.0  # the date in another program's simulator has no reference
        offsets_s = [self._offset_from_machine_s(other) for other in everyone if other.spec.simulated]
        return offset_s - statistics.median(other_s for other_s in offsets_s if other_s is not None)

    def _offset_from_machine_s(self, vehicle: VehicleToCheck) -> float | None:
        """Return a vehicle's clock less this machine's clock [s]; the latter times `speedup` if simulated."""
        instruments = self._instruments.get(vehicle.spec.name)
        if instruments is None or instruments.unix_s is None or instruments.unix_received_s is None:
            return None
        speedup = self._speedup if vehicle.spec.simulated else 1.0
        return instruments.unix_s - (self._unix_s_at_zero + instruments.unix_received_s * speedup)


def _is_simulated(vehicle: VehicleToCheck) -> bool:
    return vehicle.identity is not None and vehicle.identity.simulated


def _age_s(reported_s: float | None) -> float:
    return math.inf if reported_s is None else asyncio.get_running_loop().time() - reported_s


def _verified_plan(vehicle: VehicleToCheck) -> FlightPlan | None:
    """Return the plan verified on the vehicle, or None."""
    accepted = vehicle.runner.state.plans.accepted
    return None if accepted is None or not vehicle.runner.link.items() else accepted.plan


def _trajectory(vehicle: VehicleToCheck) -> Trajectory | None:
    plan, state = _verified_plan(vehicle), vehicle.runner.link.state()
    if plan is None or state.lat_deg is None or state.lon_deg is None:
        return None
    task, start = vehicle.runner.state.task, (state.lat_deg, state.lon_deg)
    trajectory = from_takeoff(task, plan, start, state.start_delay_s)
    return trajectory.later(vehicle.spec.delay_s)
