"""Groups that split at a wall with gaps and meet again: light vehicles, and the places on ways."""

from __future__ import annotations

import math
from itertools import combinations

import pytest
from flights import AREA
from hypothesis import given
from hypothesis import strategies as st
from light_group import LightGroup
from light_vehicle import STOPS_AFTER_S

from swarmctl.agent.formation.approaches import APPROACHES
from swarmctl.agent.formation.reference import Reference, SpeedProfile, window_for
from swarmctl.agent.formation.ways import SplitStretch, offset_of
from swarmctl.agent.phases import Phase
from swarmctl.agent.state import ARRIVED

ROWS, COLS, WALL_COL = 15, 17, 7
GAPS = {1, 4, 7}
LEADER = 2
LATE_S = 2.0


def before_a_wall(approach: str, factor: float | None = 1.3) -> LightGroup:
    """Return a line of three, 100 m apart: it flies around the wall, or its members fly through gaps."""
    wall = [[row, WALL_COL] for row in range(9) if row not in GAPS]
    return LightGroup(
        approach=approach,
        area={**AREA, "rows": ROWS, "cols": COLS, "no_fly": wall},
        flight={"altitude_m": 15.0, "altitude_step_m": 6.0},
        simulate={"goal": [4, COLS - 1], "start_spacing_m": 100.0},
        formation={
            "members": ["uav2", "uav1", "uav3"],
            "shape": {"kind": "line", "spacing_m": 100.0},
            "split_factor": factor,
        },
    )


class Watch:
    """The witness of a flight: distances, no-fly cells, gaps, errors and abandoned set-points."""

    def __init__(self, swarm: LightGroup, mute: int | None = None) -> None:
        self.swarm, self.mute = swarm, mute
        self.least_m = math.inf
        self.gaps: dict[int, int] = {}
        self.in_walls: set[int] = set()
        self.was_split: set[int] = set()
        self.met_errors_m: list[float] = []
        self.abandoned: set[int] = set()

    def __call__(self, _now: float) -> None:
        limits = self.swarm.agents[0].task.separation.limits
        for agent in self.swarm.agents:
            membership, cell = agent.state.membership, agent.state.cell
            if cell is not None and cell[1] == WALL_COL:
                self.gaps[agent.uav] = cell[0]
            if cell in agent.task.no_fly:
                self.in_walls.add(agent.uav)
            if membership.is_split:
                self.was_split.add(agent.uav)
            elif agent.uav in self.was_split and agent.state.phase is Phase.FORMATION and membership.error_m:
                self.met_errors_m.append(math.hypot(*membership.error_m[:2]))
            vehicle = agent.vehicle
            if vehicle.mode == "setpoints" and vehicle.setpoint_age_s > STOPS_AFTER_S + LATE_S:
                self.abandoned.add(agent.uav)
        # Over the shared goal a vehicle without messages may meet another one.
        flying = [
            agent
            for agent in self.swarm.agents
            if agent.vehicle.armed and not (agent.uav == self.mute and agent.state.phase is Phase.LANDING)
        ]
        for a, b in combinations([agent.vehicle for agent in flying], 2):
            if abs(a.at[2] - b.at[2]) < limits.vertical_m - 0.5:
                self.least_m = min(self.least_m, math.dist(a.at[:2], b.at[:2]))


@pytest.mark.parametrize("approach", APPROACHES)
def test_a_group_flies_through_separate_gaps_and_goes_on_in_its_shape(approach: str) -> None:
    swarm = before_a_wall(approach)
    watch = Watch(swarm)
    assert swarm.run(400.0, watch)
    assert [agent.state.outcome for agent in swarm.agents] == [ARRIVED] * 3
    assert len(watch.gaps) == 3
    assert {GAPS.issuperset(watch.gaps.values()), len(set(watch.gaps.values())) > 1} == {True}
    assert watch.in_walls == set()
    assert watch.least_m > swarm.agents[0].task.separation.limits.horizontal_m
    assert len(watch.met_errors_m) > 30
    assert max(watch.met_errors_m) < 3.0


