"""Groups that cannot fly are refused at their key, before anything starts."""

from __future__ import annotations

import json
import re
from typing import Any

import pytest
from flights import AREA

from swarmctl.config.checks import check_config
from swarmctl.config.model import Config, validate
from swarmctl.config.problems import ConfigProblem

GROUP = {"name": "alpha", "members": ["uav1", "uav2", "uav3"]}


def keys_of_problems(*groups: dict[str, Any], **sections: Any) -> set[tuple[str | int, ...]]:
    return {problem.path for problem in problems(*groups, **sections)}


def problems(*groups: dict[str, Any], **sections: Any) -> list[ConfigProblem]:
    content: dict[str, Any] = {
        "name": "small",
        "area": AREA,
        "threats": {"count": 5},
        "communication": {"bus": "memory"},
        "simulate": {"count": 3, "start_spacing_m": 20.0, "goal": [4, 7]},
        "formations": [GROUP | group for group in groups],
    }
    for name, change in sections.items():
        content[name] = {**content.get(name, {}), **change}
    config = Config.model_validate_json(json.dumps(content))
    return list(check_config(config))


def test_a_wedge_of_three_is_accepted() -> None:
    assert keys_of_problems({}) == set()


@pytest.mark.parametrize(
    "group",
    [
        {"shape": {"kind": "offsets", "offsets_m": [[0, 0, 8], [0, 0, 16]]}, "heights": "level"},
        {
            "shape": {"kind": "wedge", "spacing_m": 30.0},
            "narrow_shape": {"kind": "column", "spacing_m": 20.0},
        },
    ],
    ids=["stacked", "two shapes"],
)
def test_a_group_that_can_fly_is_accepted(group: dict[str, Any]) -> None:
    assert keys_of_problems(group) == set()


@pytest.mark.parametrize(
    ("group", "sections", "key"),
    [
        pytest.param({"members": ["uav1", "uav9"]}, {}, ("members", 1), id="unknown vehicle"),
        pytest.param({"members": ["uav1", "uav1"]}, {}, ("members", 1), id="twice a member"),
        pytest.param({"speed_m_s": 10.0}, {}, ("speed_m_s",), id="no reserve for turns"),
        pytest.param(
            {"shape": {"kind": "column", "spacing_m": 6.0}},
            {"flight": {"altitude_step_m": 1.0}},
            ("shape",),
            id="narrower than the separation",
        ),
        pytest.param(
            {"shape": {"kind": "line", "spacing_m": 6.0}, "heights": "level"},
            {},
            ("shape",),
            id="level, too near",
        ),
        pytest.param(
            {"shape": {"kind": "line", "spacing_m": 11.5}, "heights": "level"},
            {},
            ("shape",),
            id="level, no margin beside the separation",
        ),
        pytest.param(
            {
                "shape": {"kind": "wedge", "spacing_m": 12.0},
                "narrow_shape": {"kind": "column", "spacing_m": 12.0},
                "heights": "level",
            },
            {},
            ("narrow_shape",),
            id="too near on the way to the narrow shape",
        ),
        *(
            pytest.param(
                {"shape": {"kind": "line", "spacing_m": 30.0, "height_step_m": step_m}, "heights": "level"},
                {},
                ("shape",),
                id=f"level, {step_m:+g} m from place to place",
            )
            for step_m in (-20.0, 60.0)
        ),
        pytest.param(
            {},
            {
                "simulate": {"arrive_within_s": 900.0, "speed_m_s": 10.0},
                "planner": {"name": "time_bound"},
            },
            ("members",),
            id="a time of arrival",
        ),
        pytest.param(
            {"shape": {"kind": "line", "spacing_m": 300.0}}, {}, ("shape",), id="wider than the area"
        ),
        pytest.param(
            {"narrow_shape": {"kind": "column", "spacing_m": 300.0}},
            {},
            ("narrow_shape",),
            id="longer than the area",
        ),
        pytest.param(
            {"shape": {"kind": "offsets", "offsets_m": [[-30, 0, 0]]}},
            {},
            ("shape", "offsets_m"),
            id="few offsets",
        ),
        pytest.param(
            {"shape": {"kind": "offsets", "offsets_m": [[0, 0, 0], [-30, 30, 0], [-30, -30, 0]]}},
            {},
            ("shape", "offsets_m"),
            id="an offset for the first member",
        ),
        pytest.param(
            {"shape": {"kind": "line", "height_step_m": 4.0}},
            {},
            ("shape", "height_step_m"),
            id="heights of places without an effect",
        ),
        pytest.param(
            {"shape": {"kind": "line", "spacing_m": 60.0}},
            {"area": {"no_fly": [[row, 4] for row in range(AREA["rows"]) if row != 4]}},
            ("shape",),
            id="a wall with a gap for one vehicle",
        ),
        pytest.param({}, {"communication": {"max_distance_m": 25.0}}, ("shape",), id="messages end too near"),
        pytest.param({}, {"communication": {"range": 1}}, ("members",), id="messages reach one member"),
        pytest.param(
            {}, {"communication": {"min_distance_m": 35.0}}, ("shape",), id="members are too near to hear"
        ),
        pytest.param(
            {"split_factor": 1.1, "exposure": "survival"},
            {"flight": {"altitude_step_m": 6.0}},
            ("split_factor",),
            id="a split has no measure of survival",
        ),
        pytest.param(
            {"split_factor": 1.1, "heights": "level"},
            {"flight": {"altitude_step_m": 6.0}},
            ("split_factor",),
            id="ways cross at one height",
        ),
        pytest.param(
            {"split_factor": 1.1},
            {"flight": {"altitude_step_m": 3.0}},
            ("split_factor",),
            id="ways cross with too little height between",
        ),
    ],
)
def test_a_group_that_cannot_fly_is_refused(
    group: dict[str, Any], sections: dict[str, Any], key: tuple[str | int, ...]
) -> None:
    assert ("formations", 0, *key) in keys_of_problems(group, **sections)


