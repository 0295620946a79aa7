"""The compiled loop gives the results of the plain mission, to the bit, for drawn worlds and settings."""

from __future__ import annotations

import pytest
from flights import AREA, small
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmctl.study.compiled_mission import CompiledMission, covers
from swarmctl.study.kinds import KINDS
from swarmctl.study.mission import fly_mission
from swarmctl.study.world import World

NETWORKS = st.fixed_dictionaries(
    {"range": st.sampled_from(["all", 0, 1, 2])},
    optional={
        "delay_s": st.floats(0.0, 30.0),
        "jitter_s": st.floats(0.0, 10.0),
        "min_distance_m": st.floats(0.0, 150.0),
        "max_distance_m": st.floats(151.0, 400.0),
        "relay": st.booleans(),
    },
)
LOSSES = st.sampled_from([{}, {"loss": 0.3}, {"loss": 0.5, "loss_burst": 4.0}])
PLANNERS = st.fixed_dictionaries(
    {"w": st.sampled_from([0.0, 0.3, 0.5, 0.9, 1.0])},
    optional={"psi_per_cell": st.floats(0.01, 1.0), "max_exposure": st.sampled_from([0.3, 0.5, 1.0])},
)
CELLS = st.integers(1, 6)
NO_FLY = st.lists(st.tuples(CELLS, CELLS), max_size=6, unique=True)
SWARMS = st.fixed_dictionaries(
    {"count": st.integers(1, 5)},
    optional={
        "delay_step_s": st.sampled_from([0.0, 7.0, 40.0]),
        "goal": st.sampled_from([[4, 7], [[0, 7], [7, 7], [3, 7], [4, 0], [1, 7]]]),
        "start_side": st.sampled_from(["west", "south"]),
    },
)


def assert_equal_missions(scenario, seeds) -> None:  # type: ignore[no-untyped-def]
    assert covers(scenario)
    loop = CompiledMission(scenario)
    for seed in seeds:
        world = World.drawn(scenario, seed)
        # The text tells NaN from numbers, and shows every bit of a float.
        assert repr(loop.fly(world)) == repr(fly_mission(scenario, world))


def scenario_of(swarm, network, loss, planner, no_fly, n_hostiles):  # type: ignore[no-untyped-def]
    return small(
        area={**AREA, "no_fly": [list(cell) for cell in no_fly]},
        threats={"count": n_hostiles},
        communication={"bus": "memory", **network, **loss},
        planner=planner,
        simulate={"ready_s": 3.0, **swarm},
    )


@pytest.mark.full
@settings(max_examples=150, deadline=None)
@given(SWARMS, NETWORKS, LOSSES, PLANNERS, NO_FLY, st.integers(0, 30), st.integers(0, 10**6))
def test_drawn_missions_are_equal(swarm, network, loss, planner, no_fly, n_hostiles, seed) -> None:  # type: ignore[no-untyped-def]
    assert_equal_missions(scenario_of(swarm, network, loss, planner, no_fly, n_hostiles), [seed, seed + 1])


def test_missions_with_everything_are_equal() -> None:
    """One level with all settings: the default suite's witness for the drawn ones."""
    network = {"range": 2, "delay_s": 4.0, "jitter_s": 9.0, "relay": True, "max_distance_m": 300.0}
    scenario = scenario_of(
        {"count": 4, "delay_step_s": 7.0}, network, {"loss": 0.3}, {"w": 0.5}, [(3, 3), (4, 4)], 8
    )
    assert_equal_missions(scenario, range(3))


def test_columns_hold_the_rows_and_tracks_of_each_seed() -> None:
    scenario = small()
    missions = KINDS["missions"].table(scenario, [5, 2], kept=[2])
    assert missions.rows["seed"].tolist() == [5, 5, 5, 2, 2, 2]
    assert missions.rows["uav"].tolist() == [1, 2, 3, 1, 2, 3]
    result = fly_mission(scenario, World.drawn(scenario, 2))
    assert missions.rows["strikes"][3:].tolist() == [row.strikes for row in result.rows]
    assert missions.rows["length_m"][3:].tolist() == [row.length_m for row in result.rows]
    tracks = missions.tracks
    assert set(tracks["seed"].tolist()) == {2}
    cells = list(zip(tracks["row"].tolist(), tracks["col"].tolist(), strict=True))
    assert cells == [cell for track in result.tracks for cell in track]
    assert tracks["strikes"].sum() == sum(row.strikes for row in result.rows)
    assert len(missions.hostiles["row"]) == 5


def test_other_settings_are_flown_by_the_plain_mission() -> None:
    for sections in (
        {"planner": {"name": "survival"}},
        {"sensor": {"p_miss": 0.1}},
        {"threats": {"count": {"distribution": "poisson", "mean": 5.0}}},
        {"communication": {"bus": "memory", "bandwidth_bytes_s": 1000.0}},
    ):
        scenario = small(**sections)
        assert not covers(scenario)
        assert len(KINDS["missions"].table(scenario, [1]).rows["uav"]) == 3
