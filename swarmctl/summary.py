"""What a run came to: an `Observer` that adds up, and the `summary.json` it writes."""

from __future__ import annotations

import platform
from collections import defaultdict
from dataclasses import dataclass, field
from functools import reduce
from importlib.metadata import version
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmctl import __version__
from swarmctl.agent import ARRIVED, AgentState
from swarmctl.core import events as ev
from swarmctl.core.belief import OCCUPIED
from swarmctl.core.geo import LatLon
from swarmctl.core.messages import Message, ObservationShared
from swarmctl.scenario import Scenario


@dataclass(slots=True)
class VehicleLedger:
    """What one vehicle did, beyond what its agent's state says."""

    messages_sent: int = 0
    planned: list[LatLon] = field(default_factory=list)
    """the first route"""
    flown: list[LatLon] = field(default_factory=list)
    strikes: list[LatLon] = field(default_factory=list)
    took_off_s: float | None = None
    last_s: float | None = None
    """by the vehicle's own clock"""

    @property
    def flight_time_s(self) -> float | None:
        """From take-off to now, or to the landing."""
        return None if self.took_off_s is None or self.last_s is None else self.last_s - self.took_off_s


class Ledger:
    """Follows every agent; latencies are in seconds of the run's clock."""

    def __init__(self) -> None:
        self.vehicles: defaultdict[int, VehicleLedger] = defaultdict(VehicleLedger)
        self._observed_s: dict[ev.ObservationId, float] = {}
        self._believed_s: dict[ev.ObservationId, float] = {}
        """by the last peer"""
        self._flown_s: dict[ev.ObservationId, float] = {}
        """when the last mission changed because of it was accepted"""

    def folded(
        self, before: AgentState, event: ev.Event, after: AgentState, effects: list[ev.Effect], now: float
    ) -> None:
        vehicle = self.vehicles[after.task.uav]
        match event:
            case ev.TelemetryReceived():
                self._moved(vehicle, before, after)
            case ev.Heard(ObservationShared(observation=o)) if after.belief is not before.belief:
                self._believed_s[o.observer, o.seq] = now
            case ev.MissionAccepted() if before.pending is not None and after.pending is None:
                self._accepted(vehicle, before.pending, now)
            case _:
                pass
        for effect in effects:
            if isinstance(effect, ev.Publish) and isinstance(effect.message, ObservationShared):
                observation = effect.message.observation
                self._observed_s[observation.observer, observation.seq] = now

    def sent(self, uav: int, message: Message, recipients: int, now: float) -> None:
        self.vehicles[uav].messages_sent += recipients

    def said(self, uav: int, text: str, now: float, *, aloud: bool) -> None:
        pass

    def _moved(self, vehicle: VehicleLedger, before: AgentState, after: AgentState) -> None:
        state = after.vehicle
        if state.lat_deg is None or state.lon_deg is None or not (state.armed or before.vehicle.armed):
            return
        here = (state.lat_deg, state.lon_deg)
        vehicle.flown.append(here)
        vehicle.strikes += [here] * (state.strikes - before.vehicle.strikes)
        if vehicle.took_off_s is None:
            vehicle.took_off_s = state.time_boot_s
        vehicle.last_s = state.time_boot_s

    def _accepted(self, vehicle: VehicleLedger, swap: ev.SwapMission, now: float) -> None:
        if not vehicle.planned:
            vehicle.planned = [(p.lat_deg, p.lon_deg) for p in (*swap.plan.track, swap.plan.landing)]
        for observation in swap.because:
            self._flown_s[observation] = now

    @property
    def flown_s(self) -> float:
        """The longest flight so far."""
        return max((v.flight_time_s or 0.0 for v in self.vehicles.values()), default=0.0)

    def latencies(self, observer: int | None = None) -> dict[str, Any]:
        """From an observation, of one vehicle or of all, to what it brought about [s]."""
        observed_s = {o: t for o, t in self._observed_s.items() if observer in (None, o[0])}
        return {
            "observation_to_last_peers_belief_s": _quantiles(observed_s, self._believed_s),
            "observation_to_last_changed_mission_s": _quantiles(observed_s, self._flown_s),
        }


def _quantiles(
    begin_s: dict[ev.ObservationId, float], end_s: dict[ev.ObservationId, float]
) -> dict[str, float | int] | None:
    waits_s = [end_s[o] - begin_s[o] for o in sorted(end_s) if o in begin_s]
    if not waits_s:
        return None
    p50, p99, top = np.quantile(waits_s, (0.5, 0.99, 1.0))
    return {"n": len(waits_s), "p50": float(p50), "p99": float(p99), "max": float(top)}


def summary(
    scenario: Scenario, states: dict[int, AgentState], ledger: Ledger, *, clock: str, wall_s: float | None
) -> dict[str, Any]:
    """The content of `summary.json`."""
    return {
        "name": scenario.config.name,
        "seed": scenario.config.seed,
        "clock": clock,
        "wall_time_s": wall_s,
        "versions": _versions(),
        "arrived": sum(s.outcome == ARRIVED for s in states.values()),
        "hostiles": {
            "announced": scenario.config.threats.count,
            "true": len(scenario.hostiles),
            "found": int(np.count_nonzero(known_to_any(scenario, states) == OCCUPIED)),
            "announced_count_was_too_low": any(s.belief.announced_too_low for s in states.values()),
        },
        "psi_per_cell": scenario.psi_per_cell,
        "latency_clock": "simulated seconds" if clock == "virtual" else "wall seconds",
        "latency": ledger.latencies(),
        "vehicles": [_vehicle(scenario, states[t.uav], ledger) for t in scenario.tasks],
        "configuration": scenario.config.model_dump(mode="json"),
        "resolved": {
            "hostiles": sorted(scenario.hostiles),
            "vehicles": [_spec(scenario, i) for i in range(len(scenario.specs))],
        },
    }


def known_to_any(scenario: Scenario, states: dict[int, AgentState]) -> NDArray[np.int8]:
    """What any vehicle knew: beliefs merge by union, and UNKNOWN < CLEAR < OCCUPIED."""
    return reduce(np.maximum, (s.belief.known for s in states.values()), scenario.prior.known)


def _vehicle(scenario: Scenario, state: AgentState, ledger: Ledger) -> dict[str, Any]:
    task, mine = state.task, ledger.vehicles[state.task.uav]
    own = state.belief.n_cells_from(task.uav)
    return {
        "name": task.name,
        "sysid": task.uav,
        "outcome": state.outcome or state.phase,
        "trouble": state.trouble,
        "phase": state.phase,
        "flight_time_s": mine.flight_time_s,
        "flown_m": state.flown_m,
        "exposure_sum_at_decisions": state.flown_exposure,
        "safety_factor_at_decisions": state.flown_safety,
        "cells_entered": len(state.flown_cells),
        "no_fly_cells_entered": state.no_fly_entered,
        "strikes": state.vehicle.strikes,
        "searches": state.searches,
        "replans": state.replans,
        "messages_sent": mine.messages_sent,
        "communication_penalty": scenario.config.communication.penalty_per_m * state.flown_m,
        "latency": ledger.latencies(task.uav),
        "cells_own": own,
        "cells_heard": state.belief.n_observed - own,
        "hostiles_known": state.belief.n_found,
        "battery_percent": state.vehicle.battery_percent,
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
