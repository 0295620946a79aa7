"""A valid configuration, and the problems found in a configuration."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from swarmctl.config import model, scenario
from swarmctl.config.checks import check_config

GOOD = """\
name: test
area: {origin_lat_deg: 46.0, origin_lon_deg: 14.0, rows: 20, cols: 20, cell_size_m: 50}
threats:
  count: 24
  firing_strength: {direct: 0.6, first_neighbour: 0.3, second_neighbour: 0.1}
planner: {name: dijkstra, w: 0.5}
communication: {bus: memory, range: all}
vehicles:
  - {name: a, url: "udpin://:14550", sysid: 1, start: {lat_deg: 46.0, lon_deg: 13.99}, goal: [3, 19]}
  - {name: b, url: "udpin://:14550", sysid: 2,start: {lat_deg: 46.001, lon_deg: 13.99}, goal: [[4, 9],[5, 9]]}
"""


SMALL_AREA = """\
area: {origin_lat_deg: 46.0, origin_lon_deg: 14.4, rows: 8, cols: 8, cell_size_m: 50}
threats: {count: 5}
"""
SIMULATED = "simulate: {count: 3}\n"
ALPHA = (
    'vehicles: [{name: alpha, url: "udpin://127.0.0.1:14999", sysid: 2, goal: [3, 7], '
    "start: {lat_deg: 46.00157, lon_deg: 14.3994}}]\n"
)


def problems(text: str, tmp_path: Path) -> list[str]:
    file = tmp_path / "swarm.yaml"
    file.write_text(text)
    try:
        loaded = model.load(file, check_config)
    except model.ConfigError as error:
        return [line.removeprefix(str(file)) for line in error.lines]
    scenario.build(loaded)
    return []


def section_problems(section: str, content: str, vehicles: str, tmp_path: Path) -> list[str]:
    """Return the problems of a section on line 4, without the names of the file and of the section."""
    found = problems(f"{SMALL_AREA}{vehicles}{section}: {{{content}}}\n", tmp_path)
    return [line.removeprefix(f":4: {section}").removeprefix(".") for line in found]


def assert_problems(found: Sequence[str], expected: Sequence[Sequence[str]]) -> None:
    """Check that each line of `found` begins with its place (`:line: key`) and has the expected values."""
    assert len(found) == len(expected), found
    for line, (place, *values) in zip(found, expected, strict=True):
        assert line.startswith(f"{place}: "), line
        for value in values:
            assert value in line.removeprefix(place), (value, line)
