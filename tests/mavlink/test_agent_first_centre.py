"""A plan that is changed shortly before the first centre of the area: positions and cells of the plans."""

from __future__ import annotations

from dataclasses import replace

import pytest
from agent_flight import GRID, ROW, AgentFlight, largest_retreat_m
from profiles import full_only

from swarmctl.agent.replan.swap_times import SwapTimes
from swarmctl.core.route import MAX_OVERSHOOT_CELLS

OUTSIDE_M = 2.0
"""Greatest distance from the cells of the plans [m]; a diagonal leg passes the corner of two more cells."""
OVERSHOOT_M = MAX_OVERSHOOT_CELLS * GRID.cell_size_m


@pytest.mark.parametrize(
    ("personality", "before_m"),
    [
        ("ardupilot", 20.0),
        ("px4", 24.0),
        *full_only(*((p, m) for p in ("ardupilot", "px4") for m in (45.0, 31.0, 10.0))),
    ],
)
def test_a_vehicle_that_arrives_fast_stays_in_the_cells_of_its_plans(
    personality: str, before_m: float
) -> None:
    """The vehicle starts 25 m west of the area. Its route turns by 45 degrees at the first centre."""
    flight = AgentFlight(personality, 0.0)
    flight.state = replace(
        flight.state, plans=replace(flight.state.plans, swap_times=SwapTimes((0.25,), (0.0,)))
    )
    first_m = GRID.centre_m((ROW, 0))[0]
    outside_m: list[float] = []

    def is_past() -> bool:
        flight.go_on()
        flight.flown.append(flight.place)
        outside_m.append(flight.outside_m())
        if (
            flight.place[0] >= first_m - before_m
            and not flight.swaps
            and flight.state.plans.route is not None
        ):
            flight.receives_hostiles(*flight.state.plans.route.cells[2:5])
        return flight.place[0] > 130.0

    assert flight.bench.run(120.0, is_past)
    assert flight.swaps
    assert max(outside_m) < OUTSIDE_M
    assert largest_retreat_m(flight.flown) < OVERSHOOT_M
