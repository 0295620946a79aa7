"""Schedule of returns."""

from __future__ import annotations

from itertools import combinations
from math import hypot

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

from swarmctl.agent.traffic import return_schedule
from swarmctl.agent.traffic.return_schedule import ReturningVehicle, schedule_returns

APART = {"horizontal_m": 10.0, "vertical_m": 3.0}


def vehicle(
    uav: int, here: tuple[float, float], home: tuple[float, float], **changes: float
) -> ReturningVehicle:
    values: dict[str, float] = {"alt_amsl_m": 340.0, "home_alt_amsl_m": 300.0, "speed_m_s": 10.0, **changes}
    return ReturningVehicle(
        uav, here, values["alt_amsl_m"], home, values["home_alt_amsl_m"], values["speed_m_s"]
    )


def test_parallel_returns_start_at_once() -> None:
    plan = schedule_returns([vehicle(n, (500.0, 50.0 * n), (0.0, 50.0 * n)) for n in (1, 2, 3)], **APART)
    assert dict(plan.begins_s) == {1: 0.0, 2: 0.0, 3: 0.0}
    assert plan.height_only == ()


def test_returns_to_one_home_start_one_after_the_other_nearest_first() -> None:
    plan = schedule_returns([vehicle(n, (100.0 * n, 0.0), (0.0, 0.0)) for n in (3, 1, 2)], **APART)
    assert list(plan.begins_s) == [1, 2, 3]
    begins = list(plan.begins_s.values())
    assert begins[0] == 0.0
    assert begins[0] < begins[1] < begins[2]
    assert plan.all_landed_s > begins[2]


def test_crossing_returns_start_one_after_the_other() -> None:
    plan = schedule_returns(
        [vehicle(1, (200.0, 0.0), (0.0, 200.0)), vehicle(2, (200.0, 200.0), (0.0, 0.0))],
        **APART,
    )
    assert sorted(plan.begins_s.values())[1] > 0.0


def test_a_vehicle_holding_on_anothers_path_leaves_first() -> None:
    """The rule holds even for a vehicle with the longer way home."""
    plan = schedule_returns(
        [vehicle(1, (300.0, 0.0), (0.0, 0.0)), vehicle(2, (150.0, 0.0), (150.0, 400.0))],
        **APART,
    )
    assert list(plan.begins_s) == [2, 1]


def test_a_returning_vehicle_is_first() -> None:
    under_way = ReturningVehicle(2, (400.0, 0.0), 340.0, (0.0, 0.0), 300.0, 10.0, is_returning=True)
    plan = schedule_returns([vehicle(1, (100.0, 5.0), (0.0, 5.0)), under_way], **APART)
    assert plan.begins_s[2] == 0.0
    assert plan.height_only == ((2, 1),)


def test_pairs_separated_by_height_alone_are_reported() -> None:
    plan = schedule_returns(
        [vehicle(1, (0.0, 0.0), (200.0, 0.0)), vehicle(2, (100.0, 0.0), (-100.0, 0.0))], **APART
    )
    assert len(plan.height_only) == 1


def test_no_vehicles_give_an_empty_schedule() -> None:
    assert schedule_returns([], **APART) == return_schedule.ReturnSchedule({}, 0.0)


def flown(flier: ReturningVehicle, begins_s: float, t: float, pace: float) -> tuple[tuple[float, float], str]:
    """Return position and activity at a time; `pace` in 0..1 sets reaction and speed."""
    if t < begins_s:
        return flier.here, "holds"
    departs_s = begins_s + (1.0 - pace) * flier.departs_within_s
    speed = flier.speed_m_s * (
        return_schedule.SLOW_FACTOR + pace * (return_schedule.FAST_FACTOR - return_schedule.SLOW_FACTOR)
    )
    share = min(max(t - departs_s, 0.0) * speed / max(flier.home_distance_m, 1e-9), 1.0)
    if t > begins_s + flier.takes_s:
        return flier.home, "down"
    east, north = (a + share * (b - a) for a, b in zip(flier.here, flier.home, strict=True))
    return (east, north), "moves"


PLACES = st.tuples(st.floats(-300.0, 300.0), st.floats(-300.0, 300.0))
SWARMS = st.lists(st.tuples(PLACES, PLACES, st.floats(310.0, 370.0), st.floats(0.0, 1.0)), max_size=5)


@given(SWARMS)
@settings(max_examples=examples(60), deadline=None)
def test_no_two_vehicles_conflict_at_any_speed(
    swarm: list[tuple[tuple[float, float], tuple[float, float], float, float]],
) -> None:
    vehicles = [vehicle(n, here, home, alt_amsl_m=alt) for n, (here, home, alt, _) in enumerate(swarm, 1)]
    plan = schedule_returns(vehicles, **APART)
    excused = {frozenset(pair) for pair in plan.height_only}
    for (one, (*_, pace)), (other, (*_, others_pace)) in combinations(zip(vehicles, swarm, strict=True), 2):
        for step in range(int(plan.all_landed_s) + 1):
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


def test_twenty_vehicles_to_one_home_are_all_scheduled() -> None:
    ring = [vehicle(n, (30.0 * n, 7.0 * (n % 5)), (0.0, 0.0)) for n in range(1, 21)]
    plan = schedule_returns(ring, **APART)
    assert len(plan.begins_s) == 20
    assert plan.all_landed_s == pytest.approx(
        max(plan.begins_s.values()) + max(c.takes_s for c in ring), rel=0.5
    )
