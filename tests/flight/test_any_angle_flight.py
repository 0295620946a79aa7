"""Routes pulled straight, from the configuration to vehicles that fly them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from agent_stories import Story, swaps
from flights import AREA, fly, small
from recorded import effects

from swarmctl.agent.commands import RETRY_AFTER_S
from swarmctl.agent.phases import Phase
from swarmctl.agent.replan.decide import first_flight, first_problem, first_route
from swarmctl.agent.replan.route_to_mission import flown_route, pulled_track
from swarmctl.agent.state import initial_state
from swarmctl.agent.step import step
from swarmctl.bus.node.exchange import NetworkCounters
from swarmctl.config import model
from swarmctl.config.checks import check_config
from swarmctl.config.model import ConfigError
from swarmctl.config.scenario import Scenario, build
from swarmctl.core import events as ev
from swarmctl.core.any_angle.corners import ExposureMeasure
from swarmctl.core.any_angle.pull import Track
from swarmctl.core.exposure import exposure_sum, length_cells
from swarmctl.core.grid import Cell
from swarmctl.core.observation import Observation
from swarmctl.core.planned_mission import PlannedMission
from swarmctl.core.records import replace
from swarmctl.core.route import ends_and_turns, flight_plan
from swarmctl.planners import Problem
from swarmctl.report import first_plans, outputs, record
from swarmctl.report.summary import FlightStatistics, TakeoffPlan, summary

BOTH = pytest.mark.parametrize(
    "counting", [ExposureMeasure.INTEGRAL, pytest.param(ExposureMeasure.ENTERED, marks=pytest.mark.full)]
)
LARGER = {**AREA, "rows": 16, "cols": 16}
ON = {"any_angle": True}


def scenario(counting: ExposureMeasure | None, seed: int = 3) -> Scenario:
    flight = {} if counting is None else {**ON, "any_angle_exposure": counting}
    return small(seed=seed, area=LARGER, threats={"count": 14}, flight=flight)


def missions(folder: Path) -> list[dict[str, Any]]:
    """Return every mission sent to a vehicle, in the order of the record."""
    return [recorded["effect"]["mission"] for recorded in effects(folder, "SwapMission")]


def n_items(folder: Path) -> float:
    return float(np.mean([len(mission["plan"]["track"]) for mission in missions(folder)]))


@pytest.fixture(scope="module")
def lattice(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("lattice")
    report = fly(scenario(None), folder)
    assert report.all_arrived
    return folder


@pytest.mark.virtual
@BOTH
def test_a_swarm_on_pulled_tracks_arrives_with_shorter_missions(
    counting: ExposureMeasure, lattice: Path, tmp_path: Path
) -> None:
    report = fly(scenario(counting), tmp_path)
    assert report.trouble == ()
    assert report.all_arrived
    assert n_items(tmp_path) < n_items(lattice)
    n_straight = 0
    for mission in missions(tmp_path):
        track, cells = mission["track"], [tuple(cell) for cell in mission["cells"]]
        assert len(track["corners"]) <= len(ends_and_turns(cells))
        assert mission["length_m"] <= length_cells(cells) * 50.0 + 1e-6
        n_straight += len(track["corners"]) < len(ends_and_turns(cells))
    assert n_straight > 0
    verdict = record.replay(tmp_path / "run.mcap")
    assert verdict.difference == ""


@pytest.mark.virtual
def test_without_any_angle_the_lattice_route_is_flown_unchanged(lattice: Path) -> None:
    tasks = scenario(None).tasks
    firsts = missions(lattice)[: len(tasks)]
    assert {mission["plan_id"] for mission in firsts} == {1}
    for task, mission in zip(tasks, firsts, strict=True):
        assert mission["track"] is None
        cells = [tuple(cell) for cell in mission["cells"]]
        landing = task.landing_spot(cells[-1])
        plan = flight_plan(task.grid, cells, altitude_m=task.altitude_m, landing_lat_lon=landing)
        sent = [(p["lat_deg"], p["lon_deg"], p["alt_rel_m"]) for p in mission["plan"]["track"]]
        assert sent == [(p.lat_deg, p.lon_deg, p.alt_rel_m) for p in plan.track]


@pytest.mark.parametrize("seed", range(1, 6))
def test_a_first_track_is_no_worse_than_its_route(seed: int) -> None:
    for task in scenario(ExposureMeasure.ENTERED, seed).tasks:
        state = initial_state(task, scenario(ExposureMeasure.ENTERED, seed).prior)
        state, _ = step(state, ev.Ready(), 0.0)
        state, (effect,) = step(state, ev.Tick(), 1.0)
        assert isinstance(effect, ev.SwapMission)
        swap = effect.mission
        assert swap.track is not None
        p_s = state.plans.exposure
        assert p_s is not None
        assert sum(p_s[cell] for cell in swap.track.over[1:]) <= exposure_sum(p_s, swap.cells) + 1e-7
        assert swap.exposure_sum == pytest.approx(sum(p_s[cell] for cell in swap.track.over[1:]))
        assert swap.length_m <= length_cells(swap.cells) * task.grid.cell_size_m + 1e-6


def test_a_route_that_must_not_be_too_short_is_not_pulled() -> None:
    task = scenario(ExposureMeasure.INTEGRAL).tasks[0]
    p_s = np.full((16, 16), 0.1)
    problem = Problem(p_s, (0, 0), ((1, 2),), 0.5, 0.1)
    route = task.method.plan(problem)
    track = pulled_track(task, problem, route)
    assert track is not None
    assert track.corners == ((0, 0), (1, 2))
    assert pulled_track(task, replace(problem, min_length_cells=2.3), route) is None


def test_the_chance_at_take_off_is_computed_for_the_track_with_the_belief_at_take_off() -> None:
    plain = scenario(ExposureMeasure.INTEGRAL)
    task = plain.tasks[0]
    seen = Observation(9, 1, 0.0, tuple((12, col, (12, col) in plain.hostiles) for col in range(16)))
    belief = plain.prior.merge((seen,))
    state, _ = step(initial_state(task, belief), ev.Ready(), 0.0)
    _, (effect,) = step(state, ev.Tick(), 1.0)
    assert isinstance(effect, ev.SwapMission)
    swap = effect.mission
    assert swap.track is not None
    assert swap.track.over != swap.cells
    statistics = FlightStatistics()
    statistics.vehicles[task.uav].takeoff_plan = TakeoffPlan(swap, belief, task.strength)
    states = {t.uav: initial_state(t, plain.prior) for t in plain.tasks}
    networks = {t.uav: NetworkCounters() for t in plain.tasks}
    content = summary(
        plain,
        states,
        statistics,
        clock="virtual",
        speedup=1.0,
        wall_s=None,
        commands={},
        networks=networks,
        payload_reports={},
    )
    promised = content["vehicles"][0]["at_takeoff"]
    chances = [
        plain.survival_probability(task.uav, held, task.strength, cells).estimate
        for held in (belief, plain.prior)
        for cells in (swap.track.over, swap.cells)
    ]
    assert len(set(chances)) == 4
    assert promised["chance_by_simulation"]["estimate"] == chances[0]
    assert promised["exposure_sum"] == swap.track.exposure_sum
    assert promised["length_m"] == pytest.approx(swap.track.length_cells * 50.0)


def losing_turns(planner: str) -> set[tuple[Cell, ...]]:
    """Return the corners, at w = 0 and w = 1, of the track of a vehicle with wide turns."""
    plain = small(area=LARGER, threats={"count": 14}, planner={"name": planner}, flight=ON)
    task = replace(plain.tasks[0], turn_radius_m=60.0)
    problem = Problem(0.9 * np.random.default_rng(0).random((16, 16)), (3, 0), ((3, 12),), 1.0, 0.1)
    route = scenario(ExposureMeasure.ENTERED).tasks[0].method.plan(problem)
    return {flown_route(task, replace(problem, w=w), route).corners for w in (0.0, 1.0)}


def test_w_weighs_turns_only_for_planners_that_use_it() -> None:
    assert len(losing_turns("dijkstra")) == 2
    assert len(losing_turns("constrained")) == 1
    assert losing_turns("constrained") < losing_turns("dijkstra")


# --- one vehicle under way


def on_a_skew_track() -> tuple[Story, PlannedMission, Track]:
    """Return a vehicle that flies a skew track over cells known to be clear, its mission and its track."""
    plain, story = scenario(ExposureMeasure.ENTERED), Story()
    story.state = initial_state(replace(plain.tasks[0], entry=(0, 0), goals=((5, 14),)), plain.prior)
    story.hear(*((row, col, False) for row in range(8) for col in range(16)), observer=9)
    story.launching()
    story(ev.OrderDone(ev.FlightOrder.LAUNCH))
    mission = story.state.plans.mission
    assert mission is not None
    assert mission.track is not None
    return story, mission, mission.track


def test_observations_elsewhere_change_no_mission_at_any_point_of_the_track() -> None:
    story, mission, track = on_a_skew_track()
    assert track.corners == ((0, 0), (5, 14))
    assert set(track.over) - set(mission.cells)
    progress = []
    for n, cell in enumerate(track.over[:-1]):
        story.over(cell, ground_speed_m_s=10.0)
        story.hear((12, n % 16, False), seq=n + 1)
        assert swaps(story.tick()) == [], cell
        assert story.state.progress is not None
        progress.append(story.state.progress.cell_index)
    assert progress == sorted(progress)
    assert progress[0] == 0
    assert progress[-1] >= len(mission.cells) - 3


def test_a_wall_of_threats_ahead_on_the_track_changes_the_mission() -> None:
    story, mission, track = on_a_skew_track()
    beside = [c for c in track.over if c not in mission.cells]
    for cell in track.over[: track.over.index(beside[0]) + 1]:
        story.over(cell, ground_speed_m_s=10.0)
    task = replace(story.state.task, no_fly=frozenset({beside[-1]}))
    story.state = replace(story.state, task=task, plans=story.state.plans.due())
    swap = story.swap()
    assert swap.track is not None
    assert swap.cells[0] in track.over
    assert beside[-1] not in swap.track.over
    # The change fails: the vehicle stays on its old plan, and that plan still needs a change.
    story(ev.MissionFailed(swap.plan_id, "old", "no answer"))
    story.now += RETRY_AFTER_S
    assert story.swap().cells == swap.cells


def test_a_vehicle_on_a_pulled_track_arrives_over_its_goal() -> None:
    story, _, track = on_a_skew_track()
    for cell in track.over:
        story.over(cell, ground_speed_m_s=10.0)
    assert story.state.phase is Phase.LANDING
    assert story.state.flown.cells == track.over


# --- configuration

FILE = """
area: {{origin_lat_deg: 46.0, origin_lon_deg: 14.4, rows: 8, cols: 8, cell_size_m: 50.0}}
threats: {{count: 5}}
flight: {flight}
vehicles:
  - name: plane
    url: udpin://127.0.0.1:14550
    sysid: 1
    start: {{lat_deg: 46.0009, lon_deg: 14.3990}}
    goal: {goal}
    turn_radius_m: {radius}
