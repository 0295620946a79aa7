"""Configurations are refused if their vehicles would meet."""

from __future__ import annotations

import json

import pytest
from config_files import assert_problems
from flights import AREA

from swarmctl.config.checks import check_config
from swarmctl.config.model import Config


def problems(**sections: object) -> list[str]:
    """Return each problem as `key: text`."""
    content: dict[str, object] = {
        "area": AREA,
        "threats": {"count": 5},
        "simulate": {"count": 3},
        "flight": {"altitude_step_m": 0.0},
    }
    config = Config.model_validate_json(json.dumps({**content, **sections}))
    return [f"{'.'.join(map(str, problem.path))}: {problem.text}" for problem in check_config(config)]


ONE_GOAL = {"count": 2, "goal": [4, 7]}


def test_altitude_steps_alone_separate_vehicles() -> None:
    assert problems(flight={}, simulate=ONE_GOAL) == []


def test_vehicles_at_one_altitude_may_fly_where_their_first_routes_do_not_meet() -> None:
    assert problems() == []


def test_vehicles_at_one_altitude_that_meet_are_refused_with_a_cure() -> None:
    (found,) = problems(simulate=ONE_GOAL)
    values = ("uav1 and uav2", "40 and 40 m", "separation.vertical_m = 3 m", "2 s", "simulate.delay_step_s")
    assert_problems([found], [("flight.altitude_step_m", *values)])


@pytest.mark.parametrize(("step_m", "refused"), [(2.9, True), (3.6, False)])
def test_the_altitude_band_is_the_vertical_separation(step_m: float, refused: bool) -> None:
    wide = {"horizontal_m": 100.0}
    found = problems(separation=wide, flight={"altitude_step_m": step_m})
    assert_problems(found, [("flight.altitude_step_m", "simulate.delay_step_s")] * refused)


@pytest.mark.parametrize(
    ("step_m", "vertical_m", "apart_m", "most_m"),
    [(3.0, 3.0, 3.6, 2.5), (3.5, 3.0, 3.6, 2.91), (5.0, 5.0, 6.0, 4.16), (2.0, 4.0, 4.8, 3.33)],
)
def test_altitudes_with_hardly_more_than_the_limit_between_them_are_refused_with_a_cure(
    step_m: float, vertical_m: float, apart_m: float, most_m: float
) -> None:
    """No first routes meet here, but later ones may. With steps of 2 m the third vehicle is concerned."""
    (found,) = problems(separation={"vertical_m": vertical_m}, flight={"altitude_step_m": step_m})
    other, height_m = ("uav3", 40.0 + 2.0 * step_m) if step_m < vertical_m else ("uav2", 40.0 + step_m)
    names = (f"uav1 and {other}", f"40 and {height_m:g} m", f"separation.vertical_m = {vertical_m:g} m")
    remedies = (f" {apart_m:g} m or more", f" {most_m:g} m or less")
    assert_problems([found], [("flight.altitude_step_m", *names, *remedies)])
    cured = {"vertical_m": most_m}
    assert problems(separation=cured, flight={"altitude_step_m": step_m}) == []
    assert problems(separation={"vertical_m": vertical_m}, flight={"altitude_step_m": apart_m}) == []


def test_altitudes_of_fixed_wings_differ_by_the_vertical_separation() -> None:
    """Fixed wings need time slots as well."""
    found = problems(
        area={**AREA, "rows": 12, "cols": 12},
        simulate={"count": 2, "autopilot": "arduplane", "start_distance_m": 150.0},
        separation={"vertical_m": 8.0},
        flight={"altitude_m": 30.0, "altitude_step_m": 8.0, "any_angle": True},
    )
    (hardly, *_) = found
    assert_problems([hardly], [("flight.altitude_step_m", "30 and 38 m", " 9.6 m or more")])


def test_long_launch_delays_separate_vehicles() -> None:
    """The second vehicle reaches the common goal after the first has descended far enough."""
    assert problems(simulate={**ONE_GOAL, "delay_step_s": 0.5}) != []
    assert problems(simulate={**ONE_GOAL, "delay_step_s": 5.0}) == []


def test_the_check_uses_the_configured_distances() -> None:
    near = {"count": 3}  # rows 1, 4 and 6 of cells of 50 m: 100 m apart at the least
    assert problems(simulate=near, separation={"horizontal_m": 60.0}) == []
    assert problems(simulate=near, separation={"horizontal_m": 100.0}) != []
