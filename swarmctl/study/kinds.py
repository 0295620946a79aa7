"""The kinds of an experiment: what is computed for a level and some seeds.

A kind is one function and one line in `KINDS`. Its rows do not depend on the other seeds of a call, so
results are the same whatever the batches are.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from swarmctl.config.model import Config
from swarmctl.config.scenario import Scenario, build
from swarmctl.core.section import Section
from swarmctl.study import flights, routes
from swarmctl.study.mission import unsupported
from swarmctl.study.missions import NAMES, Table, fly_missions
from swarmctl.study.provenance import versions

MISSION_MEASURES = tuple(name for name in NAMES if name != "uav")
FLIGHT_MEASURES = tuple(name for name in flights.NAMES if name != "uav")


@dataclass(frozen=True, slots=True)
class Kind:
    """Something that an experiment computes."""

    compute: Callable[[Scenario, Sequence[int], Collection[int], Any], Table]
    """arguments: scenario, seeds, the seeds whose tracks are kept, settings"""
    measures: tuple[str, ...]
    """columns of the rows besides `seed` and `uav`, in order"""
    unsupported: Callable[[Scenario], str | None] = lambda _: None
    """why the kind has no model of a scenario; None if it has one"""
    settings: type[Section] | None = None
    """schema of the section `search` of an experiment file; None: the kind has no settings"""


KINDS: Mapping[str, Kind] = {
    "missions": Kind(
        lambda scenario, seeds, kept, _: fly_missions(scenario, seeds, kept), MISSION_MEASURES, unsupported
    ),
    "flights": Kind(
        lambda scenario, seeds, kept, _: flights.fly_flights(scenario, seeds, kept),
        FLIGHT_MEASURES,
        flights.unsupported,
    ),
    "routes": Kind(
        lambda scenario, seeds, _, search: Table(routes.rows(scenario, seeds, search)),
        routes.MEASURES,
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
    table = KINDS[kind].compute(build(config), seeds, [seed for seed in seeds if seed in kept], settings)
    order = np.lexsort((table.rows["uav"], table.rows["seed"]))
    rows = {name: table.rows[name][order] for name in ("seed", "uav", *KINDS[kind].measures)}
    return Table(rows, table.tracks, table.hostiles), time.perf_counter() - began_s, versions()
