"""What is wrong with a time bound, said with file, line and cure before anything starts."""

from __future__ import annotations

from pathlib import Path

import pytest

from swarmctl.config.checks import check_config
from swarmctl.config.model import ConfigError, load

AREA = "area: {origin_lat_deg: 46.0, origin_lon_deg: 14.4, rows: 8, cols: 8, cell_size_m: 50}\n"
THREATS = "threats: {count: 5}\n"
REAL = (
    "vehicles:\n"
    '  - {name: alpha, url: "udpin://:14999", sysid: 1, goal: [3, 7],\n'
    "     start: {lat_deg: 46.00157, lon_deg: 14.3994}, REST}\n"
)


def troubles(tmp_path: Path, planner: str, vehicles: str) -> list[str]:
    """What is said about this planner with these vehicles, without the file's name."""
    file = tmp_path / "swarm.yaml"
    file.write_text(f"{AREA}{THREATS}planner: {planner}\n{vehicles}")
    try:
        load(file, check_config)
    except ConfigError as error:
        return [line.removeprefix(f"{file}:") for line in error.lines]
    return []


def simulate(rest: str) -> str:
    return f"simulate: {{count: 2, {rest}}}\n"


# The first climbs 40 m in 16 s, flies 85 m to the centre of its entry cell and 350 m across: 59.5 s. Lifting
# off, speeding up twice and stopping at the entry cost 6.4 s more. The other climbs 2 s longer.
ROWS = [
    ("a bound that is kept", "{name: time_bound}", simulate("arrive_within_s: 68"), []),
    ("a window that is kept", "{name: time_bound}", simulate("arrive_within_s: 90, arrive_after_s: 20"), []),
    (
        "a bound that one of two cannot meet",
        "{name: time_bound}",
        simulate("arrive_within_s: 66"),
        ["4: simulate.arrive_within_s: 66 is too soon for uav2: the fastest route found takes "
         "67.9 s (18.0 s to climb, 8.5 s to the area, 35.0 s through it and 6.4 s for speeding up and "
         "turns); allow more"],
    ),
    (
        "the same with constrained",
        "{name: constrained}",
        simulate("arrive_within_s: 66"),
        ["4: simulate.arrive_within_s: 66 is too soon for uav2: the fastest route found takes "
         "67.9 s (18.0 s to climb, 8.5 s to the area, 35.0 s through it and 6.4 s for speeding up and "
         "turns); allow more"],
    ),
    (
        "a planner that ignores it",
        "{name: dijkstra}",
        simulate("arrive_within_s: 90"),
        ["4: simulate.arrive_within_s: planner dijkstra does not keep it; give planner.name: time_bound or "
         "constrained"],
    ),
    (
        "another that does",
        "{name: survival}",
        simulate("arrive_within_s: 90, arrive_after_s: 20"),
        ["4: simulate.arrive_after_s: planner survival does not keep it; give planner.name: time_bound",
         "4: simulate.arrive_within_s: planner survival does not keep it; give planner.name: time_bound or "
         "constrained"],
    ),
    (
        "a planner that keeps the late end only",
        "{name: constrained}",
        simulate("arrive_within_s: 90, arrive_after_s: 20"),
        ["4: simulate.arrive_after_s: planner constrained does not keep it; give planner.name: time_bound"],
    ),
    (
        "a window that ends before it begins",
        "{name: time_bound}",
        simulate("arrive_within_s: 70, arrive_after_s: 80"),
        ["4: simulate.arrive_after_s: 80 is later than arrive_within_s = 70; a window ends after it begins"],
    ),
    (
        "a window that no route is long enough for",
        "{name: time_bound}",
        simulate("arrive_within_s: 620, arrive_after_s: 600"),
        ["4: simulate.arrive_after_s: no route that time_bound finds takes uav1 600 to 620 s from its ",
         "4: simulate.arrive_after_s: no route that time_bound finds takes uav2 600 to 620 s from its "],
    ),
    (
        "a vehicle without a speed",
        "{name: time_bound}",
        REAL.replace("REST", "arrive_within_s: 90"),
        ["5: vehicles[0].speed_m_s: is missing: say what it flies over ground [m/s], or its time bound means "
         "no length"],
    ),
    ("one with it", "{name: time_bound}", REAL.replace("REST", "arrive_within_s: 90, speed_m_s: 8"), []),
    (
        "one that flies too slowly",
        "{name: time_bound}",
        REAL.replace("REST", "arrive_within_s: 90, speed_m_s: 5"),
        ["6: vehicles[0].arrive_within_s: 90 is too soon for alpha: the fastest route found takes "],
    ),
    (
        "a w that its planner does not go by",
        "{name: survival, w: 0.1, psi_per_cell: 3}",
        simulate("delay_step_s: 0"),
        ["3: planner.w: planner survival does not go by w; leave it away, or give planner.name: dijkstra"],
    ),
    (
        "a count of exposure for tracks that are not pulled",
        "{name: dijkstra, w: 0.1}",
        "flight: {any_angle_exposure: entered}\n" + simulate("delay_step_s: 0"),
        ["4: flight.any_angle_exposure: does nothing without flight.any_angle: true"],
    ),
    (
        "one for tracks that are",
        "{name: dijkstra, w: 0.1}",
        "flight: {any_angle: true, any_angle_exposure: entered}\n" + simulate("delay_step_s: 0"),
        [],
    ),
    (
        "a wrong option of a planner that would keep it",
        "{name: time_bound, options: {minimise: speed}}",
        simulate("arrive_within_s: 90, arrive_after_s: 20"),
        ["3: planner.options: options of planner time_bound: invalid enum value 'speed'"],
    ),
    (
        "a wrong name, which says nothing of what it would keep",
        "{name: time_bond}",
        simulate("arrive_within_s: 90"),
        ["3: planner.name: no planner of this name"],
    ),
    (
        "no time at all",
        "{name: time_bound}",
        simulate("arrive_within_s: 0"),
        ["4: simulate.arrive_within_s: input should be greater than 0"],
    ),
]  # fmt: skip


@pytest.mark.parametrize(("planner", "vehicles", "said"), [r[1:] for r in ROWS], ids=[r[0] for r in ROWS])
def test_what_is_wrong_with_a_time_bound(
    planner: str, vehicles: str, said: list[str], tmp_path: Path
) -> None:
    found = troubles(tmp_path, planner, vehicles)
    assert len(found) == len(said)
    for line, expected in zip(found, said, strict=True):
        assert line.startswith(expected)