@pytest.mark.parametrize("any_angle", [False, True])
def test_a_plane_in_a_group_is_the_only_problem(any_angle: bool) -> None:
    """Problems of the plane's own flight would lead the reader away from the cause."""
    found = problems(
        {},
        simulate={"autopilot": ["ardupilot", "ardupilot", "arduplane"]},
        flight={"any_angle": any_angle},
    )
    assert [problem.path for problem in found] == [("formations", 0, "members")]
    assert found[0].text.endswith(": uav3")


def test_a_vehicle_in_two_groups_is_refused() -> None:
    assert ("formations", 1, "members", 0) in keys_of_problems(
        {}, {"name": "beta", "members": ["uav3", "uav2"]}
    )


def test_a_link_without_set_points_is_refused() -> None:
    assert ("formations", 0, "members") in keys_of_problems({}, simulate={"link": "mavsdk"})


@pytest.mark.parametrize("approach", ["leader_following", "behavioural", "virtual_structure"])
def test_an_unknown_parameter_of_an_approach_is_refused(approach: str) -> None:
    with pytest.raises(ValueError, match="closeness"):
        Config.model_validate_json(
            json.dumps(
                {"area": AREA, "threats": {"count": 0}, "simulate": {"count": 3}}
                | {"formations": [GROUP | {"approach": approach, "options": {"closeness": 1.0}}]}
            )
        )


def test_the_spacing_of_the_cure_is_accepted() -> None:
    def problems_of(spacing_m: float) -> list[ConfigProblem]:
        shape = {"kind": "wedge", "spacing_m": spacing_m, "opening_deg": 30.0}
        return problems({"shape": shape, "heights": "level"})

    (problem,) = problems_of(20.0)
    needed_m = re.search(r"([0-9]+) m or more", problem.text)
    assert needed_m is not None
    assert problems_of(float(needed_m[1])) == []


def test_a_group_with_a_wrong_name_is_refused() -> None:
    group = {"name": "alpha team", "members": ("uav1", "uav2", "uav3")}
    content = {"area": AREA, "threats": {"count": 0}, "simulate": {"count": 3}, "formations": (group,)}
    _, found = validate(content, check_config)
    assert [problem.path for problem in found] == [("formations", 0, "name")]
