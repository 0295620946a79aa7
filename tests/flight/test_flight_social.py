"""Flights with autonomy and benevolence, and what a vehicle weighs by them."""

import json
from pathlib import Path

import numpy as np
import pytest
from flights import fly, small

from swarmctl.agent.replan.decide import believed_exposure, first_problem
from swarmctl.agent.state import initial_state
from swarmctl.agent.step import step
from swarmctl.config.checks import check_config
from swarmctl.config.scenario import Scenario
from swarmctl.core import events as ev
from swarmctl.core.frames import IntentPoint, IntentShared
from swarmctl.core.observation import Observation
from swarmctl.report import record

SILENT = {"bus": "memory", "range": 0}


@pytest.mark.parametrize(
    "planner",
    [
        {"autonomy": 0.6, "benevolence": 0.6},
        pytest.param({"autonomy": 1.0}, marks=pytest.mark.full),
        pytest.param({"benevolence": 1.0}, marks=pytest.mark.full),
    ],
)
def test_a_flight_arrives_and_is_decided_again_in_the_same_way(
    tmp_path: Path, planner: dict[str, float]
) -> None:
    report = fly(small(planner=planner), tmp_path)
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["arrived"] == 3
    assert {key: summary["configuration"]["planner"].get(key) for key in planner} == planner
    assert record.replay(tmp_path / "run.mcap").difference == ""
    assert report.bug is None


def own_and_told(autonomy: float) -> tuple[Scenario, np.ndarray]:
    """Return the scenario, and P_s of a vehicle that saw (2, 2) clear and was told a hostile in (5, 5)."""
    scenario = small(planner={"autonomy": autonomy})
    state = initial_state(scenario.tasks[0], scenario.prior)
    state, _ = step(state, ev.Observed(((2, 2, False),)), 1.0)
    told = Observation(2, 1, 1.0, ((5, 5, True),))
    state, _ = step(state, ev.ObservationsReceived((told,)), 2.0)
    return scenario, believed_exposure(state.task, state.belief, state.strength, state.own)


def test_autonomy_blends_what_was_seen_with_what_was_told() -> None:
    (_, paper), (_, alone), (_, half) = (own_and_told(a) for a in (0.0, 1.0, 0.5))
    assert half == pytest.approx(0.5 * paper + 0.5 * alone)
    # 5 hostiles in 64 cells, one cell seen clear: nobody has told this vehicle anything.
    assert alone[5, 5] == pytest.approx(5 / 63 * 2.2)
    assert paper[5, 5] == pytest.approx(0.6 + 4 / 62 * 1.6)
    assert alone[2, 2] == pytest.approx(5 / 63 * 1.6)


def test_an_autonomous_vehicle_observes_again_what_it_was_only_told() -> None:
    def told_then_seen(autonomy: float) -> list[ev.Effect]:
        scenario = small(planner={"autonomy": autonomy})
        state = initial_state(scenario.tasks[0], scenario.prior)
        told = Observation(2, 1, 1.0, ((5, 5, True),))
        state, _ = step(state, ev.ObservationsReceived((told,)), 1.0)
        return step(state, ev.Observed(((5, 5, True),)), 2.0)[1]

    assert told_then_seen(0.0) == []
    (sent,) = told_then_seen(0.1)
    assert isinstance(sent, ev.Publish)


def test_benevolence_knows_the_others_by_configuration_and_then_by_their_intents() -> None:
    scenario = small(planner={"benevolence": 0.5})
    task = scenario.tasks[0]
    assert sorted(task.others) == [2, 3]
    grid = task.grid
    state = initial_state(task, scenario.prior)

    def heading_for(*cells: tuple[int, int]) -> IntentShared:
        centres = [grid.frame.to_geodetic(*grid.centre_m(cell)) for cell in cells]
        return IntentShared(1, tuple(IntentPoint(10.0 * k, *at, 300.0) for k, at in enumerate(centres)))

    def told(intent: IntentShared) -> ev.TelemetryReceived:
        return ev.TelemetryReceived(state.vehicle, intents=((2, 0.0, intent),))

    state, _ = step(state, told(heading_for((4, 3), (4, 7))), 1.0)
    assert (state.others[2].cell, state.others[3].cell) == ((4, 3), task.others[3].cell)
    state, _ = step(state, told(IntentShared(0)), 2.0)
    assert sorted(state.others) == [3]


@pytest.mark.parametrize(
    "sections",
    [
        {"communication": SILENT, "planner": {"benevolence": 0.5}},
        {"simulate": {"count": 1, "ready_s": 3.0}, "planner": {"benevolence": 0.5}},
        {"planner": {"autonomy": 0.5}},
    ],
)
def test_nobody_to_learn_from_a_route_means_no_gain(sections: dict[str, object]) -> None:
    scenario = small(**sections)
    assert first_problem(scenario.tasks[0], scenario.prior).gain is None


@pytest.mark.parametrize(
    "sections",
    [
        {"planner": {"benevolence": 0.5, "name": "survival"}},
        {"planner": {"benevolence": 0.5}, "flight": {"altitude_m": 15.0, "any_angle": True}},
    ],
)
def test_benevolence_is_refused_where_it_has_no_meaning(sections: dict[str, object]) -> None:
    problems = list(check_config(small(**sections).config))
    assert ("planner", "benevolence") in [problem.path for problem in problems]
