"""Output and files of `swarmctl plan --front`."""

from __future__ import annotations

import json
import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flights import AREA
from flights import small as small_swarm
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from swarmctl_process import SHIPPED, swarmctl

from swarmctl.agent.replan.decide import first_route
from swarmctl.config.scenario import Scenario
from swarmctl.core.inference.survival import ProbabilityEstimate
from swarmctl.core.observation import Observation
from swarmctl.core.records import replace
from swarmctl.planners import PLANNERS, Method, Route
from swarmctl.planners.front import Front
from swarmctl.report import front
from swarmctl.report.tables import estimate_texts

SMALL = """\
name: small
area: {origin_lat_deg: 46.0, origin_lon_deg: 14.4, rows: 12, cols: 12, cell_size_m: 50, no_fly: [[6, 6]]}
threats: {count: 9}
planner: {name: constrained}
simulate: {count: 2, arrive_within_s: 97}
"""


def front_of(file: Path, folder: Path, *words: str) -> tuple[str, dict[str, Any], set[str]]:
    """Return the printed text, the JSON, and the names of the files."""
    result = swarmctl("plan", "--front", "--config", file, "--out", folder, *words)
    assert result.exit_code == 0, result.output
    (run,) = folder.iterdir()
    return result.output, json.loads((run / "front.json").read_text()), {p.name for p in run.iterdir()}


@pytest.fixture
def small(tmp_path: Path) -> Path:
    file = tmp_path / "small.yaml"
    file.write_text(SMALL)
    return file


def test_the_shipped_swarm_has_a_front(tmp_path: Path) -> None:
    output, content, files = front_of(SHIPPED, tmp_path)
    assert files == {"front.json", "front.png"}
    assert [v["name"] for v in content["vehicles"]] == [f"uav{n}" for n in range(1, 6)]
    assert all(v["complete"] for v in content["vehicles"])
    assert all(f"uav{n}" in output for n in range(1, 6))
    table = output.split("time: from take-off")[0].splitlines()
    assert max(map(len, table)) <= 110


def test_each_route_is_connected_and_better_than_another_in_one_measure(small: Path, tmp_path: Path) -> None:
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


def test_the_configured_route_and_late_routes_are_marked(small: Path, tmp_path: Path) -> None:
    output, content, _ = front_of(small, tmp_path / "runs")
    n_late = 0
    for vehicle in content["vehicles"]:
        configured = vehicle["configured"]
        assert configured["cells"] == vehicle["routes"][configured["index"]]["cells"]
        assert configured["in_time"]
        late = [route for route in vehicle["routes"] if route["arrives_s"] > 97.0]
        assert late
        assert [route for route in vehicle["routes"] if not route["in_time"]] == late
        assert all(route["exposure_sum"] < configured["exposure_sum"] for route in late)
        n_late += len(late)
    assert len(re.findall("← constrained", output)) == 2
    assert len(re.findall("time bound", output)) == n_late


@pytest.mark.parametrize("named", ["uav2", "2"])
def test_one_vehicle_can_be_named(named: str, small: Path, tmp_path: Path) -> None:
    output, content, _ = front_of(small, tmp_path / "runs", "--uav", named)
    assert [v["name"] for v in content["vehicles"]] == ["uav2"]
    assert "uav1" not in output


@pytest.mark.parametrize(("named", "is_member"), [("uav1", True), ("uav3", False)])
def test_only_the_front_of_a_member_has_a_note_about_groups(
    named: str, is_member: bool, tmp_path: Path
) -> None:
    file = tmp_path / "group.yaml"
    group = "formations: [{name: alpha, members: [uav1, uav2]}]\n"
    content = SMALL.replace("constrained", "dijkstra").replace("count: 2, arrive_within_s: 97", "count: 3")
    file.write_text(f"{content}{group}")
    output, _, _ = front_of(file, tmp_path / "runs", "--uav", named)
    assert ("group" in output) is is_member


def test_a_limited_search_is_marked(small: Path, tmp_path: Path) -> None:
    output, content, _ = front_of(small, tmp_path / "runs", "--max-labels", "1")
    assert not any(v["complete"] for v in content["vehicles"])
    assert "--max-labels" in output
    assert all(v["routes"] for v in content["vehicles"])


def test_vehicles_that_do_not_fit_on_a_sheet_get_another_sheet(tmp_path: Path) -> None:
    file = tmp_path / "many.yaml"
    file.write_text(SMALL.replace("count: 2, arrive_within_s: 97", "count: 8"))
    _, _, files = front_of(file, tmp_path / "runs")
    assert files == {"front.json", "front.png", "front-2.png"}


WRONG = [
    (
        "an unknown vehicle",
        ["--front", "--uav", "uav9"],
        "1 (uav1), 2 (uav2)",
    ),
    ("a vehicle without --front", ["--uav", "uav1"], "--front;"),
]


