"""Checks of configurations with fixed wings."""

from __future__ import annotations

import json
from typing import Any

import pytest
from flights import winged, winged_config
from pydantic import ValidationError

from swarmctl.config.checks import check_config
from swarmctl.config.model import Config
from swarmctl.config.scenario import build

CORNERS = [(45.9998, 14.3975), (45.9998, 14.4085), (46.0011, 14.4085), (46.0011, 14.3975)]
TIGHT = {
    "area": {"rows": 2},
    "preflight": {"fence": {"polygon": [{"lat_deg": lat, "lon_deg": lon} for lat, lon in CORNERS]}},
}
"""a fence with a margin of about 20 m around two rows of cells"""


def plane(**changes: Any) -> dict[str, Any]:
    vehicle = {
        "name": "wing",
        "url": "udpin://127.0.0.1:14550",
        "sysid": 9,
        "airframe": "plane",
        "start": {"lat_deg": 46.0027, "lon_deg": 14.3975},
        "goal": [6, 11],
        "speed_m_s": 15.0,
    }
    return vehicle | changes


def real(*vehicles: dict[str, Any], **sections: Any) -> Config:
    content = json.loads(winged_config(**sections).model_dump_json(exclude={"simulate"}, exclude_unset=True))
    return Config.model_validate_json(json.dumps({**content, "vehicles": list(vehicles)}))


def found(config: Config) -> list[tuple[str, str]]:
    return [(".".join(map(str, problem.path)), problem.text) for problem in check_config(config)]


@pytest.mark.parametrize("autopilot", ["arduplane", "px4plane"])
def test_fixed_wings_and_copters_may_fly_together(autopilot: str) -> None:
    assert found(winged_config(simulate={"autopilot": [autopilot, "ardupilot"]})) == []
    assert found(real(plane())) == []


@pytest.mark.parametrize(
    ("sections", "key", "values"),
    [
        ({"flight": {"any_angle": False}}, "flight.any_angle", ()),
        ({"simulate": {"start_distance_m": 60.0}}, "simulate.start_distance_m", ("uav1", "85 m")),
        ({"wings": {"takeoff_height_m": 60.0}}, "simulate.start_distance_m", ("60 m", "takeoff_height_m")),
        ({"wings": {"final_height_m": 50.0}}, "wings.final_height_m", ("uav1", "30 m", "50 m")),
        ({"simulate": {"goal": [5, 11]}}, "simulate.goal", ("uav1", "uav2")),
        ({"simulate": {"link": "mavsdk"}}, "simulate.link", ("direct",)),
        (
            {"simulate": {"arrive_within_s": 300.0}, "planner": {"name": "constrained"}},
            "simulate.arrive_within_s",
            (),
        ),
        (TIGHT, "simulate.turn_radius_m", ("uav1", "preflight.fence")),
        (TIGHT, "simulate.start_distance_m", ("uav1", "preflight.fence")),
    ],
)
def test_a_setting_that_a_fixed_wing_cannot_fly_is_reported_at_its_key(
    sections: dict[str, Any], key: str, values: tuple[str, ...]
) -> None:
    problems = found(winged_config(**sections))
    assert any(key == where and all(v in text for v in values) for where, text in problems), problems


def test_the_section_wings_without_a_fixed_wing_is_refused() -> None:
    (problem,) = found(winged_config(simulate={"autopilot": "ardupilot"}, wings={"glide_deg": 5.0}))
    assert problem[0] == "wings"


def test_landings_that_meet_are_refused_at_any_time() -> None:
    close = plane(name="other", sysid=8, start={"lat_deg": 46.0032, "lon_deg": 14.3975}, goal=[8, 11])
    problems = found(real(plane(), close))
    assert any(
        where == "separation.horizontal_m" and {"wing", "other"} <= set(text.split())
        for where, text in problems
    ), problems


@pytest.mark.parametrize(
    ("wings", "values"),
    [
        ({"min_speed_m_s": 20.0}, ("min_speed_m_s 20", "speed_m_s 15")),
        ({"turn_radius_m": 80.0}, ("loiter_radius_m 60", "turn_radius_m 80")),
    ],
)
def test_contradictory_wings_are_refused(wings: dict[str, float], values: tuple[str, ...]) -> None:
    with pytest.raises(ValidationError) as error:
        winged_config(wings=wings)
    assert all(value in str(error.value) for value in values)


def test_a_task_has_the_configured_performance_of_its_fixed_wing() -> None:
    scenario = winged(wings={"turn_radius_m": 45.0, "speed_m_s": 17.0})
    wing, copter = scenario.tasks
    assert wing.wings is not None
    assert (wing.turn_radius_m, wing.arrival.speed_m_s) == (45.0, 17.0)
    assert copter.wings is None
    assert (copter.turn_radius_m, copter.arrival.speed_m_s) == (0.0, 10.0)
    own = build(real(plane(turn_radius_m=30.0))).tasks[0]
    assert (own.turn_radius_m, own.arrival.speed_m_s) == (30.0, 15.0)
