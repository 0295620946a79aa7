"""Routes with other weights, compared with the planners on the same belief."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from flights import small

from swarmctl.config.scenario import Scenario
from swarmctl.core.exposure import exposure, exposure_sum
from swarmctl.core.records import replace
from swarmctl.core.threat import FiringStrength
from swarmctl.dashboard.model import Timeline
from swarmctl.dashboard.sources.mission import replayed
from swarmctl.dashboard.what_if import (
    NoAnswer,
    Question,
    Weights,
    front_of,
    question_of,
    route_with,
    weights_of,
)
from swarmctl.study.world import World

STRENGTH = FiringStrength(0.6, 0.3, 0.1)


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return small(simulate={"count": 2})


@pytest.fixture(scope="module")
def timeline(scenario: Scenario) -> Timeline:
    return replayed(scenario, World.drawn(scenario, 3))[0]


@pytest.fixture
def question(timeline: Timeline) -> Question:
    return question_of(timeline, "uav1", 30.0)


def test_with_the_weights_flown_the_route_is_that_of_the_vehicle(timeline: Timeline) -> None:
    compared = 0
    for change in timeline.changes.items:
        question = question_of(timeline, change.vehicle, change.time_s)
        if change.new.cells[0] != question.cell:
            continue
        route = route_with(question, weights_of(timeline, change.vehicle, change.time_s))
        assert route.cells == change.new.cells
        compared += 1
    assert compared > 2


def test_w_0_gives_the_shortest_route_and_w_1_the_least_exposed(question: Question) -> None:
    by_w = [route_with(question, Weights(w, STRENGTH)) for w in (0.0, 0.25, 0.5, 0.75, 1.0)]
    lengths = [route.length_m for route in by_w]
    sums = [route.exposure_sum for route in by_w]
    assert all(a <= b + 1e-9 for a, b in pairwise(lengths))
    assert all(a >= b - 1e-9 for a, b in pairwise(sums))
    assert sums[0] > sums[-1]


def test_the_sum_is_that_of_the_strengths_of_the_sliders(question: Question) -> None:
    strength = FiringStrength(0.9, 0.2, 0.0)
    route = route_with(question, Weights(0.5, strength))
    assert route.exposure_sum == pytest.approx(
        exposure_sum(exposure(question.occupancy, strength), route.cells)
    )


def test_each_route_of_the_front_with_a_w_is_found_by_it(question: Question) -> None:
    front, routes = front_of(question, Weights(0.5, STRENGTH))
    assert len(routes) > 1
    for route, ends in zip(routes, front.w_ranges, strict=True):
        if ends is not None and ends[0] < ends[1]:
            found = route_with(question, Weights(float(np.mean(ends)), STRENGTH))
            assert (found.length_m, found.exposure_sum) == pytest.approx((route.length_m, route.exposure_sum))


def test_before_the_first_word_the_route_begins_in_the_entry_cell(scenario: Scenario) -> None:
    question = question_of(Timeline(scenario, "record"), "uav2", 0.0)
    assert route_with(question, Weights(0.5, STRENGTH)).cells[0] == scenario.tasks[1].entry


def test_a_vehicle_of_another_configuration_has_no_answer(scenario: Scenario) -> None:
    alone = replace(scenario, specs=scenario.specs[:1], tasks=scenario.tasks[:1])
    with pytest.raises(NoAnswer, match="uav2"):
        question_of(Timeline(alone, "record"), "uav2", 0.0)
