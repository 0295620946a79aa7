"""Stories of an agent with a time bound."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from agent_stories import GRID, Story, orders, swaps
from flown_legs import FLOWN_LEGS, START_LOSS_S, FlownLeg

from swarmctl.agent.launch import Launch
from swarmctl.agent.phases import Phase
from swarmctl.agent.replan.decide import first_route
from swarmctl.agent.replan.length_bounds import TimeBound
from swarmctl.agent.replan.splice import leaving_at_once
from swarmctl.agent.replan.swap_times import SwapTimes
from swarmctl.agent.replan.time_bound import Departure, is_no_worse, lead_in_to, swap_cost_cells
from swarmctl.agent.replan.travel_time import lost_s, timed_track
from swarmctl.core import events as ev
from swarmctl.core.any_angle.corners import ExposureMeasure
from swarmctl.core.belief import Belief
from swarmctl.core.exposure import length_cells
from swarmctl.core.grid import Cell
from swarmctl.core.records import replace
from swarmctl.core.threat import FiringStrength
from swarmctl.planners import PLANNERS, BoundTooTight, Method, Problem, Route
from swarmctl.planners.base import is_open, route_of
from swarmctl.report.summary import arrival_of

DIJKSTRA = PLANNERS["dijkstra"]


class TwoRoutes:
    """A planner with bounds and two routes: the least exposed and the shortest."""

    Params = DIJKSTRA.Params

    def plan(self, problem: Problem, params: Any, /) -> Route:
        routes = [DIJKSTRA.plan(replace(problem, w=w), params) for w in (1.0, 0.0)]
        for route in routes:
            if not math.isinf(cost := self.measure(problem, route.cells, params)):
                return route_of(problem, route.cells, cost)
        raise BoundTooTight("no route in time", route_of(problem, routes[1].cells, routes[1].exposure_sum))

    def measure(self, problem: Problem, cells: Sequence[Cell], _params: Any, /) -> float:
        length = length_cells(cells)
        if not (is_open(problem, cells) and problem.min_length_cells <= length <= problem.max_length_cells):
            return math.inf
        return route_of(problem, cells, 0.0).exposure_sum


TWO_ROUTES = Method("two routes", TwoRoutes(), DIJKSTRA.Params())
# The route along the southern edge has 8 cells (40 s) and is at first both shortest and least exposed. The
# detour around hostiles in its middle has about 10 cells (50 s).
HOSTILES_ON_ROUTE = ((0, 3, True), (0, 4, True), (0, 5, True))


def story(within_s: float = math.inf, after_s: float = 0.0, **changes: Any) -> Story:
    arrival = TimeBound(10.0, after_s, within_s, approach_m=50.0)
    return Story(method=TWO_ROUTES, arrival=arrival, entry=(0, 0), goals=((0, 8),), **changes)


def flying(at_s: float = 20.0, **bounds: float) -> Story:
    """Return a vehicle launched at 0 s of its clock and over its entry cell at `at_s`."""
    flight = story(**bounds).launching()
    flight.over((0, 0), time_boot_s=100.0)
    flight(ev.OrderDone(ev.FlightOrder.LAUNCH))
    flight.over((0, 0), time_boot_s=100.0 + at_s)
    assert flight.state.phase is Phase.FLYING
    return flight


def test_the_bound_counts_from_the_first_armed_heartbeat() -> None:
    flight = story(within_s=90.0).launching()
    flight.over((0, 0), time_boot_s=300.0, armed=False)
    assert flight.state.launch.armed_boot_s is None
    flight.over((0, 0), time_boot_s=310.0)
    flight.over((0, 0), time_boot_s=320.0)
    assert flight.state.launch.armed_boot_s == 310.0


def test_the_detour_is_flown_only_with_enough_time() -> None:
    for within_s, length in ((120.0, 9.0), (70.0, 8.0)):
        flight = flying(within_s=within_s)
        flight.hear(*HOSTILES_ON_ROUTE)
        cells = (
            swap.cells
            if (swap := next(iter(swaps(flight.tick())), None))
            else flight.state.plans.mission.cells
        )
        assert (length_cells(cells) > 8.0) == (length > 8.0)
        assert flight.state.late == ""


def test_a_late_vehicle_flies_on_and_reports_its_arrival_time() -> None:
    flight = flying(at_s=60.0, within_s=80.0)
    flight.hear((0, 4, True))
    assert swaps(flight.tick()) == []  # the straight route is the least late
    assert flight.state.plans.late_s == pytest.approx(101.4, abs=0.1)
    assert "101.5 s" in flight.state.late
    flight.over((0, 1), time_boot_s=170.0, ground_speed_m_s=10.0)
    flight.hear((0, 5, True), seq=2)
    flight.tick()
    assert "105.0 s" in flight.state.late
    assert flight.state.phase is Phase.FLYING
    assert orders(flight.effects) == []


def test_a_detour_is_left_when_it_becomes_too_long() -> None:
    flight = flying(within_s=120.0)
    flight.hear(*HOSTILES_ON_ROUTE)
    around = flight.swap()
    flight.accept()
    # After a delay the detour is late, and the straight route is the least late.
    flight.over(around.cells[1], time_boot_s=198.0)
    flight.hear((8, 0, False), seq=2)
    straight = flight.swap()
    assert length_cells(straight.cells) < length_cells(around.cells[1:])


def test_a_mission_change_that_would_cost_the_arrival_in_time_is_not_made() -> None:
    flight = flying(within_s=80.0)
    flight.hear(*HOSTILES_ON_ROUTE)
    flight.tick()
    before = flight.state.plans.mission
    # 60 s are left for a route of 60 s: in time only without a swap.
    flight.over((0, 0), time_boot_s=140.0)
    flight.hear((8, 8, False), seq=2)
    assert swaps(flight.tick()) == []
    assert flight.state.plans.mission is before


def test_a_route_into_a_wall_is_left_even_if_the_vehicle_becomes_late() -> None:
    flight = story(within_s=70.0, max_exposure=0.5).launching()
    flight.over((0, 0), time_boot_s=100.0)
    flight(ev.OrderDone(ev.FlightOrder.LAUNCH))
    flight.over((0, 0), time_boot_s=129.0)
    flight.hear((0, 4, True))
    swap = flight.swap()
    assert (0, 4) not in swap.cells
    assert flight.state.late != ""


def test_a_route_with_a_too_early_arrival_is_replaced_by_a_longer_one() -> None:
    flight = flying(after_s=64.0, within_s=120.0)
    assert flight.state.plans.late_s == pytest.approx(57.0, abs=0.1)
    flight.hear(*HOSTILES_ON_ROUTE)
    assert length_cells(flight.swap().cells) > 9.5
    assert flight.state.late == ""


def test_a_plan_on_the_ground_allows_for_climb_and_approach() -> None:
    # 40 s across, 14.5 s to climb 30 m, 5 s to the entry; 4 s to lift off, 7.0 s to speed up and stop over
    # the entry, because the leg of 50 m allows 8.1 m/s. Speeding up again costs 1.4 s more than the half
    # cell between the edge of the goal cell and its centre saves.
    belief = Belief.prior(GRID.rows, GRID.cols, 4)
    in_time = story(within_s=72.1).state.task
    assert length_cells(first_route(in_time, belief).cells) == 8.0
    with pytest.raises(BoundTooTight):
        first_route(story(within_s=71.8).state.task, belief)


def test_a_vehicle_late_before_launch_takes_the_shortest_route() -> None:
    flight = story(within_s=50.0)
    flight(ev.Ready())
    assert length_cells(flight.swap().cells) == 8.0
    assert flight.state.plans.late_s == pytest.approx(71.9, abs=0.1)


def test_the_arrival_is_recorded_by_the_vehicles_clock() -> None:
    flight = flying(within_s=120.0)
    flight.over((0, 8), time_boot_s=181.5)
    assert flight.state.phase is Phase.LANDING
    assert flight.state.arrived_boot_s == 181.5


def straight(length: int) -> tuple[Cell, ...]:
    return tuple((0, col) for col in range(length + 1))


def test_the_time_of_a_swap_counts_if_both_routes_miss_the_bound() -> None:
    state = story().state
    bent = ((0, 0), (1, 1), *((1, col) for col in range(2, 7)), (0, 7), (0, 8))  # 8.83 cells
    problem = Problem(np.zeros((9, 9)), (0, 0), ((0, 8),), 0.5, 0.1, max_length_cells=8.2)
    route = route_of(problem, straight(8), 0.0)
    assert is_no_worse(state.task, problem, bent, route, Departure(swap_cost_cells=2.0))
    assert not is_no_worse(state.task, problem, bent, route, Departure(swap_cost_cells=0.1))


def test_between_centres_the_route_counts_from_the_vehicle_and_a_swap_flies_back() -> None:
    flight = flying(within_s=120.0)
    lat_deg, lon_deg = GRID.frame.to_geodetic(45.0, 25.0)  # 20 m past the centre of (0, 0)
    flight.over((0, 0), time_boot_s=130.0, lat_deg=lat_deg, lon_deg=lon_deg)
    at_once = leaving_at_once(flight.state)
    lead_in = lead_in_to(flight.state, at_once)
    assert lead_in.elapsed_s == pytest.approx(30.0)
    assert lead_in.lead_m == pytest.approx(-20.0, abs=0.01)
    braking_and_hold_m = 10.0 * (20.0 / 7.0 + 0.5)
    changed = swap_cost_cells(flight.state, lead_in, at_once)
    assert changed == pytest.approx((braking_and_hold_m + 40.0) / 50.0, abs=0.001)


TURNS = [
    ("straight on, begun at speed", [(0, 0), (100, 0), (900, 0)], 10.0, 0.0, 20.0 / 7.0),
    ("straight on, from a stop", [(0, 0), (900, 0)], 0.0, 0.0, START_LOSS_S + 20.0 / 7.0),
    ("over the goal cell before braking", [(0, 0), (900, 0)], 0.0, 100.0, 0.0),
    ("a turn between long legs", [(0, 0), (400, 0), (400, 400)], 10.0, 0.0, 20.0 / 7.0 + 3.46),
    ("a turn of half the angle", [(0, 0), (400, 0), (700, 300)], 10.0, 0.0, 20.0 / 7.0 + 1.64),
    ("a short leg", [(0, 0), (400, 0), (400, 40), (800, 40)], 10.0, 0.0, 10.17),
]


@pytest.mark.parametrize(
    ("track", "begins", "ends", "lost"), [row[1:] for row in TURNS], ids=[row[0] for row in TURNS]
)
def test_the_cost_of_braking_and_speeding_up(
    track: list[tuple[float, float]], begins: float, ends: float, lost: float
) -> None:
    assert lost_s(track, 10.0, initial_m_s=begins, remaining_m=ends, start_delay_s=1.9) == pytest.approx(
        lost, abs=0.05
    )


@pytest.mark.parametrize("leg", [leg for leg in FLOWN_LEGS if leg.turn_deg], ids=str)
def test_legs_take_as_long_as_in_flight_or_a_little_longer(leg: FlownLeg) -> None:
    flight = timed_track(leg.corners_m, leg.speed_m_s, start_delay_s=1.9)
    planned_s = flight.at(6.0 * leg.length_m)[1] - flight.at(5.0 * leg.length_m)[1]
    assert leg.duration_s - 0.05 <= planned_s <= 1.1 * leg.duration_s


def test_the_turns_of_a_detour_take_time() -> None:
    """From the next centre the detour has 6 + 3√2 cells (51.2 s), and a swap with a stop takes 3.4 s.

    Turns and speeding up cost more than the half cell at the goal saves.
    """
    for within_s, goes_around in ((68.0, False), (75.4, True)):
        flight = flying(at_s=10.0, within_s=within_s)
        flight.hear(*HOSTILES_ON_ROUTE)
        assert bool(swaps(flight.tick())) is goes_around
        assert flight.state.plans.late_s is None


@pytest.mark.parametrize(("stood_s", "goes_around"), [((), False), ((0.0, 0.1), True), ((0.1, 4.0), False)])
def test_a_swap_costs_the_measured_stop_of_the_last_swaps(
    stood_s: tuple[float, ...], goes_around: bool
) -> None:
    """For the detour of the test above, 72.4 s are enough only without a stop."""
    flight = flying(at_s=10.0, within_s=72.4)
    flight.state = replace(
        flight.state, plans=replace(flight.state.plans, swap_times=SwapTimes((1.0,) * len(stood_s), stood_s))
    )
    flight.hear(*HOSTILES_ON_ROUTE)
    assert bool(swaps(flight.tick())) is goes_around


@pytest.mark.parametrize(("within_s", "goes_around"), [(71.0, False), (74.4, True)])
def test_a_swap_costs_more_for_a_vehicle_that_brakes_without_standing(
    within_s: float, goes_around: bool
) -> None:
    """On the detour above, braking by 2.5 m/s² from 10 m/s costs 2 s.

    The vehicle then speeds up as from a stop.
    """
    flight = flying(at_s=10.0, within_s=within_s)
    vehicle = replace(flight.state.vehicle, brakes_m_s2=2.5)
    flight.state = replace(
        flight.state, vehicle=vehicle, plans=replace(flight.state.plans, swap_times=SwapTimes((1.0,), (0.0,)))
    )
    flight.hear(*HOSTILES_ON_ROUTE)
    assert bool(swaps(flight.tick())) is goes_around


def test_a_track_that_becomes_worse_than_its_route_is_planned_again() -> None:
    flight = Story(
        any_angle=ExposureMeasure.INTEGRAL,
        entry=(0, 0),
        goals=((3, 8),),
        strength=FiringStrength(0.9, 0.002, 0.001),
    )
    flight.launching()
    flight(ev.OrderDone(ev.FlightOrder.LAUNCH))
    flight.over((0, 0))
    flown = flight.state.plans.mission
    assert flown is not None
    assert flown.track is not None
    beside = [cell for cell in flown.track.over if cell not in flown.cells]
    assert beside
    flight.hear((8, 0, False))
    assert swaps(flight.tick()) == []
    assert (
        flight.state.plans.route_exposure is flight.state.plans.exposure
    )  # the exposure of the last comparison
    flight.hear((*beside[0], True), seq=2)
    swap = flight.swap()
    assert swap.track is not None
    assert beside[0] not in swap.track.over


def test_the_reported_arrival_time_never_rounds_to_the_bound() -> None:
    state = story(within_s=80.0).state
    state = replace(state, plans=replace(state.plans, late_s=80.004))
    assert "80.1 s" in state.late
    early = story(within_s=80.0, after_s=60.0).state
    early = replace(early, plans=replace(early.plans, late_s=59.999))
    assert "59.9 s" in early.late


def test_the_arrival_time_has_to_lie_within_both_bounds() -> None:
    state = story(within_s=80.0, after_s=60.0).state
    for arrived_s, kept in ((59.0, False), (60.0, True), (80.0, True), (81.0, False)):
        done = replace(state, launch=Launch(armed_boot_s=100.0), arrived_boot_s=100.0 + arrived_s)
        assert arrival_of(done)["arrival_bound_kept"] is kept
