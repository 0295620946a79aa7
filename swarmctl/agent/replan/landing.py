"""The two landings of a fixed wing: at its goal and at home. Pure.

New observations do not change the approaches, so preflight can check the approaches of all vehicles.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from swarmctl.agent.replan.landing_pattern import (
    FixedWing,
    LandingPattern,
    NoApproach,
    Pose,
    choose_pattern,
    planned_approach,
)
from swarmctl.agent.state import Task
from swarmctl.core.any_angle.track import ThreatMap, crossed_cells, is_clear
from swarmctl.core.geo import LatLon
from swarmctl.core.grid import Cell, Grid
from swarmctl.core.mission import Approach
from swarmctl.core.planar import PlanarPoint
from swarmctl.planners.base import Unreachable


def goal_approach(task: Task, goal: Cell) -> Approach | None:
    """Return the landing at a goal; None for a copter. Raises Unreachable if there is no room to land."""
    pattern = goal_pattern(task, goal)
    return None if pattern is None else _as_planned(task, pattern)


def home_approach(task: Task) -> Approach | None:
    """Return the landing at home, for a return; None for a copter. Raises Unreachable as `goal_approach`."""
    pattern = home_pattern(task)
    return None if pattern is None else _as_planned(task, pattern)


def goal_pattern(task: Task, goal: Cell) -> LandingPattern | None:
    if task.wings is None:
        return None
    spot = task.landing_spot(goal)
    home, there = task.grid.frame.to_local(*task.wings.home), task.grid.centre_m(goal)
    return _pattern(
        "at its goal", task, spot, Pose(there, _heading_rad(home, there)), with_path_to_circle=True
    )


def home_pattern(task: Task) -> LandingPattern | None:
    if task.wings is None:
        return None
    home = task.grid.frame.to_local(*task.wings.home)
    from_pose = Pose(home, _heading_rad(home, task.grid.centre_m(task.entry)))
    return _pattern("at home", task, task.wings.home, from_pose, with_path_to_circle=False)


def _pattern(
    where: str, task: Task, touchdown: LatLon, from_pose: Pose, *, with_path_to_circle: bool
) -> LandingPattern:
    assert task.wings is not None
    corners_m = () if task.fence is None else task.fence.corners_m
    try:
        return _cached_pattern(
            task.wings,
            task.turn_radius_m,
            task.grid,
            task.no_fly,
            corners_m,
            touchdown,
            from_pose,
            with_path_to_circle,
        )
    except NoApproach as error:
        raise Unreachable(f"no room to land {where}: {error}") from error


@lru_cache(maxsize=1024)
def _cached_pattern(
    wings: FixedWing,
    turn_radius_m: float,
    grid: Grid,
    no_fly: frozenset[Cell],
    fence: tuple[PlanarPoint, ...],
    touchdown: LatLon,
    from_pose: Pose,
    with_path_to_circle: bool,
) -> LandingPattern:
    p_s = np.ones((grid.rows, grid.cols))  # selects the pattern over the fewest cells of the area
    for cell in no_fly:
        p_s[cell] = math.inf
    threat = ThreatMap.of(p_s)
    return choose_pattern(
        grid.frame.to_local(*touchdown),
        wings,
        from_pose=from_pose,
        with_path_to_circle=with_path_to_circle,
        turn_radius_m=turn_radius_m,
        fence=fence,
        exposure_under=lambda path: _exposure_under(threat, grid, path),
    )


def _as_planned(task: Task, pattern: LandingPattern) -> Approach:
    assert task.wings is not None
    return planned_approach(pattern, task.grid.frame, task.wings.final_height_m)


def _heading_rad(a: PlanarPoint, b: PlanarPoint) -> float:
    return math.atan2(b[0] - a[0], b[1] - a[1])


def _exposure_under(threat: ThreatMap, grid: Grid, path: Sequence[PlanarPoint]) -> float:
    """Return ΣP_s over the cells of the area under a path, each once; infinite if a cell is forbidden."""
    points = [(east / grid.cell_size_m, north / grid.cell_size_m) for east, north in path]
    if threat.blocked.any() and not is_clear(threat, points):
        return math.inf
    cells = {cell for cell in crossed_cells(points).cells if grid.contains(cell)}
    return math.fsum(float(threat.p_s[cell]) for cell in sorted(cells))