@pytest.mark.parametrize(("words", "output"), [row[1:] for row in WRONG], ids=[row[0] for row in WRONG])
def test_wrong_usage_is_an_error(words: list[str], output: str, small: Path, tmp_path: Path) -> None:
    result = swarmctl("plan", "--config", small, "--out", tmp_path / "runs", *words)
    assert result.exit_code == 2
    assert output in result.stderr
    assert not (tmp_path / "runs").exists()


def test_a_planner_with_another_objective_is_shown_beside_the_front(tmp_path: Path) -> None:
    file = tmp_path / "survival.yaml"
    file.write_text(SMALL.replace("constrained", "survival").replace(", arrive_within_s: 97", ""))
    output, content, _ = front_of(file, tmp_path / "runs")
    assert "← survival" in output
    for vehicle in content["vehicles"]:
        best = max(route["safety_factor"] for route in vehicle["routes"])
        assert vehicle["configured"]["safety_factor"] >= best


def off_the_front() -> front.VehicleFront:
    """Return a front with so many hostiles that the sum and the product of P_s disagree."""
    scenario = small_swarm(
        area={**AREA, "rows": 9, "cols": 14}, threats={"count": 70}, planner={"name": "survival"}
    )
    (vehicle,) = front.fronts(scenario, ["uav2"])
    assert vehicle.chosen_index is None
    return vehicle


def test_a_configured_route_off_the_front_has_its_chance_and_its_track(tmp_path: Path) -> None:
    file = tmp_path / "off.yaml"
    text = SMALL.replace("rows: 12, cols: 12", "rows: 9, cols: 14").replace(", no_fly: [[6, 6]]", "")
    text = text.replace("count: 9", "count: 70").replace("constrained", "survival")
    file.write_text(text.replace("count: 2, arrive_within_s: 97", "count: 3"))
    output, content, _ = front_of(file, tmp_path / "runs", "--uav", "uav2")
    (row,) = [line for line in output.splitlines() if "not on the front" in line]
    (vehicle,) = content["vehicles"]
    chance = vehicle["configured"]["chance_by_simulation"]
    assert vehicle["configured"]["index"] is None
    assert 0.0 < chance["estimate"] < chance["high_95"]
    texts = estimate_texts(ProbabilityEstimate(chance["estimate"], chance["low_95"], chance["high_95"], 0))
    assert all(f" {text} " in row for text in texts)
    table, _, _legend = output.partition("\ntime: ")
    assert " 0.000" not in table


def test_a_configured_route_off_the_front_differs_from_all_routes_on_it() -> None:
    drawn = front.panel_of(off_the_front())
    assert drawn.chosen_track is not None
    assert len(drawn.chosen_track) > 3
    assert all(drawn.chosen_track != point.track for point in drawn.points)
    (vehicle,) = front.fronts(after_looking(40, 0.6))
    assert front.panel_of(vehicle).chosen_track is None


def test_every_route_has_a_chance_even_if_the_table_omits_it(small: Path, tmp_path: Path) -> None:
    (vehicle,) = front.fronts(after_looking(40, 0.6))
    assert len(vehicle.shown) < len(vehicle.candidates)
    _, content, _ = front_of(small, tmp_path / "runs")
    for route in [r for v in content["vehicles"] for r in (*v["routes"], v["configured"])]:
        chance = route["chance_by_simulation"]
        assert 0.0 <= chance["low_95"] <= chance["estimate"] <= chance["high_95"] <= 1.0


@pytest.mark.parametrize("counting", ["entered", "integral"])
def test_the_front_has_the_flown_lengths_of_straightened_routes(
    counting: str, small: Path, tmp_path: Path
) -> None:
    file = tmp_path / "pulled.yaml"
    file.write_text(f"{SMALL}flight: {{any_angle: true, any_angle_exposure: {counting}}}\n")
    output, content, _ = front_of(file, tmp_path / "pulled")
    _, lattice, _ = front_of(small, tmp_path / "lattice")
    n_pulled = 0
    for vehicle, other in zip(content["vehicles"], lattice["vehicles"], strict=True):
        for route, plain in zip(vehicle["routes"], other["routes"], strict=True):
            before = route["pulled_from"] or route
            assert [before["length_m"], before["cells"]] == [plain["length_m"], plain["cells"]]
            assert plain["pulled_from"] is None
            assert route["length_m"] <= plain["length_m"] + 1e-6
            assert f" {route['length_m']:.0f} " in output
            assert f" {route['exposure_sum']:.3f} " in output
            n_pulled += route["length_m"] < plain["length_m"] - 1.0
        assert vehicle["configured"]["length_m"] == pytest.approx(
            vehicle["routes"][vehicle["configured"]["index"]]["length_m"]
        )
    assert ("pulled straight" in output) == any(
        route["pulled_from"] for vehicle in content["vehicles"] for route in vehicle["routes"]
    )
    assert counting == "entered" or n_pulled > 0


