"""What an agent does about its time bound, told as stories."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest
from test_agent import GRID, Story, orders

from swarmctl.agent import Arrival, Phase, first_route
from swarmctl.core import events as ev
from swarmctl.core.belief import Belief
from swarmctl.core.exposure import length_cells
from swarmctl.core.grid import Cell
from swarmctl.planners import PLANNERS, BoundTooTight, Method, Problem, Route
from swarmctl.planners.base import is_open, route_of

DIJKSTRA = PLANNERS["dijkstra"]


class EitherEnd:
    """A planner that keeps bounds and knows two routes, the least exposed and the shortest."""

    Params = DIJKSTRA.Params

    def plan(self, problem: Problem, params: Any, /) -> Route:
        ways = [DIJKSTRA.plan(replace(problem, w=w), params) for w in (1.0, 0.0)]
        for way in ways:
            if not math.isinf(cost := self.measure(problem, way.cells, params)):
                return route_of(problem, way.cells, cost)
        raise BoundTooTight("none in time", route_of(problem, ways[1].cells, ways[1].exposure_sum))

    def measure(self, problem: Problem, cells: Sequence[Cell], _params: Any, /) -> float:
        length = length_cells(cells)
        if not (is_open(problem, cells) and problem.min_length_cells <= length <= problem.max_length_cells):
            return math.inf
        return route_of(problem, cells, 0.0).exposure_sum


EITHER_END = Method("either end", EitherEnd(), DIJKSTRA.Params())
# Along the southern edge are 8 cells, 40 s: at first the shortest way and the least exposed one. Around
# hostiles in the middle of it are about 10 cells, 50 s.
IN_THE_WAY = ((0, 3, True), (0, 4, True), (0, 5, True))


def story(within_s: float = math.inf, after_s: float = 0.0, **changes: Any) -> Story:
    arrival = Arrival(10.0, after_s, within_s, approach_m=50.0)
    return Story(method=EITHER_END, arrival=arrival, entry=(0, 0), goals=((0, 8),), **changes)


def flying(at_s: float = 20.0, **bounds: float) -> Story:
    """Launched at 0 s by its own clock, over its entry cell at `at_s`."""
    told = story(**bounds).launching()
    told.over((0, 0), time_boot_s=100.0)
    told(ev.OrderDone(ev.Order.LAUNCH))
    told.over((0, 0), time_boot_s=100.0 + at_s)
    assert told.state.phase is Phase.FLYING
    return told


def swaps(effects: list[ev.Effect]) -> list[ev.SwapMission]:
    return [effect for effect in effects if isinstance(effect, ev.SwapMission)]


def test_the_bound_counts_from_when_it_is_first_seen_armed() -> None:
    told = story(within_s=90.0).launching()
    told.over((0, 0), time_boot_s=300.0, armed=False)
    assert told.state.launched_boot_s is None
    told.over((0, 0), time_boot_s=310.0)
    told.over((0, 0), time_boot_s=320.0)
    assert told.state.launched_boot_s == 310.0


def test_with_time_enough_it_goes_around_and_without_it_goes_straight() -> None:
    for within_s, length in ((120.0, 9.0), (70.0, 8.0)):
        told = flying(within_s=within_s)
        told.hear(*IN_THE_WAY)
        cells = swap.cells if (swap := next(iter(swaps(told.tick())), None)) else told.state.route.cells
        assert (length_cells(cells) > 8.0) == (length > 8.0)
        assert told.state.late == ""


def test_what_passes_on_the_way_is_taken_from_the_bound() -> None:
    early, late = flying(within_s=85.0), flying(at_s=40.0, within_s=85.0)
    for told in (early, late):
        told.hear(*IN_THE_WAY)
    assert length_cells(early.swap().cells) > 8.0
    assert swaps(late.tick()) == []


def test_late_it_flies_on_and_says_so_once() -> None:
    told = flying(at_s=60.0, within_s=80.0)
    told.hear((0, 4, True))
    assert swaps(told.tick()) == []  # the straight way it flies is the least late
    assert told.state.late == "no route meets its bound of 80 s any more; over its goal after 97.5 s"
    said = told.state.late
    told.over((0, 1), time_boot_s=170.0)
    told.hear((0, 5, True), seq=2)
    told.tick()
    assert told.state.late == said
    assert told.state.phase is Phase.FLYING
    assert orders(told.effects) == []


def test_the_way_around_it_flies_is_left_when_it_has_become_too_long() -> None:
    told = flying(within_s=120.0)
    told.hear(*IN_THE_WAY)
    around = told.swap()
    told.accept()
    # It has been held up: what was in time is so no more, and straight on is the least late.
    told.over(around.cells[1], time_boot_s=198.0)
    told.hear((8, 0, False), seq=2)
    straight = told.swap()
    assert length_cells(straight.cells) < length_cells(around.cells[1:])


def test_a_change_that_costs_more_time_than_it_saves_is_not_made() -> None:
    told = flying(within_s=80.0)
    told.hear(*IN_THE_WAY)
    told.tick()
    before = told.state.route
    # 60 s are left for 60 s of way: just in time if nothing is changed.
    told.over((0, 0), time_boot_s=140.0)
    told.hear((8, 8, False), seq=2)
    assert swaps(told.tick()) == []
    assert told.state.route is before


def test_a_wall_on_its_way_is_left_even_if_that_makes_it_late() -> None:
    told = story(within_s=70.0, max_exposure=0.5).launching()
    told.over((0, 0), time_boot_s=100.0)
    told(ev.OrderDone(ev.Order.LAUNCH))
    told.over((0, 0), time_boot_s=129.0)
    told.hear((0, 4, True))
    swap = told.swap()
    assert (0, 4) not in swap.cells
    assert told.state.late != ""


def test_a_route_that_would_arrive_too_early_is_left_for_one_that_does_not() -> None:
    told = flying(after_s=64.0, within_s=120.0)
    assert told.state.late == "no route meets its bound of 64 to 120 s any more; over its goal after 54.5 s"
    told.hear(*IN_THE_WAY)
    assert length_cells(told.swap().cells) > 9.5
    assert told.state.late == ""


def test_what_is_planned_on_the_ground_allows_for_climb_and_approach() -> None:
    # 40 s across, 12 s to climb 30 m, 5 s to the entry.
    belief = Belief.prior(GRID.rows, GRID.cols, 4)
    in_time = story(within_s=57.5).state.task
    assert length_cells(first_route(in_time, belief).cells) == 8.0
    with pytest.raises(BoundTooTight):
        first_route(story(within_s=56.5).state.task, belief)


def test_late_before_the_launch_it_takes_the_shortest_way() -> None:
    told = story(within_s=50.0)
    told(ev.Ready())
    assert length_cells(told.swap().cells) == 8.0
    assert told.state.late == "no route meets its bound of 50 s any more; over its goal after 54.5 s"


def test_the_arrival_is_noted_by_the_vehicles_own_clock() -> None:
    told = flying(within_s=120.0)
    told.over((0, 8), time_boot_s=181.5)
    assert told.state.phase is Phase.LANDING
    assert told.state.arrived_boot_s == 181.5
