"""Groups of point masses in closed loop with the laws: accuracy, faults, and distance of the members."""

from __future__ import annotations

import math

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

from swarmctl.agent.formation.approaches import APPROACHES
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
@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_straight_at_10_m_s_the_places_are_kept(approach: str, autopilot: str, loss: float) -> None:
    flight = FormationFlight(approach, WEDGE, STRAIGHT, 5, AUTOPILOTS[autopilot], loss=loss)
    samples = flight.run(50.0)[-600:]
    assert rms([s.velocities[0][1] for s in samples]) > 9.5
    assert rms(errors_m(samples, 1)) < 1.0
    assert rms(errors_m(samples, 0)) < 2.0


@each_approach
@each_autopilot
def test_a_turn_of_90_degrees_keeps_each_member_near_its_moving_place(approach: str, autopilot: str) -> None:
    samples = FormationFlight(approach, WEDGE, CORNER, 5, AUTOPILOTS[autopilot], loss=0.1).run(75.0)[200:]
    assert samples[-1].s_m > 500.0
    assert largest_m(samples) < 4.0
    assert least_distance_m(samples, range(5)) > 25.0


@each_approach
@pytest.mark.parametrize("begins_s", [20.0, 26.0, 29.0, 32.0, 36.0])
def test_two_seconds_of_lost_messages_cost_less_than_5_m_in_a_turn(approach: str, begins_s: float) -> None:
    flight = FormationFlight(approach, WEDGE, CORNER, 5, ARDUPILOT, outages=[(begins_s, begins_s + 2.0)])
    samples = flight.run(50.0)[200:]
    assert largest_m(samples) < 5.0
    assert least_distance_m(samples, range(5)) > 20.0
