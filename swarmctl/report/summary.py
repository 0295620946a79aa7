"""Statistics of a run, collected by an `Observer`, and the content of `summary.json`."""

from __future__ import annotations

import contextlib
import math
import platform
from collections import defaultdict, deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from swarmctl import __version__
from swarmctl.agent.phases import IN_FLIGHT
from swarmctl.agent.state import ARRIVED, AgentState
from swarmctl.agent.traffic.separation.conflicts import CrossingCounts
from swarmctl.bus.node.exchange import NetworkCounters
from swarmctl.config.scenario import Scenario
from swarmctl.core import events as ev
from swarmctl.core.belief import Belief
from swarmctl.core.geo import LatLon, distance_m
from swarmctl.core.inference.survival import survival_among
from swarmctl.core.observation import Observation, ObservationId
from swarmctl.core.planned_mission import PlannedMission
from swarmctl.core.threat import FiringStrength
from swarmctl.planners import Route
from swarmctl.report.arrival import Arrivals
from swarmctl.report.final_state import describe_outcome, final_phase
from swarmctl.report.formations import FormationStatistics
from swarmctl.report.separation import SeparationStatistics
from swarmctl.report.swaps import SwapStatistics
from swarmctl.report.ui import Observer

MIN_STEP_M = 1.0
"""least distance between two kept positions of a flight [m]: a hovering vehicle adds none"""
MAX_WEIGHTS = 500
"""greatest number of a vehicle's weight changes in the summary; the newest are listed"""


class TakeoffPlan(msgspec.Struct, frozen=True):
    """The route, the belief and the firing strengths at take-off."""

    route: PlannedMission
    belief: Belief
    strength: FiringStrength


@dataclass(slots=True)
class VehicleStatistics:
    """Statistics of one vehicle that are not in its agent's state."""

    planned: list[LatLon] = field(default_factory=list)
    """points of the first accepted plan"""
    flown: list[LatLon] = field(default_factory=list)
    """positions while armed, MIN_STEP_M apart, up to the first position after disarming"""
    strikes: list[LatLon] = field(default_factory=list)
    took_off_s: float | None = None
    """time of the first position in `flown`, by the vehicle's clock [s]"""
    last_s: float | None = None
    """time of the last position in `flown`, by the vehicle's clock [s]"""
    takeoff_plan: TakeoffPlan | None = None

    weights: deque[tuple[float | None, int, float, FiringStrength]] = field(
        default_factory=lambda: deque(maxlen=MAX_WEIGHTS)
    )
    """up to MAX_WEIGHTS changes: flight time [s], first plan with the new weights, w, firing strengths"""
    weight_changes: int = 0
    """number of all weight changes"""
    swaps: SwapStatistics = field(default_factory=SwapStatistics)

    @property
    def flight_time_s(self) -> float | None:
        """Time from the first to the last position in `flown` [s]; None without positions."""
        return None if self.took_off_s is None or self.last_s is None else self.last_s - self.took_off_s


