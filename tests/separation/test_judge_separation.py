"""Which configurations are refused because vehicles would meet, told as configurations."""

from __future__ import annotations

import json

import pytest
from flights import AREA

from swarmctl.config import Config
from swarmctl.judge import judge


def problems(**sections: object) -> list[str]:
    content: dict[str, object] = {
        "area": AREA,
        "threats": {"count": 5},
        "simulate": {"count": 3},
        "flight": {"altitude_step_m": 0.0},
    }
    config = Config.model_validate_json(json.dumps({**content, **sections}))
    return [f"{'.'.join(map(str, problem.path))}: {problem.text}" for problem in judge(config)]


ONE_GOAL = {"count": 2, "goal": [4, 7]}


def test_altitude_steps_separate_by_themselves() -> None:
    assert problems(flight={}, simulate=ONE_GOAL) == []


def test_vehicles_at_one_altitude_may_fly_where_their_first_routes_do_not_meet() -> None:
    assert problems() == []


def test_vehicles_at_one_altitude_that_meet_are_refused_with_a_cure() -> None:
    (found,) = problems(simulate=ONE_GOAL)
    assert found.startswith(
        "flight.altitude_step_m: uav1 and uav2 would fly at 40 and 40 m, less than separation.vertical_m = "
        "3 m apart, and their first routes meet: "
    )
    assert found.endswith(
        "with 2 s for what delays them; give them altitudes that differ by more, or simulate.delay_step_s "
        "until they do not"
    )


@pytest.mark.parametrize(("step_m", "refused"), [(2.9, True), (3.0, False)])
def test_the_band_is_the_vertical_separation(step_m: float, refused: bool) -> None:
    wide = {"horizontal_m": 100.0}
    assert bool(problems(separation=wide, flight={"altitude_step_m": step_m})) is refused


def test_time_slots_separate_where_they_are_long_enough() -> None:
    """The second comes to the common goal when the first has gone down far enough."""
    assert problems(simulate={**ONE_GOAL, "delay_step_s": 0.5}) != []
    assert problems(simulate={**ONE_GOAL, "delay_step_s": 5.0}) == []


def test_distances_are_those_of_the_configuration() -> None:
    near = {"count": 3}  # rows 1, 4 and 6 of cells of 50 m: 100 m apart at the least
    assert problems(simulate=near, separation={"horizontal_m": 60.0}) == []
    assert problems(simulate=near, separation={"horizontal_m": 100.0}) != []
