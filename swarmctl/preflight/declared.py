"""The declared behaviour of each vehicle, and the parameters of simulated vehicles. Pure."""

from __future__ import annotations

from swarmctl.config.scenario import Scenario
from swarmctl.config.specs import Spec
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
        scenario.wings(spec),
        spec.speed_m_s,
        spec.turn_radius_m,
        among_others=len(scenario.swarm) > 1,
    )


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
