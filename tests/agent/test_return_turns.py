"""Turns of vehicles that are called back."""

from __future__ import annotations

from itertools import combinations
from math import hypot

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

from swarmctl.agent.traffic import return_turns
from swarmctl.agent.traffic.return_turns import ReturningVehicle, schedule_returns

APART = {"horizontal_m": 10.0, "vertical_m": 3.0}


def caller(
    uav: int, here: tuple[float, float], home: tuple[float, float], **changes: float
) -> ReturningVehicle:
    values: dict[str, float] = {"alt_amsl_m": 340.0, "home_alt_amsl_m": 300.0, "speed_m_s": 10.0, **changes}
    return ReturningVehicle(
        uav, here, values["alt_amsl_m"], home, values["home_alt_amsl_m"], values["speed_m_s"]
    )


def test_side_by_side_all_return_at_once() -> None:
    plan = schedule_returns([caller(n, (500.0, 50.0 * n), (0.0, 50.0 * n)) for n in (1, 2, 3)], **APART)
    assert dict(plan.begins_s) == {1: 0.0, 2: 0.0, 3: 0.0}
    assert plan.not_apart == ()


def test_to_one_home_they_come_one_after_the_other_the_nearest_first() -> None:
    plan = schedule_returns([caller(n, (100.0 * n, 0.0), (0.0, 0.0)) for n in (3, 1, 2)], **APART)
    assert list(plan.begins_s) == [1, 2, 3]
    begins = list(plan.begins_s.values())
    assert begins[0] == 0.0
    assert begins[0] < begins[1] < begins[2]
    assert plan.down_s > begins[2]


def test_ways_that_cross_are_flown_one_after_the_other() -> None:
    plan = schedule_returns(
        [caller(1, (200.0, 0.0), (0.0, 200.0)), caller(2, (200.0, 200.0), (0.0, 0.0))],
        **APART,
    )
    assert sorted(plan.begins_s.values())[1] > 0.0


def test_who_holds_on_anothers_way_leaves_before_it() -> None:
    """Though it has the longer way home."""
    plan = schedule_returns(
        [caller(1, (300.0, 0.0), (0.0, 0.0)), caller(2, (150.0, 0.0), (150.0, 400.0))],
        **APART,
    )
    assert list(plan.begins_s) == [2, 1]


def test_who_returns_already_has_the_first_turn() -> None:
    under_way = ReturningVehicle(2, (400.0, 0.0), 340.0, (0.0, 0.0), 300.0, 10.0, is_returning=True)
    plan = schedule_returns([caller(1, (100.0, 5.0), (0.0, 5.0)), under_way], **APART)
    assert plan.begins_s[2] == 0.0
    assert plan.not_apart == ((2, 1),)


def test_where_each_holds_on_the_others_way_it_is_said() -> None:
    plan = schedule_returns(
        [caller(1, (0.0, 0.0), (200.0, 0.0)), caller(2, (100.0, 0.0), (-100.0, 0.0))], **APART
    )
    assert len(plan.not_apart) == 1


def test_nobody_to_call_back_is_no_plan() -> None:
    assert schedule_returns([], **APART) == return_turns.ReturnSchedule({}, 0.0)


def flown(who: ReturningVehicle, begins_s: float, t: float, pace: float) -> tuple[tuple[float, float], str]:
    """Where one is at a time, that leaves at once or late and flies as fast as `pace` in 0..1 says."""
    if t < begins_s:
        return who.here, "holds"
    departs_s = begins_s + (1.0 - pace) * who.departs_within_s
    speed = who.speed_m_s * (return_turns.SLOWER + pace * (return_turns.FASTER - return_turns.SLOWER))
    share = min(max(t - departs_s, 0.0) * speed / max(who.way_m, 1e-9), 1.0)
    if t > begins_s + who.takes_s:
        return who.home, "down"
    east, north = (a + share * (b - a) for a, b in zip(who.here, who.home, strict=True))
    return (east, north), "moves"


PLACES = st.tuples(st.floats(-300.0, 300.0), st.floats(-300.0, 300.0))
SWARMS = st.lists(st.tuples(PLACES, PLACES, st.floats(310.0, 370.0), st.floats(0.0, 1.0)), max_size=5)


@given(SWARMS)
@settings(max_examples=examples(60), deadline=None)
def test_no_two_meet_however_fast_each_is(
    swarm: list[tuple[tuple[float, float], tuple[float, float], float, float]],
) -> None:
    callers = [caller(n, here, home, alt_amsl_m=alt) for n, (here, home, alt, _) in enumerate(swarm, 1)]
    plan = schedule_returns(callers, **APART)
    excused = {frozenset(pair) for pair in plan.not_apart}
    for (one, (*_, pace)), (other, (*_, others_pace)) in combinations(zip(callers, swarm, strict=True), 2):
        for step in range(int(plan.down_s) + 1):
            a, does = flown(one, plan.begins_s[one.uav], step, pace)
            b, others = flown(other, plan.begins_s[other.uav], step, others_pace)
            if "down" in (does, others):
                continue
            near = hypot(a[0] - b[0], a[1] - b[1]) < APART["horizontal_m"] - 1e-6
            if (does, others) == ("moves", "moves"):
                assert not near
            elif near and "moves" in (does, others) and frozenset((one.uav, other.uav)) not in excused:
                mover, holder, there = (one, other, a) if does == "moves" else (other, one, b)
                at_home = hypot(there[0] - mover.home[0], there[1] - mover.home[1]) < 1e-6
                assert holder.alt_amsl_m >= mover.top_amsl_m + APART["vertical_m"] or (
                    holder.alt_amsl_m <= mover.alt_amsl_m - APART["vertical_m"] and not at_home
                )


def test_twenty_vehicles_to_one_home_each_have_their_turn() -> None:
    ring = [caller(n, (30.0 * n, 7.0 * (n % 5)), (0.0, 0.0)) for n in range(1, 21)]
    plan = schedule_returns(ring, **APART)
    assert len(plan.begins_s) == 20
    assert plan.down_s == pytest.approx(max(plan.begins_s.values()) + max(c.takes_s for c in ring), rel=0.5)
