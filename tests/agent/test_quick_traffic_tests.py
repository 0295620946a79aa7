"""The quick tests before any flight is computed never hide a vehicle that the exact comparison would see."""

from __future__ import annotations

import pytest
from drawn_traffic import draw
from hypothesis import given
from hypothesis import strategies as st
from random_trajectories import flights

from swarmctl.agent.phases import IN_FLIGHT
from swarmctl.agent.state import AgentState
from swarmctl.agent.traffic.last_resort import STRAIGHT_ON_S
from swarmctl.agent.traffic.own_flight import own_trajectory, planned_flight, reach
from swarmctl.agent.traffic.separation.trajectory import Bounds, Trajectory

N_DEFAULT, N_FULL = 3, 30


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "seed" in metafunc.fixturenames:
        n = N_FULL if metafunc.config.getoption("--full") else N_DEFAULT
        metafunc.parametrize("seed", range(100, 100 + n))


def _holds(box: Bounds, flight: Trajectory) -> bool:
    inner = Bounds.of(flight)
    low = zip(box.least[1:], inner.least[1:], strict=True)
    return all(a <= b for a, b in low) and all(
        a >= b for a, b in zip(box.most[1:], inner.most[1:], strict=True)
    )


def _outside(state: AgentState) -> str:
    """Return the own flight that leaves the box of the quick test; empty if none does."""
    now_s, look_ahead_s = state.vehicle.time_boot_s, state.task.separation.look_ahead_s
    plan, own = planned_flight(state), own_trajectory(state)
    box, wide = reach(state, look_ahead_s, STRAIGHT_ON_S), reach(state, look_ahead_s, look_ahead_s)
    if plan is None or own is None or box is None or wide is None:
        return ""
    if not _holds(box, plan.lasting(now_s + look_ahead_s)):
        return f"{now_s:.1f} s, {state.phase}: {plan}"
    return "" if _holds(wide, own) else f"{now_s:.1f} s, {state.phase}: {own}"


def test_the_own_flight_stays_in_the_box_of_the_quick_test(seed: int) -> None:
    drawn, found, n = draw(seed), [], 0

    def look(now: float) -> None:
        nonlocal n
        for agent in drawn.swarm.agents:
            if agent.state.phase in IN_FLIGHT and now % 0.5 == 0.0:
                n += 1
                if text := _outside(agent.state):
                    found.append(text)

    drawn.swarm.run(300.0, look)
    assert n > 100
    assert found == [], drawn.story


@given(flights(), st.floats(0.0, 1.0), st.tuples(*[st.floats(0.0, 5.0)] * 4))
def test_a_flight_with_a_place_in_a_box_may_meet_the_box(
    flight: Trajectory, share: float, sides: tuple[float, float, float, float]
) -> None:
    at_s = flight.times_s[0] + share * (flight.times_s[-1] - flight.times_s[0])
    place = flight.at(at_s)
    assert place is not None
    assert flight.may_meet(Bounds((at_s, *place), (at_s, *place)).wider(sides))


@given(flights(), st.sampled_from([0.0, 0.3, 3.0]))
def test_a_thinned_flight_passes_each_of_its_points(flight: Trajectory, within_m: float) -> None:
    thinned = flight.thinned(within_m)
    assert set(thinned.points) <= set(flight.points)
    assert (thinned.times_s[0], thinned.times_s[-1]) == (flight.times_s[0], flight.times_s[-1])
    for time_s, point in zip(flight.times_s, flight.points, strict=True):
        at = thinned.at(time_s)
        assert at is not None
        assert max(abs(a - b) for a, b in zip(at, point, strict=True)) <= within_m + 1e-9


def test_a_straight_flight_is_thinned_to_its_ends() -> None:
    straight = Trajectory(tuple(map(float, range(9))), tuple((3.0 * k, -k, 30.0) for k in range(9)))
    assert len(straight.thinned(0.1).points) == 2
