"""An agent and its vehicle together, over a link with one second of delay each way: the track flown."""

from __future__ import annotations

import pytest
from agent_flight import GRID, AgentFlight, largest_retreat_m

from swarmctl.agent.phases import Phase
from swarmctl.core import events as ev


@pytest.mark.full
@pytest.mark.parametrize("personality", ["ardupilot", "px4"])
@pytest.mark.parametrize("delay_s", [0.02, 1.0])
def test_changed_plans_are_flown_without_a_stop_or_a_turn_back(personality: str, delay_s: float) -> None:
    """Reports of hostiles six cells ahead on the route arrive at four columns."""
    flight = AgentFlight(personality, delay_s)
    columns = [2, 6, 10, 14]

    def report_hostiles() -> None:
        cell = GRID.cell_at(*GRID.frame.to_geodetic(*flight.place))
        if cell is not None and columns and cell[1] >= columns[0] and flight.state.plans.route is not None:
            ahead = cell[1] + 6
            flight.receives_hostiles(next(at for at in flight.state.plans.route.cells if at[1] == ahead))
            columns.pop(0)

    flight.lands(report_hostiles)
    assert flight.state.phase is Phase.DONE
    done = flight.ended[1:]
    assert len(done) >= 2
    assert all(isinstance(event, ev.MissionAccepted) and event.stood_still_s == 0.0 for event in done)
    assert largest_retreat_m(flight.flown) < 2.0
