"""What a configuration with fixed wings must say, and what of it cannot be flown."""

from __future__ import annotations

import json
from typing import Any

import pytest
from wings_configs import winged

from swarmctl.config.checks import check_config
from swarmctl.config.model import Config
from swarmctl.config.scenario import build

CORNERS = [(45.9998, 14.3975), (45.9998, 14.4085), (46.0011, 14.4085), (46.0011, 14.3975)]
TIGHT = {
    "area": {"rows": 2},
    "preflight": {"fence": {"polygon": [{"lat_deg": lat, "lon_deg": lon} for lat, lon in CORNERS]}},
}
"""A fence some 20 m around two rows of cells."""


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
    content = json.loads(winged(**sections).model_dump_json(exclude={"simulate"}, exclude_unset=True))
    return Config.model_validate_json(json.dumps({**content, "vehicles": list(vehicles)}))


def found(config: Config) -> list[tuple[str, str]]:
    return [(".".join(map(str, problem.path)), problem.text) for problem in check_config(config)]


@pytest.mark.parametrize("autopilot", ["arduplane", "px4plane"])
def test_fixed_wings_and_copters_may_fly_together(autopilot: str) -> None:
    assert found(winged(simulate={"autopilot": [autopilot, "ardupilot"]})) == []
    assert found(real(plane())) == []


@pytest.mark.parametrize(
    ("sections", "key", "says"),
    [
        ({"flight": {"any_angle": False}}, "flight.any_angle", "room for their turns; give true"),
        ({"simulate": {"start_distance_m": 60.0}}, "simulate.start_distance_m", "85 m to the centre of its"),
        ({"wings": {"takeoff_height_m": 60.0}}, "simulate.start_distance_m", "to climb to 60 m"),
        ({"wings": {"final_height_m": 50.0}}, "wings.final_height_m", "would fly at 40 m, below"),
        ({"simulate": {"goal": [5, 11]}}, "simulate.goal", "would land on the way of uav2"),
        ({"simulate": {"link": "mavsdk"}}, "simulate.link", "flown by `direct` alone"),
        (
            {"simulate": {"arrive_within_s": 300.0}, "planner": {"name": "constrained"}},
            "simulate.arrive_within_s",
            "not reckoned closely enough",
        ),
        (TIGHT, "simulate", "at its goal there is no room to land"),
        (TIGHT, "simulate", "at home there is no room to land"),
    ],
)
def test_what_it_cannot_fly_is_said(sections, key, says) -> None:
    problems = found(winged(**sections))
    assert any(key in where and says in text for where, text in problems), problems


def test_wings_that_nobody_has_are_a_mistake() -> None:
    (problem,) = found(winged(simulate={"autopilot": "ardupilot"}, wings={"glide_deg": 5.0}))
    assert problem[0] == "wings"


def test_landings_that_meet_are_refused_whenever_they_are_flown() -> None:
    close = plane(name="other", sysid=8, start={"lat_deg": 46.0032, "lon_deg": 14.3975}, goal=[8, 11])
    problems = found(real(plane(), close))
    assert any("the landings of wing and other at" in text for _, text in problems), problems


@pytest.mark.parametrize(
    ("wings", "says"),
    [
        ({"min_speed_m_s": 20.0}, "is more than speed_m_s"),
        ({"turn_radius_m": 80.0}, "loiter_radius_m 60 is less than turn_radius_m 80"),
    ],
)
def test_wings_that_contradict_themselves_are_no_configuration(wings, says) -> None:
    with pytest.raises(ValueError, match=says):
        winged(wings=wings)


def test_a_plan_knows_what_the_configuration_says_of_wings() -> None:
    scenario = build(winged(wings={"turn_radius_m": 45.0, "speed_m_s": 17.0}))
    wing, copter = scenario.tasks
    assert wing.wings is not None
    assert (wing.turn_radius_m, wing.arrival.speed_m_s) == (45.0, 17.0)
    assert copter.wings is None
    assert (copter.turn_radius_m, copter.arrival.speed_m_s) == (0.0, 10.0)
    own = build(real(plane(turn_radius_m=30.0))).tasks[0]
    assert (own.turn_radius_m, own.arrival.speed_m_s) == (30.0, 15.0)