class FlightStatistics(Observer):
    """Statistics of all vehicles."""

    def __init__(self) -> None:
        self.vehicles: defaultdict[int, VehicleStatistics] = defaultdict(VehicleStatistics)
        self.separation = SeparationStatistics()
        self.arrivals = Arrivals()
        self.formations = FormationStatistics()
        self._observed_s: dict[ObservationId, float] = {}
        self._merged_s: dict[ObservationId, float] = {}
        """time at which the last peer merged the observation"""
        self._mission_changed_s: dict[ObservationId, float] = {}
        """time at which the last vehicle accepted a mission that was changed because of the observation"""

    def folded(
        self, before: AgentState, event: ev.Event, after: AgentState, effects: list[ev.Effect], now: float
    ) -> None:
        vehicle = self.vehicles[after.task.uav]
        match event:
            case ev.TelemetryReceived():
                self._add_position(vehicle, before, after)
                self.separation.moved(after, vehicle.flight_time_s, now)
                self.arrivals.moved(after, now)
                self.formations.moved(before, after)
                if event.neighbours:
                    self.separation.neighbours_moved(after, event.neighbours, vehicle.flight_time_s, now)
            case ev.ObservationsReceived(items) if after.belief is not before.belief:
                self._merged_s.update(((*o.source, o.seq), now) for o in items if isinstance(o, Observation))
            case ev.MissionAccepted() if before.plans.pending is not None and after.plans.pending is None:
                self._accepted(vehicle, before.plans.pending, now)
            case _:
                pass
        if isinstance(event, ev.MissionAccepted | ev.MissionFailed):
            pending = before.plans.pending if before.phase in IN_FLIGHT else None
            if pending is not None and pending.plan_id == event.plan_id:
                vehicle.swaps.count(event)
        for effect in effects:
            changed = (after.w, after.strength) != (before.w, before.strength)
            if changed and isinstance(effect, ev.Answer) and effect.answer.from_plan is not None:
                vehicle.weight_changes += 1
                vehicle.weights.append(
                    (vehicle.flight_time_s, effect.answer.from_plan, after.w, after.strength)
                )
            if isinstance(effect, ev.Publish) and isinstance(effect.message, Observation):
                observation = effect.message
                self._observed_s[*observation.source, observation.seq] = now

    def _add_position(self, vehicle: VehicleStatistics, before: AgentState, after: AgentState) -> None:
        state = after.vehicle
        if state.lat_deg is None or state.lon_deg is None or not (state.armed or before.vehicle.armed):
            return
        here = (state.lat_deg, state.lon_deg)
        if not vehicle.flown or not state.armed or distance_m(vehicle.flown[-1], here) >= MIN_STEP_M:
            vehicle.flown.append(here)
        vehicle.strikes += [here] * (state.strikes - before.vehicle.strikes)
        if vehicle.took_off_s is None:
            vehicle.took_off_s = state.time_boot_s
            if after.plans.mission is not None:
                vehicle.takeoff_plan = TakeoffPlan(after.plans.mission, after.belief, after.strength)
        vehicle.last_s = state.time_boot_s

    def _accepted(self, vehicle: VehicleStatistics, mission: PlannedMission, now: float) -> None:
        if not vehicle.planned:
            vehicle.planned = [(p.lat_deg, p.lon_deg) for p in (*mission.plan.track, mission.plan.landing)]
        for observation in mission.because:
            self._mission_changed_s[observation] = now

    @property
    def longest_flight_s(self) -> float:
        """Longest flight time of a vehicle so far, by the vehicle's clock [s]; 0 before the first flight."""
        return max((v.flight_time_s or 0.0 for v in self.vehicles.values()), default=0.0)

    def latencies(self, observer: int | None = None) -> dict[str, Any]:
        """Return quantiles of the times from observations by `observer` (None: all) to their effects [s]."""
        observed_s = {o: t for o, t in self._observed_s.items() if observer in (None, o[0])}
        return {
            "observation_to_last_peers_belief_s": _quantiles(observed_s, self._merged_s),
            "observation_to_last_changed_mission_s": _quantiles(observed_s, self._mission_changed_s),
        }


def _quantiles(
    begin_s: dict[ObservationId, float], end_s: dict[ObservationId, float]
) -> dict[str, float | int] | None:
    waits_s = [end_s[o] - begin_s[o] for o in sorted(end_s) if o in begin_s]
    if not waits_s:
        return None
    p50, p99, top = np.quantile(waits_s, (0.5, 0.99, 1.0))
    return {"n": len(waits_s), "p50": float(p50), "p99": float(p99), "max": float(top)}


