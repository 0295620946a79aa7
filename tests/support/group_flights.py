"""Flights of groups in formation on the virtual clock."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flights import AREA, small

from swarmctl.agent.phases import Phase
from swarmctl.agent.state import AgentState
from swarmctl.config.scenario import Scenario
from swarmctl.report import record

ROWS, COLS = 7, 14
TOLD_S = 3.0
"""time until all members know that the last one has joined [s]"""


def group(approach: str = "leader_following", count: int = 3, **changes: Any) -> Scenario:
    """Return copters that cross an area without hostiles from west to east as a wedge, at 10 m/s."""
    section = {
        "name": "alpha",
        "members": [f"uav{n}" for n in range(1, count + 1)],
        "approach": approach,
        "shape": {"kind": "wedge", "spacing_m": 30.0},
        "speed_m_s": 10.0,
    }
    sections = {
        "area": {**AREA, "rows": ROWS, "cols": COLS},
        "threats": {"count": 0},
        "communication": {"bus": "memory", "delay_s": 0.1},
        "simulate": {
            "count": count,
            "ready_s": 3.0,
            "speed_m_s": 14.0,
            "start_spacing_m": 20.0,
            "start_distance_m": 30.0,
            "goal": [ROWS // 2, COLS - 1],
        },
    }
    for name, change in changes.items():
        if name == "formation":
            section |= change
        else:
            sections[name] = {**sections.get(name, {}), **change} if isinstance(change, dict) else change
    return small(formations=[section], **sections)


def turn_cells() -> tuple[int, list[list[int]], list[int]]:
    """Return the size, no-fly cells and goal of a square area that is crossed with one turn of 90 degrees."""
    size, row, col = 13, 3, 9
    free = {(row, c) for c in range(col)} | {(r, col) for r in range(row, size)}
    no_fly = [[r, c] for r in range(size) for c in range(2, size) if (r, c) not in free]
    return size, no_fly, [size - 1, col]


@dataclass(frozen=True, slots=True)
class Seen:
    """One telemetry message of a member that flies to its place."""

    boot_s: float
    along_m: float
    across_m: float
    up_m: float
    speed_m_s: float
    leader: int
    shape: int

    @property
    def error_m(self) -> float:
        return math.hypot(self.along_m, self.across_m)


def seen(folder: Path, scenario: Scenario) -> Mapping[int, list[Seen]]:
    """Return what each member saw at its telemetry messages in formation, by the record of the run."""
    rows: dict[int, list[Seen]] = {task.uav: [] for task in scenario.tasks}

    def note(_before: AgentState, event: object, after: AgentState, _effects: object, _row: object) -> None:
        membership = after.membership
        error_m = membership.error_m
        if type(event).__name__ != "TelemetryReceived" or after.phase is not Phase.FORMATION or not error_m:
            return
        assert membership.leader is not None
        rows[after.task.uav].append(
            Seen(
                after.vehicle.time_boot_s,
                *error_m,
                after.vehicle.ground_speed_m_s,
                membership.leader,
                membership.shape,
            )
        )

    replayed = record.fold(record.read(record.record_path(folder)), scenario, note)
    assert not replayed.difference
    return rows


def settled(rows: list[Seen], since_s: float) -> list[Seen]:
    """Return the messages from the member's first arrival at its place on, after a time of its clock."""
    first = next(i for i, row in enumerate(rows) if row.boot_s > since_s and row.error_m < 3.0)
    return rows[first:]


def in_place(folder: Path, scenario: Scenario) -> Mapping[int, list[Seen]]:
    """Return what each member that flew by set-points saw at its place, after all had joined."""
    rows = {uav: found for uav, found in seen(folder, scenario).items() if found}
    all_joined_s = max(found[0].boot_s for found in rows.values()) + TOLD_S
    return {uav: settled(found, all_joined_s) for uav, found in rows.items()}


def rms(values: list[float]) -> float:
    return math.sqrt(sum(value * value for value in values) / len(values))
