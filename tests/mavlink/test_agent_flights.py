"""An agent and its vehicle together, with changed plans: the track flown over good and slow links."""

from __future__ import annotations

import pytest
from agent_flight import GRID, ROW, AgentFlight
from flying_bench import BOTH
from metric_plans import most_backwards_m
from profiles import full_only

from swarmctl.agent.phases import Phase
from swarmctl.agent.replan.swap_times import SwapTimes
from swarmctl.core import events as ev
from swarmctl.core.records import replace
from swarmctl.core.route import MAX_OVERSHOOT_CELLS


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
    flight = AgentFlight(personality)
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
            and flight.state.plans.mission is not None
        ):
            flight.receives_hostiles(*flight.state.plans.mission.cells[2:5])
        return flight.place[0] > 130.0

    assert flight.bench.run(120.0, is_past)
    assert flight.swaps
    assert max(outside_m) < 2.0, "a diagonal leg passes the corner of two more cells"
    assert most_backwards_m([east_m for east_m, _ in flight.flown]) < MAX_OVERSHOOT_CELLS * GRID.cell_size_m


@pytest.mark.full
@BOTH
@pytest.mark.parametrize("delay_s", [0.02, 1.0])
def test_changed_plans_are_flown_without_a_stop_or_a_turn_back(personality: str, delay_s: float) -> None:
    """Reports of hostiles six cells ahead on the route arrive at four columns."""
    flight = AgentFlight(personality, delay_s)
    columns = [2, 6, 10, 14]

    def report_hostiles() -> None:
        cell = GRID.cell_at(*GRID.frame.to_geodetic(*flight.place))
        if cell is not None and columns and cell[1] >= columns[0] and flight.state.plans.mission is not None:
            ahead = cell[1] + 6
            flight.receives_hostiles(next(at for at in flight.state.plans.mission.cells if at[1] == ahead))
            columns.pop(0)

    flight.lands(report_hostiles)
    assert flight.state.phase is Phase.DONE
    done = flight.ended[1:]
    assert len(done) >= 2
    assert all(isinstance(event, ev.MissionAccepted) and event.stood_still_s == 0.0 for event in done)
    assert most_backwards_m([east_m for east_m, _ in flight.flown]) < MAX_OVERSHOOT_CELLS * GRID.cell_size_m
