"""Vehicles of a swarm return at their flight altitudes, which keep them apart in a common return."""

from __future__ import annotations

import math

import pytest
from flights import small

from swarmctl.config.scenario import Scenario
from swarmctl.mavlink.firmware import Firmware
from swarmctl.preflight.declared import declared_behaviour
from swarmctl.preflight.policy import RequiredParameter, parameters_for

COPTERS = [
    (Firmware("ArduCopter", (4, 6)), "RTL_ALT", 100.0),
    (Firmware("ArduCopter", (4, 7)), "RTL_ALT_M", 1.0),
    (Firmware("PX4", (1, 15)), "RTL_RETURN_ALT", 1.0),
]


def wanted(scenario: Scenario, firmware: Firmware, name: str) -> list[RequiredParameter]:
    """Return the parameter `name` of each vehicle."""
    parameters = (parameters_for(firmware, declared_behaviour(scenario, spec)) for spec in scenario.specs)
    return [next(w for w in of_one if w.name == name) for of_one in parameters]


@pytest.mark.parametrize(("firmware", "name", "per_m"), COPTERS, ids=["ArduCopter", "of 4.7", "PX4"])
def test_no_copter_of_a_swarm_climbs_above_its_own_height_to_return(
    firmware: Firmware, name: str, per_m: float
) -> None:
    swarm = small(flight={"altitude_m": 20.0, "altitude_step_m": 5.0})
    heights_m = [spec.altitude_m for spec in swarm.specs]
    assert len(set(heights_m)) == 3
    for height_m, its in zip(heights_m, wanted(swarm, firmware, name), strict=True):
        assert its.accepts(height_m * per_m)
        assert not its.accepts((height_m + 1.0) * per_m)
        assert its.set_to is not None
        assert its.set_to <= height_m * per_m


def test_a_copter_with_an_agent_of_its_own_returns_at_its_own_height_too() -> None:
    swarm = small(flight={"altitude_m": 20.0, "altitude_step_m": 5.0})
    (its,) = wanted(swarm.only(swarm.specs[1].sysid), COPTERS[0][0], "RTL_ALT")
    assert its.accepts(2500.0)
    assert not its.accepts(2600.0)


def test_a_plane_of_a_swarm_returns_at_its_present_height_or_at_its_own() -> None:
    """ArduPlane climbs or descends to RTL_ALTITUDE."""
    scenario = small(
        simulate={"count": 2, "autopilot": "arduplane"},
        flight={"altitude_m": 40.0, "altitude_step_m": 10.0, "any_angle": True},
        threats={"count": 0},
        area={"origin_lat_deg": 46.0, "origin_lon_deg": 14.4, "rows": 20, "cols": 20, "cell_size_m": 50.0},
    )
    for spec, its in zip(
        scenario.specs, wanted(scenario, Firmware("ArduPlane", (4, 6)), "RTL_ALTITUDE"), strict=True
    ):
        assert its.accepts(-1.0)
        assert its.accepts(spec.altitude_m)
        assert not its.accepts(spec.altitude_m - 10.0)
        assert not its.accepts(spec.altitude_m + 10.0)
        assert not its.accepts(math.nan)
