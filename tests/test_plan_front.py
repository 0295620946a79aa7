"""`swarmctl plan --front` as a person meets it."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flights import small as small_swarm
from test_cli import SHIPPED, swarmctl

from swarmctl import front_report
from swarmctl.agent import first_route
from swarmctl.core.belief import Observation
from swarmctl.planners import PLANNERS, Method
from swarmctl.scenario import Scenario

SMALL = """\
name: small
area: {origin_lat_deg: 46.0, origin_lon_deg: 14.4, rows: 12, cols: 12, cell_size_m: 50, no_fly: [[6, 6]]}
threats: {count: 9}
planner: {name: constrained}
simulate: {count: 2, arrive_within_s: 88}
"""


def front_of(file: Path, folder: Path, *words: str) -> tuple[str, dict[str, Any], set[str]]:
    """What is printed, the JSON, and the names of the files."""
    result = swarmctl("plan", "--front", "--config", file, "--out", folder, *words)
    assert result.exit_code == 0, result.output
    (run,) = folder.iterdir()
    return result.output, json.loads((run / "front.json").read_text()), {p.name for p in run.iterdir()}


@pytest.fixture
def small(tmp_path: Path) -> Path:
    file = tmp_path / "small.yaml"
    file.write_text(SMALL)
    return file


def test_the_shipped_swarm_has_a_front_out_of_the_box(tmp_path: Path) -> None:
    said, content, files = front_of(SHIPPED, tmp_path)
    assert files == {"front.json", "front.png"}
    assert [v["name"] for v in content["vehicles"]] == [f"uav{n}" for n in range(1, 6)]
    assert all(v["complete"] for v in content["vehicles"])
    assert all(f"uav{n}" in said for n in range(1, 6))
    table = said.split("time: from take-off")[0].splitlines()
    assert max(map(len, table)) <= 110


def test_the_routes_are_neighbouring_cells_that_add_up_and_beat_each_other_in_one_thing(
    small: Path, tmp_path: Path
) -> None:
    _, content, _ = front_of(small, tmp_path / "runs")
    for vehicle in content["vehicles"]:
        routes = vehicle["routes"]
        for route in routes:
            cells = route["cells"]
            steps = [max(abs(a[0] - b[0]), abs(a[1] - b[1])) for a, b in pairwise(cells)]
            assert set(steps) == {1}
            assert route["length_m"] == pytest.approx(50.0 * route["length_cells"])
        for shorter, longer in pairwise(routes):
            assert shorter["length_m"] < longer["length_m"]
            assert shorter["exposure_sum"] > longer["exposure_sum"]


def test_the_configured_route_is_marked_and_what_is_too_late_says_so(small: Path, tmp_path: Path) -> None:
    said, content, _ = front_of(small, tmp_path / "runs")
    for vehicle in content["vehicles"]:
        configured = vehicle["configured"]
        assert configured["cells"] == vehicle["routes"][configured["index"]]["cells"]
        assert configured["in_time"]
        late = [route for route in vehicle["routes"] if not route["in_time"]]
        assert all(route["arrives_s"] > 88.0 for route in late)
        assert all(route["exposure_sum"] < configured["exposure_sum"] for route in late)
    assert len(re.findall("← constrained", said)) == 2


def test_one_vehicle_can_be_named(small: Path, tmp_path: Path) -> None:
    said, content, _ = front_of(small, tmp_path / "runs", "--uav", "uav2")
    assert [v["name"] for v in content["vehicles"]] == ["uav2"]
    assert "uav1" not in said


def test_a_search_that_was_cut_off_says_so(small: Path, tmp_path: Path) -> None:
    said, content, _ = front_of(small, tmp_path / "runs", "--max-labels", "1")
    assert not any(v["complete"] for v in content["vehicles"])
    assert "uav1: the search was cut off" in said
    assert all(v["routes"] for v in content["vehicles"])


def test_more_vehicles_than_fit_on_a_sheet_get_another(tmp_path: Path) -> None:
    file = tmp_path / "many.yaml"
    file.write_text(SMALL.replace("count: 2, arrive_within_s: 88", "count: 8"))
    _, _, files = front_of(file, tmp_path / "runs")
    assert files == {"front.json", "front.png", "front-2.png"}


WRONG = [
    (
        "a name nobody has",
        ["--front", "--uav", "uav9"],
        "--uav uav9: no vehicle of this name; there is uav1, uav2",
    ),
    ("a vehicle without a front", ["--uav", "uav1"], "give --front too"),
]


@pytest.mark.parametrize(("words", "said"), [row[1:] for row in WRONG], ids=[row[0] for row in WRONG])
def test_wrong_usage_is_said(words: list[str], said: str, small: Path, tmp_path: Path) -> None:
    result = swarmctl("plan", "--config", small, "--out", tmp_path / "runs", *words)
    assert result.exit_code == 2
    assert said in result.stderr
    assert not (tmp_path / "runs").exists()


def test_a_planner_that_minds_something_else_is_shown_beside_the_front(tmp_path: Path) -> None:
    file = tmp_path / "survival.yaml"
    file.write_text(SMALL.replace("constrained", "survival").replace(", arrive_within_s: 88", ""))
    said, content, _ = front_of(file, tmp_path / "runs")
    assert "← survival" in said
    for vehicle in content["vehicles"]:
        best = max(route["safety_factor"] for route in vehicle["routes"])
        assert vehicle["configured"]["safety_factor"] >= best


def test_without_front_the_planners_own_route_stands_beside_the_papers(small: Path, tmp_path: Path) -> None:
    result = swarmctl("plan", "--config", small, "--out", tmp_path / "runs")
    assert result.exit_code == 0, result.output
    rows = [line.split() for line in result.output.splitlines()]
    names = [word for row in rows for word in row[:2] if word in ("0", "0.5", "1", "constrained")]
    assert names == ["0", "0.5", "1", "constrained"] * 2


def after_looking(rows: int, share: float) -> Scenario:
    """One vehicle that is to cross `rows` × `rows` cells of which a share has been looked at."""
    area = {"origin_lat_deg": 46.0, "origin_lon_deg": 14.4, "rows": rows, "cols": rows, "cell_size_m": 50.0}
    scenario = small_swarm(
        area=area, threats={"count": rows**2 // 16}, planner={"name": "time_bound"}, simulate={"count": 1}
    )
    rng = np.random.default_rng(5)
    looks = [
        (r, c, (r, c) in scenario.hostiles) for r in range(rows) for c in range(rows) if rng.random() < share
    ]
    return replace(scenario, prior=scenario.prior.merge((Observation(9, 1, 0.0, tuple(looks)),)))


def test_of_a_long_front_the_ends_the_configured_and_the_knees_are_shown() -> None:
    (vehicle,) = front_report.fronts(after_looking(40, 0.6))
    n = len(vehicle.front.routes)
    assert n > front_report.ROWS
    assert len(vehicle.shown) == front_report.ROWS
    assert {0, n - 1, vehicle.chosen_index} <= set(vehicle.shown)
    assert front_report.left_out([vehicle]) == [
        f"uav1: {n - front_report.ROWS} more of its {n} in front.json"
    ]
    table = front_report.front_table([vehicle])
    assert table.row_count == front_report.ROWS
    # What is left out lies close to the line through what is shown.
    points = np.array([(r.length_cells, r.exposure_sum) for r in vehicle.front.routes])
    shown = points[list(vehicle.shown)]
    off = np.abs(np.interp(points[:, 0], shown[:, 0], shown[:, 1]) - points[:, 1]) / np.ptp(points[:, 1])
    assert off.max() < 0.05


def test_each_route_says_for_which_w_the_papers_planner_gives_it() -> None:
    scenario = after_looking(20, 0.5)
    (vehicle,) = front_report.fronts(scenario)
    paper = Method("dijkstra", PLANNERS["dijkstra"], PLANNERS["dijkstra"].Params())
    for index, route in enumerate(vehicle.front.routes):
        said = front_report.weights(vehicle.front, index)
        if said.startswith("none"):
            assert not vehicle.front.supported[index]
            continue
        low, high = (float(word) for word in said.split(" to "))
        task = replace(vehicle.task, method=paper)
        found = first_route(task, scenario.prior, (low + high) / 2)
        assert (found.length_cells, found.exposure_sum) == pytest.approx(
            (route.length_cells, route.exposure_sum)
        )
