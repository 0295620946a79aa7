"""Errors of time bounds and common arrivals are reported at their keys, before anything starts."""

from __future__ import annotations

from pathlib import Path

import pytest
from config_files import SMALL_AREA, assert_problems, problems

REAL = (
    "vehicles:\n"
    '  - {name: alpha, url: "udpin://:14999", sysid: 1, goal: [3, 7],\n'
    "     start: {lat_deg: 46.00157, lon_deg: 14.3994}, REST}\n"
)


TOGETHER = "arrival: {mode: simultaneous}\n"


def simulate(rest: str) -> str:
    return f"simulate: {{count: 2, {rest}}}\n"


# The first climbs 40 m in 18.5 s, flies 85 m to the centre of its entry cell and 350 m across: 62 s. Lifting
# off, speeding up twice and stopping at the entry cost 12.2 s more. The other climbs 2 s longer.
ROWS: list[tuple[str, str, str, list[tuple[str, ...]]]] = [
    ("a bound that is kept", "{name: time_bound}", simulate("arrive_within_s: 77"), []),
    ("a window that is kept", "{name: time_bound}", simulate("arrive_within_s: 90, arrive_after_s: 20"), []),
    (
        "a bound that one of two cannot meet",
        "{name: time_bound}",
        simulate("arrive_within_s: 75"),
        [("4: simulate.arrive_within_s", "75 s", "uav2", "76.2 s", "20.5 s", "8.5 s", "35.0 s", "12.2 s")],
    ),
    (
        "the same with constrained",
        "{name: constrained}",
        simulate("arrive_within_s: 75"),
        [("4: simulate.arrive_within_s", "75 s", "uav2", "76.2 s", "20.5 s", "8.5 s", "35.0 s", "12.2 s")],
    ),
    (
        "a planner that ignores it",
        "{name: dijkstra}",
        simulate("arrive_within_s: 90"),
        [("4: simulate.arrive_within_s", "dijkstra", "planner.name: time_bound or constrained")],
    ),
    (
        "another planner that ignores it",
        "{name: survival}",
        simulate("arrive_within_s: 90, arrive_after_s: 20"),
        [
            ("4: simulate.arrive_after_s", "survival", "planner.name: time_bound"),
            ("4: simulate.arrive_within_s", "survival", "planner.name: time_bound or constrained"),
        ],
    ),
    (
        "a planner that keeps the late end only",
        "{name: constrained}",
        simulate("arrive_within_s: 90, arrive_after_s: 20"),
        [("4: simulate.arrive_after_s", "constrained", "planner.name: time_bound")],
    ),
    (
        "a window that ends before it begins",
        "{name: time_bound}",
        simulate("arrive_within_s: 70, arrive_after_s: 80"),
        [("4: simulate.arrive_after_s", "80", "arrive_within_s = 70")],
    ),
    (
        "a window longer than every route",
        "{name: time_bound}",
        simulate("arrive_within_s: 620, arrive_after_s: 600"),
        [
            ("4: simulate.arrive_after_s", "time_bound", "uav1", "600", "620 s"),
            ("4: simulate.arrive_after_s", "time_bound", "uav2", "600", "620 s"),
        ],
    ),
    (
        "a vehicle without a speed",
        "{name: time_bound}",
        REAL.replace("REST", "arrive_within_s: 90"),
        [("5: vehicles[0].speed_m_s", "[m/s]")],
    ),
    ("one with it", "{name: time_bound}", REAL.replace("REST", "arrive_within_s: 90, speed_m_s: 8"), []),
    (
        "one that flies too slowly",
        "{name: time_bound}",
        REAL.replace("REST", "arrive_within_s: 90, speed_m_s: 5"),
        [("6: vehicles[0].arrive_within_s", "90 s", "alpha")],
    ),
    (
        "a time bound beside a common arrival",
        "{name: time_bound}",
        TOGETHER + simulate("arrive_within_s: 500"),
        [("5: simulate.arrive_within_s",)],
    ),
    (
        "a common arrival of a vehicle without a speed",
        "{name: dijkstra}",
        TOGETHER + REAL.replace("REST", "altitude_m: 20"),
        [("6: vehicles[0].speed_m_s",)],
    ),
    ("the same with a speed", "{name: dijkstra}", TOGETHER + REAL.replace("REST", "speed_m_s: 8"), []),
    (
        "staggered arrivals without a spacing",
        "{name: dijkstra}",
        "arrival: {mode: staggered}\n" + simulate("delay_step_s: 0"),
        [("4: arrival", "spacing_s")],
    ),
    (
        "a spacing of simultaneous arrivals",
        "{name: dijkstra}",
        "arrival: {mode: simultaneous, spacing_s: 5}\n" + simulate("delay_step_s: 0"),
        [("4: arrival", "spacing_s")],
    ),
    (
        "a w that its planner does not use",
        "{name: survival, w: 0.1, psi_per_cell: 3}",
        simulate("delay_step_s: 0"),
        [("3: planner.w", "survival", "planner.name: dijkstra")],
    ),
    (
        "an exposure measure without straightened tracks",
        "{name: dijkstra, w: 0.1}",
        "flight: {any_angle_exposure: entered}\n" + simulate("delay_step_s: 0"),
        [("4: flight.any_angle_exposure", "flight.any_angle: true")],
    ),
    (
        "an exposure measure with straightened tracks",
        "{name: dijkstra, w: 0.1}",
        "flight: {any_angle: true, any_angle_exposure: entered}\n" + simulate("delay_step_s: 0"),
        [],
    ),
    (
        "a wrong option of a planner that would keep it",
        "{name: time_bound, options: {minimise: speed}}",
        simulate("arrive_within_s: 90, arrive_after_s: 20"),
        [("3: planner.options", "time_bound", "'speed'")],
    ),
    (
        "an unknown planner, of which no other problem follows",
        "{name: time_bond}",
        simulate("arrive_within_s: 90"),
        [("3: planner.name", "time_bound")],
    ),
    (
        "a bound of no time",
        "{name: time_bound}",
        simulate("arrive_within_s: 0"),
        [("4: simulate.arrive_within_s", "0")],
    ),
]


@pytest.mark.parametrize(("planner", "vehicles", "expected"), [r[1:] for r in ROWS], ids=[r[0] for r in ROWS])
def test_an_error_of_an_arrival_is_reported_at_its_key(
    planner: str, vehicles: str, expected: list[tuple[str, ...]], tmp_path: Path
) -> None:
    found = problems(f"{SMALL_AREA}planner: {planner}\n{vehicles}", tmp_path)
    assert_problems([line.removeprefix(":") for line in found], expected)