"""


def written(folder: Path, flight: str, radius: float, goal: str = "[5, 7]") -> Path:
    path = folder / "swarm.yaml"
    path.write_text(FILE.format(flight=flight, radius=radius, goal=goal), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("flight", "radius", "part"),
    [
        ("{any_angle: false}", 60.0, "vehicles[0].turn_radius_m: "),
        ("{any_angle: true}", 500.0, "vehicles[0].turn_radius_m: 500 m "),
        ("{any_angle: true}", -1.0, "vehicles[0].turn_radius_m: input should be greater than or equal to 0"),
        ("{any_angle: 1}", 0.0, "flight.any_angle: input should be a valid boolean"),
        (
            "{any_angle_exposure: some}",
            0.0,
            "flight.any_angle_exposure: input should be 'entered' or 'integral'",
        ),
    ],
)
def test_invalid_any_angle_settings_are_refused(
    tmp_path: Path, flight: str, radius: float, part: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        model.load(written(tmp_path, flight, radius), check_config)
    assert [part in line for line in caught.value.lines] == [True], caught.value.lines


def test_a_route_with_turns_too_tight_is_refused_at_loading(tmp_path: Path) -> None:
    path = written(tmp_path, "{any_angle: true}", 399.0, "[7, 0]")
    text = path.read_text().replace(
        "cell_size_m: 50.0}", f"cell_size_m: 50.0, no_fly: {[[4, col] for col in range(7)]}}}"
    )
    path.write_text(text)
    with pytest.raises(ConfigError, match=r"turn_radius_m: plane .* 399 m"):
        model.load(path, check_config)


def test_a_vehicle_with_a_turn_radius_gets_turns_that_it_can_fly(tmp_path: Path) -> None:
    scenario = build(model.load(written(tmp_path, "{any_angle: true}", 80.0), check_config))
    (task,) = scenario.tasks
    assert task.turn_radius_m == 80.0
    plan = first_flight(task, first_problem(task, scenario.prior), first_route(task, scenario.prior))
    points = [task.grid.frame.to_local(p.lat_deg, p.lon_deg) for p in plan.track]
    for before, corner, after in zip(points, points[1:], points[2:], strict=False):
        come, go = (math.atan2(b[1] - a[1], b[0] - a[0]) for a, b in ((before, corner), (corner, after)))
        turn = abs((go - come + math.pi) % (2 * math.pi) - math.pi)
        room = min(math.dist(before, corner), math.dist(corner, after))
        assert 80.0 * math.tan(turn / 2) <= room + 1e-6
    outputs.write_plans(tmp_path, scenario, first_plans.first_routes(scenario))
    assert (tmp_path / "map.png").exists()
