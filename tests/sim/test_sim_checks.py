"""Checks on constructed states: measured values, failures, and their texts."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

from sim_vehicle.scenarios import default_scenario
from sim_vehicle.scenarios.checking import RunningCheck
from sim_vehicle.scenarios.checks import RunView
from sim_vehicle.scenarios.plan import FenceShape
from sim_vehicle.scenarios.runner import outside_m
from sim_vehicle.scenarios.steps import CheckSpec

N = 3
SCENARIO = default_scenario(N, home=(46.0, 14.5, 300.0))


class FakeTruth:
    """The fields of Truth that checks read."""

    def __init__(self, **fields: Any) -> None:
        self.sysid = np.array([1, 2, 3])
        self.speed_m_s = np.zeros(N)
        self.airborne = np.zeros(N, dtype=bool)
        self.armed = np.zeros(N, dtype=bool)
        self.crashed = np.zeros(N, dtype=bool)
        self.battery_remaining = np.ones(N)
        self.strikes = np.zeros(N, dtype=np.int64)
        self.mode = ("STABILIZE",) * N
        self.__dict__.update(fields)


def view(now: float = 0.0, *, truth: dict[str, Any] | None = None, **fields: Any) -> RunView:
    start_m = np.array([[0.0, 0.0, 300.0], [5.0, 0.0, 300.0], [10.0, 0.0, 300.0]])
    values: dict[str, Any] = {
        "position_m": start_m.copy(),
        "start_m": start_m,
        "goal_m": np.full((N, 2), np.nan),
        "bound_for_goal": np.ones(N, dtype=bool),
        "flown": np.zeros(N, dtype=bool),
        "heartbeat_age_s": np.zeros(N),
        "mission_done": np.zeros(N, dtype=bool),
        "outside_fence_m": np.zeros(N),
        "area_m": None,
        "texts": [[] for _ in range(N)],
    } | fields
    made: Any = FakeTruth(**(truth or {}))
    return RunView(now=now, truth=made, **values)


def check_of(line: Any) -> RunningCheck:
    return RunningCheck(CheckSpec.model_validate(line), SCENARIO)


def at(east_m: float, north_m: float, up_m: float) -> list[float]:
    return [east_m, north_m, 300.0 + up_m]


FLYING = {"airborne": np.array([True, True, False])}
YES = np.array([True, True, True])


@pytest.mark.parametrize(
    ("line", "moment", "failed"),
    [
        ("no_crash", view(truth={"crashed": np.array([False, True, False])}), [2]),
        (
            {"min_separation_m": 5},
            view(position_m=np.array([at(0, 0, 9), at(3, 0, 13), at(0, 0, 0)]), truth=FLYING),
            [],
        ),
        (
            {"min_separation_m": 5.1},
            view(position_m=np.array([at(0, 0, 9), at(3, 0, 13), at(0, 0, 0)]), truth=FLYING),
            [1, 2],
        ),
        ({"max_height_m": 20}, view(position_m=np.array([at(0, 0, 20), at(0, 0, 20.1), at(0, 0, -3)])), [2]),
        ({"min_height_m": 5}, view(position_m=np.array([at(0, 0, 5), at(0, 0, 4), at(0, 0, 9)])), [2]),
        ({"max_speed_m_s": 5}, view(truth={"speed_m_s": np.array([5.0, 6.0, 0.0])}), [2]),
        ({"stays_within_m": 5}, view(position_m=np.array([at(3, 4, 0), at(5, 6, 0), at(10, 0, 99)])), [2]),
        (
            "stays_in_area",
            view(area_m=(0, -1, 9, 1), position_m=np.array([at(0, 1, 0), at(9, 0, 0), at(10, 0, 0)])),
            [3],
        ),
        ("no_fence_breach", view(outside_fence_m=np.array([0.0, 0.1, 0.0])), [2]),
        ({"no_fence_breach": 3}, view(outside_fence_m=np.array([0.0, 3.0, 3.1])), [3]),
        ({"battery_above": 0.2}, view(truth={"battery_remaining": np.array([0.3, 0.2, 0.0])}), [2, 3]),
        ("no_strike", view(truth={"strikes": np.array([0, 1, 0])}), [2]),
        ({"strikes_at_most": 1}, view(truth={"strikes": np.array([0, 1, 2])}), [3]),
        ("alive", view(heartbeat_age_s=np.array([1.0, 3.0, 3.1])), [3]),
        ({"never_says": "Fail"}, view(texts=[["Failsafe"], [], ["a fail", ""]]), [1, 3]),
    ],
)
def test_an_always_check_fails_at_once_for_each_vehicle(
    line: Any, moment: RunView, failed: list[int]
) -> None:
    checked = check_of(line)
    assert [failure.sysid for failure in checked.observe(moment)] == failed
    assert checked.observe(moment) == []  # once each
    assert checked.end(moment) == []


@pytest.mark.parametrize(
    ("line", "moment"),
    [
        ({"heard_text": "Glitch"}, view(texts=[["GPS Glitch"], ["x", "Glitch cleared"], ["Glitch"]])),
        ({"mode_is": "rtl|Return"}, view(truth={"mode": ("RTL", "Return", "rtl")})),
        ("armed", view(truth={"armed": YES})),
        ("crashed", view(truth={"crashed": YES})),
        ("airborne", view(truth={"airborne": YES})),
        ("landed", view(flown=YES)),
        ({"reached_goal": {"within_m": 5}}, view(goal_m=np.array([[3, 4], [5, 5], [10, -5]]), flown=YES)),
        ("mission_complete", view(mission_done=YES, flown=YES)),
    ],
)
def test_an_eventually_check_stays_fulfilled(line: Any, moment: RunView) -> None:
    fulfilled, missed = check_of(line), check_of(line)
    assert fulfilled.observe(moment) == []
    assert fulfilled.is_settled(0.0)
    assert not missed.is_settled(0.0)
    nothing = view(now=9.0)
    assert fulfilled.observe(nothing) == fulfilled.end(nothing) == []
    assert missed.observe(nothing) == []
    assert [failure.sysid for failure in missed.end(nothing)] == [1, 2, 3]


@pytest.mark.parametrize(
    ("line", "moment"),
    [
        ("disarmed", view()),
        ({"lands_within_m": 2}, view(flown=YES)),
        ({"mode_is": {"mode": "STABILIZE", "when": "end"}}, view()),
    ],
)
def test_an_end_check_counts_only_at_the_end(line: Any, moment: RunView) -> None:
    other = view(truth={"armed": YES, "airborne": YES, "mode": ("AUTO",) * N})
    checked = check_of(line)
    assert checked.observe(other) == []
    assert checked.end(moment) == []
    failing = check_of(line)
    assert failing.observe(moment) == []
    assert len(failing.end(other)) == N


def test_a_check_covers_its_vehicles_and_times() -> None:
    crash = {"crashed": YES}
    checked = check_of({"no_crash": {"vehicles": [1, 3], "from_s": 10, "until_s": 20}})
    assert checked.observe(view(9.9, truth=crash)) == []
    assert checked.observe(view(20.1, truth=crash)) == []
    assert [failure.sysid for failure in checked.observe(view(20.0, truth=crash))] == [1, 3]


@pytest.mark.parametrize(
    ("fields", "found"),
    [
        ({"flown": ~YES}, "0 m away, not flown yet"),
        ({"flown": YES, "bound_for_goal": ~YES}, "0 m away, not bound for the goal yet"),
    ],
)
def test_a_goal_counts_in_flight_and_while_bound_for_it(fields: dict[str, Any], found: str) -> None:
    checked = check_of("reached_goal")
    moment = view(**({"goal_m": np.array([[0, 0], [5, 0], [10, 0]])} | fields))
    assert checked.observe(moment) == []
    assert [failure.found for failure in checked.end(moment)] == [found] * N


def test_a_missed_goal_reports_the_smallest_distance_and_its_time() -> None:
    checked = check_of({"reached_goal": {"from_s": 5}})
    goal_m = np.array([[30, 0], [30, 0], [30, 0]])

    def observe(now: float, east_m: float, **fields: Any) -> None:
        position_m = np.array([at(east_m, 0, 20)] * N)
        assert checked.observe(view(now, position_m=position_m, goal_m=goal_m, flown=YES, **fields)) == []

    observe(4.0, 24.9)  # before `from_s`
    observe(6.0, 24.8, bound_for_goal=~YES)
    observe(7.0, 20.0)
    observe(8.0, 24.5, bound_for_goal=np.array([True, False, False]))
    observe(9.0, 0.0)
    failures = checked.end(view(9.0, goal_m=goal_m, flown=YES))
    assert [failure.found for failure in failures] == [
        "5.5 m away at the closest approach, at 8.00 s",
        "10 m away at the closest approach, at 7.00 s",
        "10 m away at the closest approach, at 7.00 s",
    ]


def test_a_goal_at_the_end_reports_the_final_distance() -> None:
    checked = check_of({"reached_goal": {"when": "end"}})
    goal_m = np.array([[30, 0], [30, 0], [30, 0]])
    checked.observe(view(1.0, position_m=np.array([at(30, 0, 20)] * N), goal_m=goal_m, flown=YES))
    assert checked.end(view(9.0, goal_m=goal_m, flown=YES))[0].found == "30 m away"


@pytest.mark.parametrize(
    ("line", "found"), [("landed", "crashed"), ({"lands_within_m": 5}, "0 m from its start, crashed")]
)
def test_a_crashed_vehicle_has_not_landed(line: Any, found: str) -> None:
    checked = check_of(line)
    moment = view(flown=YES, truth={"crashed": np.array([True, False, True])})
    assert checked.observe(moment) == []
    assert [(failure.sysid, failure.found) for failure in checked.end(moment)] == [(1, found), (3, found)]


def test_a_missed_deadline_fails_at_its_time() -> None:
    checked = check_of({"airborne": {"by_s": 30}})
    assert checked.observe(view(29.95)) == []
    (first, *_) = checked.observe(view(30.0, position_m=np.array([at(0, 0, 1.5)] * N)))
    assert (first.t_s, first.found) == (30.0, "1.5 m high")
    assert checked.observe(view(31.0, truth={"airborne": YES})) == []
    assert len(checked.failures) == N


@settings(max_examples=examples(60))
@given(count=st.integers(0, N), places=st.lists(st.tuples(*[st.floats(-50, 50)] * 3), min_size=N, max_size=N))
def test_separation_is_the_distance_to_the_nearest_other_in_the_air(
    count: int, places: list[tuple[float, float, float]]
) -> None:
    airborne = np.arange(N) < count
    found = view(position_m=np.array(places), truth={"airborne": airborne}).separation_m
    for i in range(N):
        others = [math.dist(places[i], places[j]) for j in range(N) if j != i and airborne[i] and airborne[j]]
        assert found[i] == pytest.approx(min(others, default=math.inf))


# -- fences ----------------------------------------------------------------------------------------------


def shape(**fields: Any) -> FenceShape:
    return FenceShape.model_validate(fields)


SQUARE = [(0, 0), (10, 0), (10, 10), (0, 10)]
L_SHAPE = [(0, 0), (20, 0), (20, 10), (10, 10), (10, 20), (0, 20)]


@pytest.mark.parametrize(
    ("shapes", "place", "beyond_m"),
    [
        ([shape(keep_in=SQUARE)], (5, 5), 0),
        ([shape(keep_in=SQUARE)], (13, 14), 5),
        ([shape(keep_in=SQUARE)], (5, -2), 2),
        ([shape(keep_in=L_SHAPE)], (13, 13), 3),
        ([shape(keep_out=SQUARE)], (5, 4), 4),
        ([shape(keep_out=SQUARE)], (11, 4), 0),
        ([shape(keep_in_circle={"east_m": 3, "north_m": 4, "radius_m": 5})], (0, 0), 0),
        ([shape(keep_in_circle={"east_m": 3, "north_m": 4, "radius_m": 4})], (0, 0), 1),
        ([shape(keep_out_circle={"east_m": 3, "north_m": 4, "radius_m": 6})], (0, 0), 1),
        ([shape(keep_in=SQUARE), shape(keep_out=SQUARE)], (5, 4), 4),
        ([], (1e6, 0), 0),
    ],
)
def test_the_distance_beyond_a_fence(
    shapes: list[FenceShape], place: tuple[float, float], beyond_m: float
) -> None:
    assert outside_m(shapes, *place) == pytest.approx(beyond_m)
