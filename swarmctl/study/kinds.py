"""The kinds of an experiment: what is computed for a level and some seeds.

A kind is one function and one line in `KINDS`. Its rows do not depend on the other seeds of a call, so
results are the same whatever the batches are.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable, Mapping
from functools import partial
from typing import Any

import msgspec

from swarmctl.config.model import Config
from swarmctl.config.scenario import Scenario, build
from swarmctl.core.section import Section
from swarmctl.study import flights, mission, routes
from swarmctl.study.compiled_mission import flyer_of
from swarmctl.study.provenance import versions
from swarmctl.study.tables import SeedResult, Table, names_of, table_of
from swarmctl.study.vehicle_result import VehicleResult
from swarmctl.study.world import World


class Kind(msgspec.Struct, frozen=True):
    """Something that an experiment computes."""

    row: type[Any]
    """`msgspec.Struct` of a row: the field `uav`, then the measures"""
    computer: Callable[[Scenario, Any], Callable[[World], SeedResult[Any]]]
    """returns the function that computes one world, by scenario and settings of a level"""
    unsupported: Callable[[Scenario], str | None] = lambda _: None
    """why the kind has no model of a scenario; None if it has one"""
    settings: type[Section] | None = None
    """schema of the section `search` of an experiment file; None: the kind has no settings"""

    @property
    def measures(self) -> tuple[str, ...]:
        """Columns of the rows besides `seed` and `uav`, in order."""
        return names_of(self.row)[1:]

    def table(
        self, scenario: Scenario, seeds: Iterable[int], kept: Collection[int] = (), settings: Any = None
    ) -> Table:
        """Return the results of `seeds` at one level; keep the tracks of the seeds in `kept`."""
        compute_world = self.computer(scenario, settings)
        worlds = (World.drawn(scenario, seed) for seed in seeds)
        return table_of(((world, compute_world(world)) for world in worlds), self.row, kept)


KINDS: Mapping[str, Kind] = {
    "missions": Kind(VehicleResult, lambda scenario, _: flyer_of(scenario), mission.unsupported),
    "flights": Kind(
        flights.FlownVehicle, lambda scenario, _: partial(flights.flown, scenario), flights.unsupported
    ),
    "routes": Kind(
        routes.RouteResult,
        lambda scenario, search: partial(routes.searched, scenario, search),
        routes.unsupported,
        routes.Search,
    ),
}


def compute(
    kind: str, config: Config, settings: Section | None, seeds: range, kept: Collection[int]
) -> tuple[Table, float, dict[str, str]]:
    """Return the results of `seeds` at one level, the duration [s], and the versions of this process.

    The rows are sorted by seed and UAV.
    """
    began_s = time.perf_counter()
    table = KINDS[kind].table(build(config), seeds, kept, settings)
    return table, time.perf_counter() - began_s, versions()
