"""Which configurations are refused because vehicles would meet, told as configurations."""

from __future__ import annotations

import json

import pytest
from flights import AREA

from swarmctl.config.checks import check_config
from swarmctl.config.model import Config


def problems(**sections: object) -> list[str]:
    content: dict[str, object] = {
        "area": AREA,
        "threats": {"count": 5},
        "simulate": {"count": 3},
        "flight": {"altitude_step_m": 0.0},
    }
    config = Config.model_validate_json(json.dumps({**content, **sections}))
    return [f"{'.'.join(map(str, problem.path))}: {problem.text}" for problem in check_config(config)]


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


@pytest.mark.parametrize(("step_m", "refused"), [(2.9, "their first routes meet"), (3.6, "")])
def test_the_band_is_the_vertical_separation(step_m: float, refused: str) -> None:
    wide = {"horizontal_m": 100.0}
    found = problems(separation=wide, flight={"altitude_step_m": step_m})
    assert [refused in text for text in found] == [True] * bool(refused)


@pytest.mark.parametrize(
    ("step_m", "vertical_m", "apart_m", "most_m"),
    [(3.0, 3.0, 3.6, 2.5), (3.5, 3.0, 3.6, 2.91), (5.0, 5.0, 6.0, 4.16), (2.0, 4.0, 4.8, 3.33)],
)
def test_altitudes_that_keep_the_limit_and_no_more_are_refused_with_a_cure(
    step_m: float, vertical_m: float, apart_m: float, most_m: float
) -> None:
    """Though no first routes meet: others may. Of steps of 2 m the third vehicle is meant."""
    (found,) = problems(separation={"vertical_m": vertical_m}, flight={"altitude_step_m": step_m})
    other, height_m = ("uav3", 40.0 + 2.0 * step_m) if step_m < vertical_m else ("uav2", 40.0 + step_m)
    assert found == (
        f"flight.altitude_step_m: uav1 and {other} would fly at 40 and {height_m:g} m, hardly more than "
        f"separation.vertical_m = {vertical_m:g} m apart: heights are not held to the metre, and each "
        f"crossing would raise an alarm; give them altitudes that differ by {apart_m:g} m or more, or a "
        f"separation.vertical_m of {most_m:g} m or less"
    )
    cured = {"vertical_m": most_m}
    assert problems(separation=cured, flight={"altitude_step_m": step_m}) == []
    assert problems(separation={"vertical_m": vertical_m}, flight={"altitude_step_m": apart_m}) == []


def test_wings_are_to_differ_in_height_as_much() -> None:
    """For all that they need slots as well."""
    found = problems(
        area={**AREA, "rows": 12, "cols": 12},
        simulate={"count": 2, "autopilot": "arduplane", "start_distance_m": 150.0},
        separation={"vertical_m": 8.0},
        flight={"altitude_m": 30.0, "altitude_step_m": 8.0, "any_angle": True},
    )
    assert any("hardly more than separation.vertical_m = 8 m apart" in text for text in found)


def test_time_slots_separate_where_they_are_long_enough() -> None:
    """The second comes to the common goal when the first has gone down far enough."""
    assert problems(simulate={**ONE_GOAL, "delay_step_s": 0.5}) != []
    assert problems(simulate={**ONE_GOAL, "delay_step_s": 5.0}) == []


def test_distances_are_those_of_the_configuration() -> None:
    near = {"count": 3}  # rows 1, 4 and 6 of cells of 50 m: 100 m apart at the least
    assert problems(simulate=near, separation={"horizontal_m": 60.0}) == []
    assert problems(simulate=near, separation={"horizontal_m": 100.0}) != []
