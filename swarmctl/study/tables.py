"""The results of some seeds at one level, as columns. Pure."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from operator import attrgetter
from typing import Any, Generic, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from swarmctl.core.grid import Cell
from swarmctl.study.world import World

R = TypeVar("R")
Columns = Mapping[str, NDArray[Any]]
"""arrays of one length, by the names of the columns"""
Types = Mapping[str, type[np.generic]]
_TYPES = {bool: np.bool_, float: np.float64, int: np.int32}
_KEY_TYPES: Types = {"seed": np.int64, "uav": np.int16}
KEY_COLUMNS = ("level", *_KEY_TYPES)
"""columns of the results that name a row"""


class SeedResult(msgspec.Struct, Generic[R], frozen=True):
    """The results of one seed, one item for each vehicle."""

    rows: tuple[R, ...]
    """`uav` and the measures"""
    tracks: tuple[tuple[Cell, ...], ...] = ()
    """the cells entered, in order; empty: the kind has no tracks"""
    strikes: tuple[tuple[int, ...], ...] = ()
    """the number of strikes at each entry; empty: not known for each entry"""


class Table(msgspec.Struct, frozen=True):
    """The results of some seeds at one level, as columns of equal length: one row a seed and vehicle."""

    rows: Columns
    """`seed`, `uav` and the measures"""
    tracks: Columns = msgspec.field(default_factory=dict)
    """`seed`, `uav`, `step`, `row`, `col` of the entered cells, for the seeds whose tracks are kept; missions
    have the `strikes` of each step besides"""
    hostiles: Columns = msgspec.field(default_factory=dict)
    """`seed`, `row`, `col` of the true hostiles, for the seeds whose tracks are kept"""


def names_of(row: type[Any]) -> tuple[str, ...]:
    """Return the columns of a type of rows."""
    return tuple(row.__struct_fields__)


def table_of(
    results: Iterable[tuple[World, SeedResult[Any]]], row: type[Any], kept: Collection[int]
) -> Table:
    """Return the results of seeds, whose rows have the type `row`; keep the tracks of the seeds in `kept`.

    The vehicles of a seed are sorted by system id.
    """
    names, types = names_of(row), {field.name: _TYPES[field.type] for field in msgspec.structs.fields(row)}
    values = attrgetter(*names)
    rows: list[tuple[Any, ...]] = []
    tracks: list[tuple[int, ...]] = []
    hostiles: list[tuple[int, ...]] = []
    for world, result in results:
        rows += sorted((world.seed, *values(vehicle)) for vehicle in result.rows)
        if world.seed in kept and result.tracks:
            tracks += sorted((world.seed, *step) for step in _steps(result))
            hostiles += [(world.seed, *cell) for cell in sorted(world.hostiles)]
    return Table(
        _columns(("seed", *names), rows, types),
        _columns(("seed", "uav", "step", "row", "col", "strikes"), tracks),
        _columns(("seed", "row", "col"), hostiles),
    )


def _steps(result: SeedResult[Any]) -> Iterator[tuple[int, ...]]:
    """Yield vehicle, step, row and column of each entry, and its strikes if they are known."""
    for i, cells in enumerate(result.tracks):
        hits = [(n,) for n in result.strikes[i]] if result.strikes else [()] * len(cells)
        for step, (cell, hit) in enumerate(zip(cells, hits, strict=True)):
            yield (result.rows[i].uav, step, *cell, *hit)


def _columns(names: Sequence[str], rows: Sequence[Sequence[Any]], types: Types | None = None) -> Columns:
    """Return rows as columns, which may be fewer than `names`; a column without a type holds int32."""
    all_types = {**(types or {}), **_KEY_TYPES}
    columns = zip(names, zip(*rows, strict=True), strict=False)
    return {name: np.array(values, dtype=all_types.get(name, np.int32)) for name, values in columns}
