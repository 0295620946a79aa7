"""Groups of point masses in closed loop with the laws: accuracy, faults, and distance of the members."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from formation_flight import (
    ARDUPILOT,
    ARDUPILOT_5_HZ,
    PX4,
    PX4_5_HZ,
    FormationFlight,
    Sample,
    least_distance_m,
    rms,
)
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from swarmctl.agent.formation.approaches import APPROACHES
from swarmctl.agent.formation.approaches.base import Group, MemberLimits, Nearby, ThreatField
from swarmctl.agent.formation.approaches.behavioural import gradient
from swarmctl.agent.formation.approaches.place_keeping import keep_separation
from swarmctl.agent.formation.reference import Reference, SpeedProfile
from swarmctl.agent.formation.shape import Shape

WEDGE = Shape(kind="wedge", spacing_m=30.0)
STRAIGHT = ((0.0, 0.0), (0.0, 1000.0))
CORNER = ((0.0, 0.0), (0.0, 300.0), (400.0, 300.0))
AUTOPILOTS = {"px4": PX4, "px4-5hz": PX4_5_HZ, "ardupilot": ARDUPILOT, "ardupilot-5hz": ARDUPILOT_5_HZ}

each_approach = pytest.mark.parametrize("approach", APPROACHES)
each_autopilot = pytest.mark.parametrize("autopilot", AUTOPILOTS)


def errors_m(samples: list[Sample], axis: int) -> list[float]:
    return [error[axis] for sample in samples for error in sample.errors]


def largest_m(samples: list[Sample]) -> float:
    return max(math.hypot(*error[:2]) for sample in samples for error in sample.errors)


@each_approach
@each_autopilot
def test_straight_at_10_m_s_the_places_are_kept(approach: str, autopilot: str) -> None:
    flight = FormationFlight(approach, WEDGE, STRAIGHT, 3, AUTOPILOTS[autopilot], loss=0.3)
    samples = flight.run(35.0)[-300:]
    assert rms([s.velocities[0][1] for s in samples]) > 9.5
    assert rms(errors_m(samples, 1)) < 1.0
    assert rms(errors_m(samples, 0)) < 2.0


@each_approach
@each_autopilot
def test_a_turn_of_90_degrees_keeps_each_member_near_its_moving_place(approach: str, autopilot: str) -> None:
    samples = FormationFlight(approach, WEDGE, CORNER, 5, AUTOPILOTS[autopilot], loss=0.1).run(65.0)[200:]
    assert samples[-1].s_m > 430.0
    assert largest_m(samples) < 4.0
    assert least_distance_m(samples, range(5)) > 25.0


@each_approach
@pytest.mark.parametrize("begins_s", [24.0, 29.0, 34.0])
def test_two_seconds_of_lost_messages_cost_less_than_5_m_in_a_turn(approach: str, begins_s: float) -> None:
    flight = FormationFlight(approach, WEDGE, CORNER, 5, ARDUPILOT, outages=[(begins_s, begins_s + 2.0)])
    samples = flight.run(50.0)[200:]
    assert largest_m(samples) < 5.0
    assert least_distance_m(samples, range(5)) > 20.0


@each_approach
@pytest.mark.parametrize("closes_up", [True, False])
def test_after_the_loss_of_the_leader_the_next_member_leads_and_nobody_stands_still(
    approach: str, closes_up: bool
) -> None:
    flight = FormationFlight(
        approach, WEDGE, STRAIGHT, 4, ARDUPILOT, failures={0: 25.0}, closes_up=closes_up, lost_after_s=2.0
    )
    samples = flight.run(75.0)
    flown = [s for s in samples if s.now_s > 20.0]
    assert min(math.hypot(*s.velocities[k][:2]) for s in flown for k in (1, 2, 3)) > 2.0
    assert least_distance_m(flown, (1, 2, 3)) > flight.separation_m
    assert flight.pilots[2].place == WEDGE.places(4)[1 if closes_up else 2]
    errors = [error for s in samples[-100:] for error in s.errors[1:]]
    assert max(math.hypot(*error[:2]) for error in errors) < 2.0


@each_approach
def test_a_new_shape_is_taken_at_a_bounded_speed_and_distance(approach: str) -> None:
    column = Shape(kind="column", spacing_m=20.0)
    flight = FormationFlight(approach, WEDGE, STRAIGHT, 5, PX4, shapes=[(20.0, column)])
    samples = flight.run(70.0)
    assert least_distance_m(samples, range(5)) > 12.0
    assert max(math.hypot(*v[:2]) for s in samples for v in s.velocities) < 12.5
    assert largest_m(samples[-100:]) < 2.0


@each_approach
def test_a_new_route_moves_no_demand_by_a_jump(approach: str) -> None:
    beside = ((40.0, 0.0), (40.0, 1000.0))
    flight = FormationFlight(approach, WEDGE, STRAIGHT, 3, PX4, routes=[(20.0, beside)])
    samples = flight.run(50.0)
    accelerations = [
        math.dist(a.velocities[k][:2], b.velocities[k][:2]) / 0.05
        for a, b in pairwise(samples[100:])
        for k in (1, 2)
    ]
    assert abs(samples[-1].positions[0][0] - 40.0) < 3.0
    assert max(accelerations) < 6.0


@each_approach
def test_a_member_that_starts_aside_joins_without_a_conflict(approach: str) -> None:
    starts = ((0.0, 0.0), (60.0, -60.0), (-20.0, -20.0))
    flight = FormationFlight(approach, WEDGE, STRAIGHT, 3, ARDUPILOT, starts=starts)
    samples = flight.run(60.0)
    assert least_distance_m(samples, range(3)) > 15.0
    assert largest_m(samples[-100:]) < 2.0


@pytest.mark.parametrize("null_space", [False, True])
def test_two_members_of_the_behavioural_approach_pass_each_other_on_the_way_to_their_places(
    null_space: bool,
) -> None:
    starts = ((0.0, 0.0), (-21.2, -21.2), (21.2, -21.2))  # each in the other's place
    flight = FormationFlight(
        "behavioural", WEDGE, STRAIGHT, 3, PX4, starts=starts, params={"null_space": null_space}
    )
    samples = flight.run(70.0)
    assert least_distance_m(samples, range(3)) > 10.0
    assert largest_m(samples[-100:]) < 3.0


@pytest.mark.parametrize(("ahead_m", "descends"), [(60.0, True), (25.0, False)])
def test_a_member_descends_to_the_height_of_a_standing_vehicle_only_if_it_can_stop_before_it(
    ahead_m: float, *, descends: bool
) -> None:
    route = Reference(((0.0, 0.0), (500.0, 0.0)), 15.0)
    flies = (8.0, 0.0, -1.0)
    group = Group(
        now_s=0.0,
        position_m=(0.0, 0.0, 34.0),
        velocity_m_s=flies,
        place=(0.0, 0.0, 0.0),
        others=(),
        along=None,
        reference=route,
        profile=SpeedProfile.of(route, 10.0, 8.0, 10.0, 2.0),
        height_m=30.0,
        limits=MemberLimits(10.0, separation_m=10.0, separation_up_m=3.0),
        obstacles=(Nearby((ahead_m, 0.0, 30.0), (0.0, 0.0, 0.0)),),
    )
    safe = keep_separation(group, flies)
    assert (safe is None) is descends
    assert safe is None or safe[2] > -0.5


def ridge(side_m: float, cell_m: float = 10.0) -> ThreatField:
    """P_s that falls from the line `side_m` to the east."""
    east_m = (np.arange(20) + 0.5) * cell_m
    return ThreatField(np.tile(np.maximum(1.0 - np.abs(east_m - side_m) / 50.0, 0.0), (100, 1)), cell_m)


@pytest.mark.parametrize("null_space", [False, True])
def test_the_behavioural_approach_goes_around_a_threat(null_space: bool) -> None:
    route = ((60.0, 0.0), (60.0, 900.0))
    flown = []
    for threats in (None, ridge(70.0)):
        flight = FormationFlight(
            "behavioural", WEDGE, route, 2, PX4, params={"null_space": null_space}, threats=threats
        )
        flown.append(flight.run(40.0)[-1])
    assert flown[1].positions[0][0] < flown[0].positions[0][0] - 2.0
    assert flown[1].s_m > 250.0


@pytest.mark.parametrize("null_space", [False, True])
def test_threats_ahead_do_not_stop_a_behavioural_group(null_space: bool) -> None:
    north_m = (np.arange(100) + 0.5) * 10.0
    wall = np.tile(np.maximum(1.0 - np.abs(north_m - 200.0) / 50.0, 0.0)[:, None], (1, 20))
    params = {"null_space": null_space, "threat_weight": 5.0}
    flight = FormationFlight(
        "behavioural",
        WEDGE,
        ((60.0, 0.0), (60.0, 900.0)),
        2,
        PX4,
        params=params,
        threats=ThreatField(wall, 10.0),
    )
    assert flight.run(60.0)[-1].s_m > 300.0


@pytest.mark.parametrize("row", range(3))
@pytest.mark.parametrize("col", range(3))
def test_the_gradient_of_a_plane_of_exposure_is_its_slope(row: int, col: int) -> None:
    exposure = 0.1 * np.arange(5)[None, :] + 0.2 * np.arange(5)[:, None]
    east, north = gradient(ThreatField(exposure, 10.0), 15.0 + 9.0 * col, 16.0 + 9.0 * row)
    assert (east, north) == pytest.approx((0.1, 0.2))


def test_the_structure_waits_for_a_member_that_is_held_back() -> None:
    fast, slow = (
        FormationFlight("virtual_structure", WEDGE, STRAIGHT, 3, PX4, max_speed_m_s=speed).run(50.0)[-1].s_m
        for speed in (12.0, 7.0)
    )
    assert slow < 0.8 * fast


@st.composite
def flights(draw: st.DrawFn) -> FormationFlight:
    steps = ((0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1))
    points, direction = [(0.0, 0.0)], draw(st.integers(0, 7))
    cell_m = draw(st.sampled_from((20.0, 50.0, 100.0)))
    for turn in draw(st.lists(st.sampled_from((-2, -1, 0, 0, 1, 2, 4)), min_size=3, max_size=12)):
        direction = (direction + turn) % 8
        (east, north), step = points[-1], steps[direction]
        points.append((east + cell_m * step[0], north + cell_m * step[1]))
    shapes = st.builds(
        Shape,
        kind=st.sampled_from(("wedge", "line", "column", "circle")),
        spacing_m=st.sampled_from((15.0, 20.0, 30.0)),
        height_step_m=st.sampled_from((0.0, 0.0, 6.0)),
    )
    n = draw(st.integers(2, 6))
    begins_s = draw(st.floats(3.0, 40.0))
    failures = draw(st.dictionaries(st.integers(0, n - 1), st.floats(5.0, 40.0), max_size=n - 1))
    return FormationFlight(
        draw(st.sampled_from(sorted(APPROACHES))),
        draw(shapes),
        points,
        n,
        draw(st.sampled_from(sorted(AUTOPILOTS)).map(AUTOPILOTS.__getitem__)),
        loss=draw(st.sampled_from((0.0, 0.1, 0.3))),
        seed=draw(st.integers(0, 99)),
        closes_up=draw(st.booleans()),
        outages=[(begins_s, begins_s + 2.0)],
        failures=failures,
        shapes=draw(st.lists(st.tuples(st.floats(5.0, 30.0), shapes), max_size=1)),
    )


@given(flights())
@settings(max_examples=8, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_in_drawn_flights_with_faults_no_two_members_come_nearer_than_the_separation(
    flight: FormationFlight,
) -> None:
    for sample in flight.run(50.0):
        here = [k for k, pilot in enumerate(flight.pilots) if sample.now_s < pilot.fails_at_s]
        assert least_distance_m([sample], here) >= flight.separation_m
