"""What the parameters of each vehicle are to say, and what simulated ones come with. Pure."""

from __future__ import annotations

from swarmctl.config.scenario import Scenario
from swarmctl.config.specs import Spec
from swarmctl.mavlink.firmware import Firmware
from swarmctl.mavlink.protocol.codec import GCS_SYSID
from swarmctl.preflight.policy import DeclaredBehaviour, NoParameterTable, parameters_for


def declared_behaviour(scenario: Scenario, spec: Spec) -> DeclaredBehaviour:
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


_SIMULATED = {"BATT_LOW_VOLT": 10.5}  # of three cells


def simulated_parameters(scenario: Scenario, spec: Spec, firmware: Firmware) -> dict[str, float]:
    """What a vehicle of the built-in simulator is set up with, as its owner sets up a real one.

    Nothing where its firmware has no such action: its checks will say so.
    """
    try:
        wanted = parameters_for(firmware, declared_behaviour(scenario, spec))
    except NoParameterTable:
        return {}
    by_its_owner = {w.name: _SIMULATED[w.name] for w in wanted if w.name in _SIMULATED}
    return by_its_owner | {w.name: w.set_to for w in wanted if w.set_to is not None}