def after_looking(rows: int, share: float) -> Scenario:
    """Return a vehicle before `rows` × `rows` cells, of which a share has been observed."""
    area = {"origin_lat_deg": 46.0, "origin_lon_deg": 14.4, "rows": rows, "cols": rows, "cell_size_m": 50.0}
    scenario = small_swarm(
        area=area, threats={"count": rows**2 // 16}, planner={"name": "time_bound"}, simulate={"count": 1}
    )
    rng = np.random.default_rng(5)
    looks = [
        (r, c, (r, c) in scenario.hostiles) for r in range(rows) for c in range(rows) if rng.random() < share
    ]
    return replace(scenario, prior=scenario.prior.merge((Observation(9, 1, 0.0, tuple(looks)),)))


def test_a_long_front_shows_its_ends_its_knees_and_the_configured_route() -> None:
    (vehicle,) = front.fronts(after_looking(40, 0.6))
    n = len(vehicle.front.routes)
    assert n > front.MAX_ROWS
    assert len(vehicle.shown) == front.MAX_ROWS
    assert {0, n - 1, vehicle.chosen_index} <= set(vehicle.shown)
    # The table omits routes that no w finds before routes of some w.
    supported = {i for i, some_w_finds_it in enumerate(vehicle.front.supported) if some_w_finds_it}
    assert supported <= set(vehicle.shown) or set(vehicle.shown) - {0, n - 1} <= supported
    (line,) = front.front_notes([vehicle])
    assert re.findall(r"\d+", line.partition(": ")[2]) == [str(n - front.MAX_ROWS), str(n)]
    assert "front.json" in line
    table = front.front_table([vehicle]).at()
    assert table.row_count == front.MAX_ROWS
    # Omitted routes lie close to the line through the shown routes.
    points = np.array([(r.length_cells, r.exposure_sum) for r in vehicle.front.routes])
    shown = points[list(vehicle.shown)]
    off = np.abs(np.interp(points[:, 0], shown[:, 0], shown[:, 1]) - points[:, 1]) / np.ptp(points[:, 1])
    assert off.max() < 0.05


def test_each_route_lists_the_weights_that_lead_to_it() -> None:
    scenario = after_looking(20, 0.5)
    (vehicle,) = front.fronts(scenario)
    paper = Method("dijkstra", PLANNERS["dijkstra"], PLANNERS["dijkstra"].Params())
    for index, route in enumerate(vehicle.front.routes):
        output = front.w_range_text(vehicle.front, index)
        if output == "–":
            assert not vehicle.front.supported[index]
            continue
        low, high = (float(word) for word in output.split(" to "))
        task = replace(vehicle.task, method=paper, w=(low + high) / 2)
        found = first_route(task, scenario.prior)
        assert (found.length_cells, found.exposure_sum) == pytest.approx(
            (route.length_cells, route.exposure_sum)
        )


def test_a_configured_route_between_the_knees_is_shown() -> None:
    scenario = after_looking(60, 0.6)
    (vehicle,) = front.fronts(scenario)
    paper = Method("dijkstra", PLANNERS["dijkstra"], PLANNERS["dijkstra"].Params())
    between = [
        i for i in range(len(vehicle.candidates)) if i not in vehicle.shown and vehicle.front.supported[i]
    ]
    assert between
    w_range = vehicle.front.w_ranges[between[0]]
    assert w_range is not None
    task = replace(scenario.tasks[0], method=paper, w=sum(w_range) / 2)
    (vehicle,) = front.fronts(replace(scenario, tasks=(task,)))
    assert vehicle.chosen_index == between[0]
    assert vehicle.chosen_index in vehicle.shown


def front_that_changes_at(weights: list[float]) -> Front:
    """Return a front with one route for each range between neighbouring weights."""
    ends = [0.0, *weights, 1.0]
    route = Route(((0, 0),), 0.0, 0.0, 0.0, 1.0)
    n = len(ends) - 1
    return Front((route,) * n, (True,) * n, tuple(pairwise(ends)), True)


def test_a_route_that_a_single_weight_finds_is_marked() -> None:
    assert front.w_range_text(front_that_changes_at([0.5, 0.5]), 1) == "0.5 alone"


@settings(derandomize=True, deadline=None, max_examples=examples(80))
@given(st.lists(st.floats(1e-6, 1.0 - 1e-6), max_size=6, unique_by=lambda w: round(w, 7)))
def test_different_weights_are_printed_differently(weights: list[float]) -> None:
    found = front_that_changes_at(sorted(weights))
    output = [front.w_range_text(found, i).split(" to ") for i in range(len(weights) + 1)]
    assert [high for _, high in output[:-1]] == [low for low, _ in output[1:]]
    assert (output[0][0], output[-1][1]) == ("0", "1")
    ends = [float(low) for low, _ in output] + [1.0]
    assert all(low < high for low, high in pairwise(ends))
