"""The splice point of a fixed wing's new plan, and the remaining corners before it."""

from __future__ import annotations

import math

import pytest
from flights import winged

from swarmctl.agent.phases import Phase
from swarmctl.agent.replan.decide import first_flight, first_problem, first_route
from swarmctl.agent.replan.plans import Plans
from swarmctl.agent.replan.route_to_mission import corners_ahead
from swarmctl.agent.replan.splice import splice_on_route
from swarmctl.agent.replan.swap_times import SwapTimes
from swarmctl.agent.state import AgentState, initial_state
from swarmctl.core.grid import Cell
from swarmctl.core.planned_mission import PlannedMission
from swarmctl.core.records import replace

SCENARIO = winged()
GRID = SCENARIO.grid
WING, _ = SCENARIO.tasks
ROUTE = tuple((3, col) for col in range(12))
"""A route straight to the east."""


def flying(east_m: float, task=WING, **changes) -> AgentState:
    """Return the state of a vehicle over row 3, at this distance from the west edge, on a plan over ROUTE."""
    state = initial_state(task, SCENARIO.prior)
    problem = first_problem(task, SCENARIO.prior)
    plan = first_flight(task, problem, first_route(task, SCENARIO.prior))
    swap = PlannedMission(1, plan, ROUTE, (), 0.0, 0.0, 1.0, 0.0)
    lat_deg, lon_deg = GRID.frame.to_geodetic(east_m, 175.0)
    home = dict(zip(("home_lat_deg", "home_lon_deg"), GRID.frame.to_geodetic(-50.0, 175.0), strict=True))
    vehicle = replace(state.vehicle, lat_deg=lat_deg, lon_deg=lon_deg, alt_rel_m=40.0, armed=True, **home)
    state = replace(state, phase=Phase.FLYING, vehicle=vehicle, last_position=vehicle)
    plans = replace(state.plans, mission=swap, **changes)
    return replace(state, cell=GRID.cell_at(lat_deg, lon_deg), plans=plans).with_progress()


def kept_cells(state: AgentState) -> tuple[Cell, ...]:
    return splice_on_route(state, SCENARIO.prior.occupancy()).kept


@pytest.mark.parametrize("took_s", [(), (0.4,), (4.5,), (0.4, 9.5, 0.4)])
def test_a_new_plan_of_a_fixed_wing_leaves_the_old_one_after_the_end_of_the_swap(took_s) -> None:
    times = SwapTimes(took_s, took_s)
    # 15 m/s for the duration of a swap, at least 2 s, and 17 m before a turn by 45°.
    needs_m = 15.0 * max(2.0, times.expected_s) + 40.0 * math.tan(math.radians(22.5))
    for east_m in range(60, 160, 7):
        here: Cell = (3, east_m // 50)
        kept = kept_cells(flying(east_m, swap_times=times))
        assert kept == ROUTE[here[1] : kept[-1][1] + 1]
        away_m = GRID.centre_m(kept[-1])[0] - east_m
        assert needs_m <= away_m < needs_m + 50.0


def test_a_fixed_wing_near_its_goal_keeps_its_route() -> None:
    assert kept_cells(flying(540.0)) == ((3, 10), (3, 11))


def test_a_vehicle_without_a_route_keeps_only_its_cell() -> None:
    assert kept_cells(replace(flying(110.0), plans=Plans())) == ((3, 2),)


@pytest.mark.parametrize(
    ("east_m", "corners", "expected"),
    [
        (110.0, [(3, 2), (3, 8)], [(3, 8)]),  # over the first corner
        (140.0, [(3, 2), (3, 4), (7, 8)], [(3, 4), (7, 8)]),  # 85 m before the turn
        (195.0, [(3, 3), (3, 4), (7, 8)], [(7, 8)]),  # in the turn by the end of the swap
        (-60.0, [(3, 0), (3, 8)], [(3, 0), (3, 8)]),  # on the way to the entry
        (560.0, [(3, 11)], [(3, 11)]),  # the goal is always kept
    ],
)
def test_a_fixed_wing_skips_corners_behind_or_too_near_to_turn_at(east_m, corners, expected) -> None:
    position = GRID.frame.to_geodetic(east_m, 175.0)
    assert list(corners_ahead(WING, corners, position)) == expected
    assert math.isclose(WING.turn_radius_m, 40.0)
