"""All errors of a configuration are reported at once, with their places, before anything starts."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest
from config_files import GOOD, assert_problems, problems


def test_starts_that_are_too_near_are_found_with_a_third_start_between_their_longitudes(
    tmp_path: Path,
) -> None:
    third = "  - {name: c, url: 'udpin://:14550', sysid: 3, goal: [6, 9], "
    third += "start: {lat_deg: 46.005, lon_deg: 13.990002}}"
    near = GOOD.replace("46.001, lon_deg: 13.99}", "46.0, lon_deg: 13.990004}")
    assert_problems(problems(f"{near}{third}\n", tmp_path), [(":8: vehicles", "a and b")])


def test_a_merge_key_takes_the_values_of_its_anchor(tmp_path: Path) -> None:
    text = GOOD.replace("  - {name: a,", "  - &a {name: a,").replace("  - {name: b,", "  - {<<: *a, name: b,")
    assert "<<: *a" in text
    assert problems(text, tmp_path) == problems(GOOD, tmp_path)


MILLION_ALIASES = "[&a [0,0,0,0,0,0,0,0,0,0]" + "".join(
    f", &{name} [{','.join(10 * [f'*{before}'])}]" for before, name in pairwise("abcdef")
)
MILLION_ALIASES += "]"
BAD: list[tuple[str, str, str, list[tuple[str, ...]]]] = [
    ("an unknown key", "rows: 20", "rosw: 20, rows: 20", [(":2: area.rosw", "'rows'")]),
    ("a missing key", "cell_size_m: 50", "", [(":2: area.cell_size_m",)]),
    ("w above 1", "w: 0.5", "w: 1.5", [(":6: planner.w", "1", "1.5")]),
    ("an unknown planner", "name: dijkstra", "name: astar", [(":6: planner.name", "dijkstra", "'astar'")]),
    ("strengths that do not decrease", "direct: 0.6", "direct: 0.3", [(":5: threats.firing_strength",)]),
    ("too many hostiles", "count: 24", "count: 401", [(":4: threats.count", "401", "400")]),
    ("a goal outside", "[3, 19]", "[3, 20]", [(":9: vehicles[0].goal[0]", "[3, 20]", "0..19")]),
    ("a zone partly outside", "[5, 9]", "[5, 99]", [(":10: vehicles[1].goal[1]", "[5, 99]", "0..19")]),
    (
        "one sysid twice on a link",
        "sysid: 2",
        "sysid: 1",
        [(":10: vehicles[1].sysid", "1", "udpin://:14550")],
    ),
    ("a name that is a folder", "name: b", "name: '..'", [(":10: vehicles[1].name", "'..'", "letter")]),
    ("a name that is an option", "name: b", "name: -rf", [(":10: vehicles[1].name", "'-rf'", "letter")]),
    ("a hidden name", "name: b", "name: .b", [(":10: vehicles[1].name", "'.b'", "letter")]),
    ("a name of two key parts", "name: b", "name: a/b", [(":10: vehicles[1].name", "'a/b'", "letter")]),
    ("a wildcard as a name", "name: b", "name: '*'", [(":10: vehicles[1].name", "'*'", "letter")]),
    ("a swarm's name that is an option", "name: test", "name: -x", [(":1: name", "'-x'", "letter")]),
    ("one name twice", "name: b", "name: a", [(":10: vehicles[1].name", "'a'")]),
    (
        "a URL of no known form",
        '"udpin://:14550", sysid: 2',
        '"ftp:x", sysid: 2',
        [(":10: vehicles[1].url",)],
    ),
    (
        "a start too far away",
        "sysid: 1, start: {lat_deg: 46.0",
        "sysid: 1, start: {lat_deg: 47.0",
        [(":9: vehicles[0].start", "110", "flight.max_start_distance_m = 5000")],
    ),
    (
        "a start too far away from its given entry",
        "sysid: 1, start: {lat_deg: 46.0",
        "entry: [0, 0], sysid: 1, start: {lat_deg: 47.0",
        [(":9: vehicles[0].start", "11", "flight.max_start_distance_m = 5000")],
    ),
    (
        "an entry in the middle",
        "goal: [3, 19]",
        "goal: [3, 19], entry: [5, 5]",
        [(":9: vehicles[0].entry", "(5, 5)")],
    ),
    ("a start in another's place", "46.001,", "46.0,", [(":8: vehicles", "a and b")]),
    (
        "altitudes that do not differ",
        "goal: [3, 19]}",
        "goal: [[4, 9], [5, 9]], altitude_m: 45}",
        [(":1: flight.altitude_step_m", "a and b", "45 and 45 m")],
    ),
    ("a word for a number", "count: 24", "count: yes", [(":4: threats.count", "integer")]),
    ("a text for a number", "rows: 20", 'rows: "20"', [(":2: area.rows", "integer", "'20'")]),
    ("too many cells", "rows: 20, cols: 20", "rows: 9999, cols: 9999", [(":2: area", "99980001", "4000000")]),
    (
        "a start behind a forbidden cell",
        "cell_size_m: 50}",
        f"cell_size_m: 50, no_fly: {[[row, 0] for row in range(20)]}}}",
        [
            (":9: vehicles[0].entry", "a ", "(0, 0)", "area.no_fly"),
            (":10: vehicles[1].entry", "b ", "area.no_fly"),
        ],
    ),
    (
        "an entry across the area",
        "goal: [3, 19]",
        "goal: [3, 19], entry: [0, 19]",
        [(":9: vehicles[0].entry", "a ", "(0, 19)")],
    ),
    ("a date of month 13", "name: test", "name: 2030-13-01", [(":1", "'2030-13-01'", "quotes")]),
    ("a tag that does not fit", "rows: 20", "rows: !!int many", [(":2", "'many'", "int")]),
    ("a NUL byte", "name: test", "name: te\0st", [(":1",)]),
    ("malformed YAML", "vehicles:", "vehicles: [", [(":9",)]),
    ("a key without a colon", "area:", "seed\narea:", [(":2",)]),
    ("an alias within itself", "vehicles:", "x: &a [*a]\nvehicles:", [(":1",)]),
    ("aliases by the million", "vehicles:", f"x: {MILLION_ALIASES}\nvehicles:", [(":8",)]),
    (
        "a wall before both goals",
        "cell_size_m: 50}",
        f"cell_size_m: 50, no_fly: {[[row, 5] for row in range(20)]}}}",
        [(":9: vehicles[0].goal", "a ", "area.no_fly"), (":10: vehicles[1].goal", "b ", "area.no_fly")],
    ),
    ("an empty file", GOOD, "", [(":1", "swarmctl init")]),
    ("a key twice", "planner:", "name: again\nplanner:", [(":6", "'name'", "line 1")]),
]


@pytest.mark.parametrize(("old", "new", "expected"), [row[1:] for row in BAD], ids=[row[0] for row in BAD])
def test_an_error_is_reported_with_its_line_its_key_and_the_values(
    old: str, new: str, expected: list[tuple[str, ...]], tmp_path: Path
) -> None:
    assert old in GOOD
    assert_problems(problems(GOOD.replace(old, new, 1), tmp_path), expected)


def test_too_many_vehicles_for_one_goal_are_refused(tmp_path: Path) -> None:
    crowd = "area: {origin_lat_deg: 46.0, origin_lon_deg: 14.0, rows: 20, cols: 20, cell_size_m: 10}\n"
    crowd += "threats: {count: 2}\nsimulate: {count: 30, goal: [3, 19]}\n"
    assert_problems(list(set(problems(crowd, tmp_path))), [(":3: simulate.goal", "30", "1.7 m", "10 m")])
