"""An agent and its vehicle over links that lose, delay and fail, with reports at any moment of the flight."""

from __future__ import annotations

from itertools import groupby

import pytest
from agent_flight import GRID, AgentFlight
from flying_bench import BOTH, Faults
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from swarmctl.agent.phases import Phase
from swarmctl.core.grid import Cell

OUTSIDE_M = 8.0
"""Greatest distance from the cells of the plans [m]: after a hold past a centre, a copter flies straight from
its place to the next waypoint, beside the diagonal of its cells."""
N_BESIDE = 3
"""Number of other cells after which a cell may not be entered again: diagonal legs touch the cells beside."""


def cells_entered_again(flight: AgentFlight) -> list[Cell]:
    """Return the cells that the vehicle entered again after N_BESIDE other cells or more."""
    entered = [GRID.cell_at(*GRID.frame.to_geodetic(*place)) for place in flight.flown]
    cells = [cell for cell, _ in groupby(cell for cell in entered if cell is not None)]
    again = []
    for i, cell in enumerate(cells):
        last = max((j for j in range(i) if cells[j] == cell), default=i)
        if len(set(cells[last + 1 : i])) >= N_BESIDE:
            again.append(cell)
    return again


wires = st.builds(
    Faults,
    loss=st.sampled_from([0.0, 0.05, 0.2]),
    max_delay_s=st.sampled_from([0.0, 0.2, 1.0]),
    seed=st.integers(0, 2**16),
)
reports = st.lists(st.tuples(st.floats(0.0, 130.0), st.integers(1, 8)), min_size=2, max_size=8)
"""(time since lift-off [s], cells ahead on the route) of each hostile that another vehicle reports"""
outages = st.lists(st.tuples(st.floats(0.0, 120.0), st.sampled_from([1.0, 4.0])), max_size=2)


@pytest.mark.full
@BOTH
@settings(
    deadline=None,
    derandomize=True,
    max_examples=8,
    suppress_health_check=list(HealthCheck),
    database=None,
)
@given(wire=wires, cuts=outages, delay_s=st.sampled_from([0.0, 0.2, 0.8]), drawn=reports)
@example(wire=Faults(loss=0.2, seed=11243), cuts=[(0.0, 4.0)], delay_s=0.2, drawn=[(0.0, 1), (0.0, 2)])
def test_no_change_leads_back_or_out_of_the_cells_of_its_plans(
    personality: str,
    wire: Faults,
    cuts: list[tuple[float, float]],
    delay_s: float,
    drawn: list[tuple[float, int]],
) -> None:
    flight = AgentFlight(personality)
    bench, lifted_s, left = flight.bench, flight.bench.now, sorted(drawn)
    bench.delay_s = delay_s
    bench.spoil(wire, *((at_s, at_s + for_s) for at_s, for_s in cuts))
    outside_m = [0.0]

    def watch() -> None:
        outside_m.append(flight.outside_m())
        while left and left[0][0] <= bench.now - lifted_s:
            _, ahead = left.pop(0)
            progress, is_flying = flight.state.progress, flight.state.phase is Phase.FLYING
            if flight.state.plans.mission is not None and progress is not None and is_flying:
                cells = flight.state.plans.mission.cells
                flight.receives_hostiles(cells[min(progress.cell_index + ahead, len(cells) - 1)])

    flight.lands(watch)
    assert flight.state.phase is Phase.DONE
    assert max(outside_m) < OUTSIDE_M
    assert cells_entered_again(flight) == []