def summary(
    scenario: Scenario,
    states: dict[int, AgentState],
    statistics: FlightStatistics,
    *,
    clock: str,
    speedup: float,
    wall_s: float | None,
    commands: dict[str, int],
    networks: Mapping[int, NetworkCounters],
    payload_reports: Mapping[int, dict[str, Any]],
    crossings: CrossingCounts | None = None,
) -> dict[str, Any]:
    """Return the content of `summary.json`.

    `speedup`: simulated seconds in one second of the run's clock. `networks` and `payload_reports` count
    messages and reports by system id. A vehicle without a receiver of reports is not in `payload_reports`.
    `crossings` counts crossings of first routes; None: not counted.
    """
    merged, configuration = _merged_belief(scenario, states), scenario.config.model_dump(mode="json")
    return {
        "name": scenario.config.name,
        "seed": scenario.config.seed,
        "clock": clock,
        "wall_time_s": wall_s,
        "versions": _versions(),
        "arrived": sum(s.outcome == ARRIVED for s in states.values()),
        "hostiles": {
            "announced": configuration["threats"]["count"],
            "true": len(scenario.hostiles),
            "found": merged.n_found,
            "expected": float(merged.occupancy().sum()),
            "announced_count_was_too_low": any(s.belief.announced_too_low for s in states.values()),
        },
        "psi_per_cell": scenario.psi_per_cell,
        "latency_clock": "simulated seconds" if clock == "virtual" else "wall seconds",
        "latency": statistics.latencies(),
        "separation": statistics.separation.summary(states, crossings),
        "arrival": statistics.arrivals.summary(states, speedup),
        "formations": statistics.formations.summary(scenario.config),
        "operator_commands": commands,
        "vehicles": [
            _vehicle(scenario, states[task.uav], statistics, networks[task.uav])
            | {"payload_reports": payload_reports.get(task.uav)}
            for task in scenario.tasks
        ],
        "configuration": configuration,
        "resolved": {
            "hostiles": sorted(scenario.hostiles),
            "vehicles": [_spec(scenario, i) for i in range(len(scenario.specs))],
        },
    }


def known_to_any(scenario: Scenario, states: dict[int, AgentState]) -> NDArray[np.int8]:
    """Return `Belief.known` of the merged beliefs of all vehicles."""
    return _merged_belief(scenario, states).known


def _merged_belief(scenario: Scenario, states: dict[int, AgentState]) -> Belief:
    """Return the merged beliefs; of observations with one (observer, incarnation, seq), the first counts."""
    merged = scenario.prior
    for state in states.values():
        for item in state.belief.items():
            with contextlib.suppress(ValueError):
                merged = merged.merge((item,))
    return merged


def _vehicle(
    scenario: Scenario, state: AgentState, statistics: FlightStatistics, network: NetworkCounters
) -> dict[str, Any]:
    task, flight = state.task, statistics.vehicles[state.task.uav]
    n_own = state.belief.n_cells_from(task.uav)
    return {
        "name": task.name,
        "sysid": task.uav,
        "outcome": describe_outcome(state),
        "trouble": state.trouble,
        "phase": final_phase(state),
        "flight_time_s": flight.flight_time_s,
        **arrival_of(state),
        "flown_m": state.flown.length_m,
        "at_takeoff": None
        if flight.takeoff_plan is None
        else _takeoff_plan(scenario, task.uav, flight.takeoff_plan),
        "chance_among_true_hostiles": _chance_among_true(scenario, state),
        "exposure_sum_at_decisions": state.flown.exposure,
        "safety_factor_at_decisions": state.flown.safety,
        "cells_entered": len(state.flown.cells),
        "no_fly_cells_entered": state.flown.no_fly_entered,
        "strikes": state.vehicle.strikes,
        "searches": state.plans.searches,
        "last_plan": None if state.plans.planned is None else _plan(state.plans.planned),
        "replans": state.plans.replans,
        "swaps": flight.swaps.summary(),
        "weights": [
            _weights(None, 1, task.w, task.strength),
            *(_weights(*change) for change in flight.weights),
        ],
        "weight_changes": flight.weight_changes,
        "messages_sent": network.sent.total(),
        "network": _network(network),
        "communication_penalty": scenario.config.communication.penalty_per_m * state.flown.length_m,
        "latency": statistics.latencies(task.uav),
        "cells_own": n_own,
        "cells_received": state.belief.n_observed - n_own,
        "hostiles_known": state.belief.n_found,
        "battery_percent": state.vehicle.battery_percent,
    }


