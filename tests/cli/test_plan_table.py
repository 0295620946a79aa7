"""`swarmctl plan` without `--front`: its table has the routes that the vehicles would fly."""

from __future__ import annotations

import math

import pytest
from flights import AREA, small
from group_flights import group
from rich.table import Table

from swarmctl.agent.replan.length_bounds import before_takeoff
from swarmctl.agent.state import Task, initial_state
from swarmctl.agent.step import step
from swarmctl.config.scenario import Scenario
from swarmctl.core import events as ev
from swarmctl.core.any_angle.corners import ExposureMeasure
from swarmctl.core.planned_mission import PlannedMission
from swarmctl.core.records import replace
from swarmctl.report.first_plans import first_routes, plan_table, planned_shapes
from swarmctl.report.tables import estimate_texts, product_text

LARGER = {**AREA, "rows": 16, "cols": 16}
PULLED = {"any_angle": True, "any_angle_exposure": "integral"}


def rows_of(table: Table) -> list[list[str]]:
    return [list(map(str, row)) for row in zip(*(column.cells for column in table.columns), strict=True)]


def table_of(scenario: Scenario) -> list[list[str]]:
    return rows_of(plan_table(scenario, first_routes(scenario)).at())


def first_mission(task: Task, scenario: Scenario) -> PlannedMission:
    """Return the agent's decision before the vehicle takes off."""
    state, _ = step(initial_state(task, scenario.prior), ev.Ready(), 0.0)
    _, (swap,) = step(state, ev.Tick(), 1.0)
    assert isinstance(swap, ev.SwapMission)
    return swap.mission


@pytest.mark.parametrize("flight", [{}, {"any_angle": True}, PULLED], ids=["lattice", "entered", "integral"])
def test_each_row_has_the_route_of_an_agent_with_that_w(flight: dict[str, object]) -> None:
    scenario = small(area=LARGER, threats={"count": 14}, flight=flight)
    rows = iter(table_of(scenario))
    n_pulled = 0
    for task in scenario.tasks:
        for w in (0.0, 0.5, 1.0):
            swap = first_mission(replace(task, w=w), scenario)
            entered = swap.cells if swap.track is None else swap.track.over
            n_pulled += entered != swap.cells
            chance = scenario.survival_probability(task.uav, scenario.prior, task.strength, entered)
            _, *row, mark = next(rows)
            assert row == [
                f"{w:g}",
                f"{swap.length_m:.0f}",
                f"{swap.exposure_sum:.3f}",
                f"{swap.safety_factor:.4f}",
                *estimate_texts(chance),
            ]
            assert bool(mark) == (w == 0.5)
    assert (n_pulled > 0) == (flight == PULLED)


def test_the_weights_are_in_numerical_order() -> None:
    output = table_of(small(planner={"w": 1e-5}, simulate={"count": 1}))
    assert [row[1] for row in output] == ["0", "1e-05", "0.5", "1"]


def test_a_time_bound_is_for_the_configured_route_alone() -> None:
    crossing = {"area": LARGER, "threats": {"count": 14}, "planner": {"name": "constrained"}}
    free = small(**crossing, simulate={"count": 3})
    # The bound is the time straight across the area, and a little for the take-off.
    within_s = max(
        before_takeoff(t.arrival, t.altitude_m, t.start_delay_s).arrives_s(t.arrival, 750.0)
        for t in free.tasks
    )
    bounded = small(**crossing, simulate={"count": 3, "arrive_within_s": within_s + 2.0})
    papers, others = (
        [
            [row for row in table_of(scenario) if (row[1] == "constrained") == is_own]
            for scenario in (free, bounded)
        ]
        for is_own in (False, True)
    )
    assert papers[0] == papers[1]
    assert max(int(row[2]) for row in papers[0]) > 760
    assert [row[2] for row in others[1]] == ["750"] * 3
    assert others[0] != others[1]


def test_a_route_whose_turns_are_too_tight_has_no_numbers() -> None:
    scenario = small(
        area={**AREA, "no_fly": [[4, col] for col in range(7)]},
        flight=PULLED,
        simulate=None,
        vehicles=[
            {
                "name": "plane",
                "url": "udpin://127.0.0.1:14550",
                "sysid": 1,
                "start": {"lat_deg": 46.0009, "lon_deg": 14.399},
                "goal": [7, 0],
                "turn_radius_m": 399.0,
            }
        ],
    )
    for row in table_of(scenario):
        assert row[2:6] == ["–"] * 4
        assert "399 m" in row[-1]


PRODUCTS = [
    (0.0, "0"),
    (1.41e-24, "1.41e-24"),
    (3.4216e-5, "3.42e-05"),
    (0.00034216, "0.000342"),
    (0.001, "0.0010"),
    (0.0702, "0.0702"),
    (1.0, "1.0000"),
]


@pytest.mark.parametrize(("value", "text"), PRODUCTS)
def test_only_a_product_of_0_is_printed_as_0(value: float, text: str) -> None:
    assert product_text(value) == text


def test_the_default_any_angle_measure_is_the_entered_exposure() -> None:
    (task,) = small(flight={"any_angle": True}, simulate={"count": 1}).tasks
    assert task.any_angle is ExposureMeasure.ENTERED


def test_a_planned_group_flies_in_its_shape_until_near_its_goal() -> None:
    scenario = group()  # a wedge of 30 m between members, at 10 m/s
    leader, *others = first_routes(scenario)[scenario.chosen_by]
    shapes = [[scenario.grid.frame.to_local(*place) for place in places] for places in planned_shapes(leader)]
    assert [list(planned_shapes(other)) for other in others] == [[], []]
    assert len(shapes) >= 2
    for first, right, left in shapes:
        assert math.dist(first, right) == pytest.approx(30.0)
        assert math.dist(first, left) == pytest.approx(30.0)
    assert shapes[1][0][0] - shapes[0][0][0] == pytest.approx(200.0, abs=10.0)
