"""The kind `missions`: the missions of one level, as columns.

`fly_missions` decides how a mission is flown: by the compiled loop where that covers the scenario, else by
`mission.fly_mission`. Both give equal results.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmctl.config.scenario import Scenario
from swarmctl.study.compiled_mission import CompiledMission, covers
from swarmctl.study.mission import fly_mission, unsupported
from swarmctl.study.vehicle_result import MissionResult, VehicleResult
from swarmctl.study.world import World

Columns = Mapping[str, NDArray[Any]]
"""arrays of one length, by the names of the columns"""
NAMES = tuple(field.name for field in fields(VehicleResult))


@dataclass(frozen=True, slots=True)
class Table:
    """The results of some seeds at one level, as columns of equal length: one row a seed and vehicle."""

    rows: Columns
    """`seed`, `uav` and the measures"""
    tracks: Columns = field(default_factory=dict)
    """`seed`, `uav`, `step`, `row`, `col` of the flown cells, for the seeds whose tracks are kept; missions
    have the `strikes` of each step besides"""
    hostiles: Columns = field(default_factory=dict)
    """`seed`, `row`, `col` of the true hostiles, for the seeds whose tracks are kept"""


def flyer_of(scenario: Scenario) -> Callable[[World], MissionResult]:
    """Return the function that flies a mission of this scenario. Raises ValueError if none can."""
    if (why := unsupported(scenario)) is not None:
        raise ValueError(why)
    if covers(scenario):
        return CompiledMission(scenario).fly
    return lambda world: fly_mission(scenario, world)


def fly_missions(scenario: Scenario, seeds: Sequence[int], kept: Collection[int] = ()) -> Table:
    """Fly one mission for each seed; keep the tracks of the seeds in `kept`.

    Raises ValueError for a scenario of which the abstract mission has no model.
    """
    fly = flyer_of(scenario)
    rows: list[tuple[Any, ...]] = []
    tracks: list[tuple[int, ...]] = []
    hostiles: list[tuple[int, ...]] = []
    for seed in seeds:
        world = World.drawn(scenario, seed)
        result = fly(world)
        rows += [(seed, *(getattr(row, name) for name in NAMES)) for row in result.rows]
        if seed in kept:
            hostiles += [(seed, *cell) for cell in sorted(world.hostiles)]
            for row, cells, strikes in zip(result.rows, result.tracks, result.strikes, strict=True):
                entries = enumerate(zip(cells, strikes, strict=True))
                tracks += [(seed, row.uav, step, *cell, hits) for step, (cell, hits) in entries]
    return Table(
        as_columns(("seed", *NAMES), rows, types_of(VehicleResult)),
        as_columns(("seed", "uav", "step", "row", "col", "strikes"), tracks),
        as_columns(("seed", "row", "col"), hostiles),
    )


Types = Mapping[str, type[np.generic]]
_TYPES: Types = {"bool": np.bool_, "float": np.float64, "int": np.int32}
_KEY_TYPES: Types = {"seed": np.int64, "uav": np.int16}


def types_of(result: type) -> Types:
    """Return the types of the columns of a dataclass of results, by the names of its fields."""
    return {field.name: _TYPES[str(field.type)] for field in fields(result)}


def as_columns(
    names: Sequence[str], rows: Sequence[Sequence[Any]], types: Types = MappingProxyType({})
) -> Columns:
    """Return rows as columns; a column besides `seed` and `uav` that has no type holds int32."""
    values = zip(*rows, strict=True) if rows else [()] * len(names)
    all_types = {**types, **_KEY_TYPES}
    return {
        name: np.array(column, dtype=all_types.get(name, np.int32))
        for name, column in zip(names, values, strict=True)
    }
