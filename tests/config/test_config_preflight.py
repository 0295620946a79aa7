"""The section `preflight`: a fence that no vehicle could keep is refused before anything starts."""

from __future__ import annotations

from pathlib import Path

import pytest
from config_files import GOOD, assert_problems, problems

SQUARE = [(45.99, 13.98), (45.99, 14.02), (46.02, 14.02), (46.02, 13.98)]


def fence(corners: list[tuple[float, float]]) -> str:
    polygon = ", ".join(f"{{lat_deg: {lat}, lon_deg: {lon}}}" for lat, lon in corners)
    return f"{GOOD}preflight: {{fence: {{polygon: [{polygon}]}}}}\n"


@pytest.mark.parametrize("corners", [SQUARE, SQUARE[::-1], [*SQUARE, (46.005, 14.0)]])
def test_a_polygon_without_crossing_sides_is_accepted(
    corners: list[tuple[float, float]], tmp_path: Path
) -> None:
    assert problems(fence(corners), tmp_path) == []


@pytest.mark.parametrize(
    ("corners", "sides"),
    [
        ([SQUARE[0], SQUARE[2], SQUARE[1], SQUARE[3]], (0, 2)),
        ([*SQUARE, (45.98, 14.0)], (0, 3)),
        ([SQUARE[0], SQUARE[1], SQUARE[1], SQUARE[2]], (0, 1)),
        ([SQUARE[0], SQUARE[1], (45.99, 14.0), SQUARE[3]], (0, 1)),
        ([(46.0, 13.98), (46.0, 14.0), (46.0, 14.02)], (0, 2)),
        ([SQUARE[0], SQUARE[1], SQUARE[2], (45.99, 14.0), SQUARE[3]], (0, 2)),
    ],
    ids=[
        "a bow tie",
        "a corner beyond the opposite side",
        "a corner twice",
        "back along a side",
        "on one line",
        "a corner on another side",
    ],
)
def test_a_polygon_with_crossing_sides_is_refused_with_the_sides(
    corners: list[tuple[float, float]], sides: tuple[int, int], tmp_path: Path
) -> None:
    """ArduPilot accepts such a polygon; its inside is undefined."""
    first, second = sides
    place = f":11: preflight.fence.polygon[{second}]"
    assert_problems(problems(fence(corners), tmp_path), [(place, f"[{first}]", f"[{second}]")])


@pytest.mark.parametrize(("speedup", "least_s", "is_possible"), [(20, 60, True), (50, 150, False)])
def test_a_lost_link_shorter_than_three_heartbeats_is_refused(
    speedup: int, least_s: int, is_possible: bool, tmp_path: Path
) -> None:
    simulated = f"simulate: {{count: 1, goal: [0, 9], speedup: {speedup}}}\n"
    policy = "preflight: {policy: {lost_link: return, lost_link_after_s: 10}}\n"
    configuration = GOOD.partition("vehicles:")[0] + simulated + policy
    (found,) = problems(configuration, tmp_path)
    assert found.startswith(":9: preflight.policy.lost_link_after_s: ")
    assert (str(least_s) in found) is is_possible
    longer = configuration.replace("lost_link_after_s: 10", f"lost_link_after_s: {least_s}")
    assert (problems(longer, tmp_path) == []) is is_possible
