"""The abstract mission from the outside: what vehicles fly, are told, and are struck by."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from flights import small

from swarmctl.config.scenario import Scenario
from swarmctl.core.exposure import exposure, exposure_sum, length_cells
from swarmctl.core.records import replace
from swarmctl.study.mission import fly_mission
from swarmctl.study.vehicle_result import MissionResult
from swarmctl.study.world import World, uniform


def mission(scenario: Scenario, seed: int = 3) -> MissionResult:
    return fly_mission(scenario, World.drawn(scenario, seed))


def with_network(**keys: object) -> Scenario:
    return small(communication={"bus": "memory", **keys})


def test_a_seed_has_the_hostiles_of_its_flight() -> None:
    for seed in range(5):
        assert World.drawn(small(), seed).hostiles == small(seed=seed).hostiles


def test_draws_are_uniform_and_do_not_change_between_versions() -> None:
    draws = np.array([uniform(7, 1, uav, cell, 3, 1) for uav in range(1, 21) for cell in range(500)])
    assert uniform(7, 1, 2, 3) == 0.10123025561781762
    assert abs(draws.mean() - 0.5) < 4.0 / math.sqrt(12.0 * draws.size)
    assert len(set(draws)) == draws.size


def test_a_silent_vehicle_flies_as_if_it_were_alone() -> None:
    scenario = with_network(range=0)
    together = mission(scenario)
    for i, spec in enumerate(scenario.specs):
        alone = mission(scenario.only(spec.sysid))
        assert alone.tracks == (together.tracks[i],)
        expected = replace(together.rows[i], arrival_s=alone.rows[0].arrival_s)
        assert alone.rows == (expected,)
        assert alone.rows[0].messages_sent == alone.rows[0].messages_received == 0


def test_tracks_lead_over_neighbouring_cells_to_the_goal_and_give_the_measures() -> None:
    scenario = small()
    world = World.drawn(scenario, 4)
    p_s = exposure(world.occupancy(), scenario.strength)
    result = fly_mission(scenario, world)
    for row, track, strikes, task in zip(
        result.rows, result.tracks, result.strikes, scenario.tasks, strict=True
    ):
        assert row.arrived
        assert track[0] == task.entry
        assert track[-1] in task.goals
        assert row.length_cells == length_cells(track)
        assert row.exposure_sum == exposure_sum(p_s, track)
        assert row.strikes == sum(strikes)
        assert row.survived == (row.strikes == 0)


def test_strikes_are_as_frequent_as_equation_1_says() -> None:
    scenario = small(planner={"w": 0.0})
    strikes, expected = [], []
    for seed in range(60):
        world = World.drawn(scenario, seed)
        result = fly_mission(scenario, world)
        p_s = exposure(world.occupancy(), scenario.strength)
        strikes += [row.strikes for row in result.rows]
        expected += [sum(float(p_s[cell]) for cell in track) for track in result.tracks]
    error = 4.0 * math.sqrt(sum(expected)) / len(expected)  # a sum of draws varies less than a Poisson number
    assert abs(np.mean(strikes) - np.mean(expected)) < error


def test_without_loss_everybody_ends_with_the_same_knowledge() -> None:
    rows = mission(small()).rows
    assert len({(row.cells_known, row.hostiles_known) for row in rows}) == 1
    assert all(row.messages_sent > 0 and row.messages_received > 0 for row in rows)


def test_lost_messages_stay_lost_and_relays_bring_news_of_others() -> None:
    full, near = mission(small()), mission(with_network(range=1))
    relayed = mission(with_network(range=1, relay=True))
    lossy = mission(with_network(loss=0.9))
    known = [sum(row.cells_known for row in result.rows) for result in (full, relayed, near)]
    assert known[0] >= known[1] > known[2]
    assert sum(r.messages_received for r in lossy.rows) < sum(r.messages_sent for r in lossy.rows)


@pytest.mark.parametrize(
    "keys", [{"max_distance_m": 1.0}, {"min_distance_m": 5000.0}, {"quiet": [{"uavs": [1, 2, 3]}]}]
)
def test_a_radio_that_reaches_nobody_is_silence(keys: dict[str, object]) -> None:
    result = mission(with_network(**keys))
    assert all(row.messages_received == 0 for row in result.rows)
    assert result.tracks == mission(with_network(range=0)).tracks


def test_a_later_vehicle_profits_from_what_the_first_saw() -> None:
    content = {"count": 3, "ready_s": 3.0, "delay_step_s": 120.0, "goal": [4, 7]}
    first, last = (mission(small(simulate=content)).rows[i] for i in (0, 2))
    assert last.arrival_s > first.arrival_s + 200.0
    assert last.messages_received > 0
    assert last.messages_sent < first.messages_sent


@pytest.mark.parametrize(
    "planner",
    [{"name": "survival"}, {"name": "constrained"}, {"name": "time_bound"}, {"name": "dijkstra", "w": 1.0}],
)
def test_every_planner_flies(planner: dict[str, object]) -> None:
    bounded = {"count": 3, "arrive_within_s": 90.0}
    scenario = small(planner=planner, simulate=bounded)
    assert all(row.arrived for row in mission(scenario).rows)


def test_sensors_that_err_see_ghosts_and_the_same_ones_for_every_level() -> None:
    sensor = {"p_miss": 0.2, "p_false_alarm": 0.1}
    short, safe = (mission(small(sensor=sensor, planner={"w": w}), 11) for w in (0.0, 1.0))
    assert short.rows[0].cells_known > 0
    world = World.drawn(small(), 11)
    model = small(sensor=sensor).prior.sensor
    looks = [world.shows_hostile(1, (row, col), 1, model) for row in range(8) for col in range(8)]
    assert looks != [(row, col) in world.hostiles for row in range(8) for col in range(8)]
    assert all(row.arrived for row in (*short.rows, *safe.rows))


def test_straightened_tracks_are_no_longer_and_no_more_exposed_than_the_routes_planned() -> None:
    lattice, straight = small(), small(flight={"any_angle": True, "altitude_m": 15.0})
    for seed in range(5):
        world = World.drawn(lattice, seed)
        planned, pulled = fly_mission(lattice, world), fly_mission(straight, world)
        for one, other, track in zip(planned.rows, pulled.rows, pulled.tracks, strict=True):
            assert other.arrived
            assert other.believed_exposure_sum <= one.believed_exposure_sum + 1e-9
            # The straight line is the shortest way; a new track begins at a centre, up to a cell aside.
            rows, cols = abs(track[-1][0] - track[0][0]), abs(track[-1][1] - track[0][1])
            assert other.length_cells >= math.hypot(rows, cols) - 1.0 - other.replans
            assert all(abs(a - c) <= 1 and abs(b - d) <= 1 for (a, b), (c, d) in pairwise(track))


def test_turns_of_a_radius_are_refused() -> None:
    with pytest.raises(ValueError, match="turn_radius_m"):
        mission(small(simulate={"count": 1, "autopilot": "arduplane"}, flight={"any_angle": True}))


def test_a_fully_autonomous_vehicle_flies_as_without_communication() -> None:
    autonomous = mission(small(planner={"autonomy": 1.0}))
    assert autonomous.tracks == mission(with_network(range=0)).tracks
    assert autonomous.rows[0].messages_received > 0


def test_autonomy_and_benevolence_change_routes_in_steps_and_not_at_zero() -> None:
    paper = mission(small())
    assert mission(small(planner={"autonomy": 0.0, "benevolence": 0.0})) == paper
    assert mission(small(planner={"benevolence": 1.0})).tracks != paper.tracks
    alone = {"planner": {"benevolence": 1.0}, "communication": {"bus": "memory", "range": 0}}
    assert mission(small(**alone)) == mission(with_network(range=0))