def test_a_group_without_the_price_of_a_split_flies_around_the_wall() -> None:
    swarm = before_a_wall("virtual_structure", None)
    watch = Watch(swarm)
    assert swarm.run(400.0, watch)
    assert watch.was_split == set()
    assert watch.gaps[LEADER] >= 9


@pytest.mark.parametrize("lost", [3, LEADER], ids=["a member", "the leader"])
@pytest.mark.parametrize("approach", APPROACHES)
def test_after_a_loss_in_a_split_nobody_comes_near_or_is_abandoned(approach: str, lost: int) -> None:
    swarm = before_a_wall(approach)
    watch = Watch(swarm, mute=lost)
    swarm.run_while(lambda: not swarm.agents[0].state.membership.is_split, 60.0)
    swarm.air.mute[lost] = [(swarm.now + 15.0, math.inf)]
    assert swarm.run(500.0, watch)
    assert [agent.state.outcome for agent in swarm.agents] == [ARRIVED] * 3
    assert {row for uav, row in watch.gaps.items() if uav != lost} <= GAPS
    assert (watch.in_walls, watch.abandoned) == (set(), set())
    assert watch.least_m > swarm.agents[0].task.separation.limits.horizontal_m


LEGS = st.lists(st.tuples(st.floats(-80.0, 80.0), st.floats(-80.0, 80.0)), min_size=1, max_size=6)


@given(LEGS, LEGS, st.floats(0.0, 1.0), st.floats(-60.0, 60.0), st.floats(-60.0, 60.0))
def test_the_velocity_of_a_place_on_a_way_is_its_derivative(
    route: list[tuple[float, float]],
    way: list[tuple[float, float]],
    share: float,
    forward_m: float,
    right_m: float,
) -> None:
    def points(legs: list[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
        east_m, north_m = 0.0, 0.0
        found = [(0.0, 0.0)]
        for east, north in (*legs, (0.0, 100.0)):
            east_m, north_m = east_m + east, north_m + north
            found.append((east_m, north_m))
        return tuple(found)

    reference = Reference.over(points(route), window_for(60.0))
    way_of_3 = SplitStretch.of(20.0, reference.length_m - 10.0, {3: points(way)}).way_of(3)
    assert way_of_3 is not None

    def place(s_m: float) -> tuple[float, float]:
        pose = reference.at(s_m)
        (east_m, north_m), _ = offset_of(pose, (forward_m, right_m, 0.0), way_of_3)
        return pose.east_m + east_m, pose.north_m + north_m

    s_m, step_m = 21.0 + share * (reference.length_m - 32.0), 1e-4
    pose = reference.at(s_m)
    _, moves = offset_of(pose, (forward_m, right_m, 0.0), way_of_3, 2.0)
    before, after = place(s_m - step_m), place(s_m + step_m)
    velocity = (moves[0] + 2.0 * pose.slope_east, moves[1] + 2.0 * pose.slope_north)
    for k in (0, 1):
        assert velocity[k] == pytest.approx(
            (after[k] - before[k]) / step_m, abs=0.02 * (1.0 + way_of_3.ratio)
        )


def test_a_long_way_slows_the_route_so_that_its_member_can_follow() -> None:
    reference = Reference.over(((0.0, 0.0), (0.0, 1000.0)), window_for(30.0))
    way = Reference.over(((0.0, 0.0), (600.0, 400.0), (0.0, 800.0)), 15.0)
    profile = SpeedProfile.of(reference, 30.0, 10.0, 14.0, 2.0, ways=[(100.0, 900.0, way)])
    ratio = way.length_m / 800.0
    assert max(profile.at(s_m) for s_m in range(100, 900, 5)) * ratio <= 12.01
    assert profile.at(200.0) * ratio == pytest.approx(12.0, abs=0.01)
