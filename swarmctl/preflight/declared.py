"""The declared behaviour of each vehicle, and the parameters of simulated vehicles. Pure."""

from __future__ import annotations

import math

from swarmctl.config.scenario import Scenario
from swarmctl.config.specs import Spec, wings_of
from swarmctl.mavlink.firmware import Firmware
from swarmctl.mavlink.protocol.codec import GCS_SYSID
from swarmctl.preflight.policy import DeclaredBehaviour, NoParameterTable, parameters_for


def declared_behaviour(scenario: Scenario, spec: Spec) -> DeclaredBehaviour:
    """Return the behaviour that the configuration declares for one vehicle."""
    policy = scenario.config.preflight.policy
    return DeclaredBehaviour(
        policy,
        GCS_SYSID,
        spec.altitude_m,
        scenario.ceiling_m,
        wings_of(scenario.config, spec),
        spec.speed_m_s,
        spec.turn_radius_m,
        among_others=len(scenario.swarm) > 1,
        extent_m=_extent_m(scenario, spec),
        in_formation=scenario.formation_of(spec.sysid) is not None,
    )


def _extent_m(scenario: Scenario, spec: Spec) -> float:
    """Return the greatest distance between two corners of the area, or between a corner and the start [m]."""
    grid = scenario.grid
    east_m, north_m = grid.cols * grid.cell_size_m, grid.rows * grid.cell_size_m
    corners = [(0.0, 0.0), (east_m, 0.0), (0.0, north_m), (east_m, north_m)]
    start = grid.frame.to_local(*spec.start)
    return max(math.dist(a, b) for a in corners for b in (*corners, start))


_SIMULATED_VALUES = {"BATT_LOW_VOLT": 10.5}  # for a battery of three cells


def simulated_parameters(scenario: Scenario, spec: Spec, firmware: Firmware) -> dict[str, float]:
    """Return the initial parameters of a simulated vehicle, as the configuration declares.

    The result is empty if the firmware has no parameter table; the check `parameters` then fails.
    """
    try:
        required = parameters_for(firmware, declared_behaviour(scenario, spec))
    except NoParameterTable:
        return {}
    by_hand = {r.name: _SIMULATED_VALUES[r.name] for r in required if r.name in _SIMULATED_VALUES}
    return by_hand | {r.name: r.set_to for r in required if r.set_to is not None}