def _network(counters: NetworkCounters) -> dict[str, Any]:
    """Return the counters of a vehicle's messages; a message counts once for each recipient."""
    values = {name: getattr(counters, name) for name in NetworkCounters.__slots__}
    return {
        name: value if isinstance(value, int) else {str(k): n for k, n in sorted(value.items())}
        for name, value in values.items()
    }


def arrival_of(state: AgentState) -> dict[str, Any]:
    """Return the arrival time and its bound. Times count from take-off, by the vehicle's clock [s]."""
    arrival, arrived_s = state.task.arrival, None
    if state.arrived_boot_s is not None and state.launch.armed_boot_s is not None:
        arrived_s = state.arrived_boot_s - state.launch.armed_boot_s
    kept = arrived_s is not None and arrival.after_s <= arrived_s <= arrival.within_s
    return {
        "arrived_s": arrived_s,
        "arrive_after_s": arrival.after_s,
        "arrive_within_s": _finite(arrival.within_s),
        "arrival_bound_kept": kept if arrival.is_bounded else None,
    }


def _takeoff_plan(scenario: Scenario, uav: int, takeoff_plan: TakeoffPlan) -> dict[str, Any]:
    route = takeoff_plan.route
    entered = route.cells if route.track is None else route.track.over
    chance = scenario.survival_probability(uav, takeoff_plan.belief, takeoff_plan.strength, entered)
    return {
        "length_m": route.length_m,
        "exposure_sum": route.exposure_sum,
        "safety_factor": route.safety_factor,
        "chance_by_simulation": {
            "estimate": chance.estimate,
            "low_95": chance.low,
            "high_95": chance.high,
            "worlds": chance.n_worlds,
        },
    }


def _chance_among_true(scenario: Scenario, state: AgentState) -> float | None:
    """Return the survival probability over the cells entered, among the true hostiles; None if unknown."""
    hostiles, shape = scenario.true_hostiles, (scenario.grid.rows, scenario.grid.cols)
    if not state.flown.cells or hostiles is None:
        return None
    return survival_among(hostiles, scenario.strength, state.flown.cells, shape)


def _plan(route: Route) -> dict[str, Any]:
    return {
        "cost": _finite(route.cost),
        "lower_bound": None if route.lower_bound is None else _finite(route.lower_bound),
        "searched": [msgspec.structs.asdict(searched) for searched in route.searched],
    }


def _finite(number: float) -> float | None:
    """Return the number, or None for infinity, which JSON lacks."""
    return number if math.isfinite(number) else None


def _weights(
    flight_time_s: float | None, from_plan: int, w: float, strength: FiringStrength
) -> dict[str, Any]:
    """Return the weights and the first plan with these weights; `flight_time_s` is None before take-off."""
    return {
        "flight_time_s": flight_time_s,
        "from_plan": from_plan,
        "w": w,
        "firing_strength": msgspec.structs.asdict(strength),
    }


def _spec(scenario: Scenario, index: int) -> dict[str, Any]:
    spec = scenario.specs[index]
    return {
        "name": spec.name,
        "sysid": spec.sysid,
        "url": spec.url,
        "link": spec.link,
        "simulated": spec.simulated,
        "start": spec.start,
        "entry": spec.entry,
        "goals": spec.goals,
        "altitude_m": spec.altitude_m,
        "delay_s": spec.delay_s,
    }


def _versions() -> dict[str, str]:
    packages = ("pymavlink", "eclipse-zenoh", "numpy", "scipy", "numba", "pyproj")
    return {
        "swarmctl": __version__,
        "python": platform.python_version(),
        **{name: version(name) for name in packages},
    }
