"""Measures and factors in words, and how each measure is estimated."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from swarmctl.study import statistics
from swarmctl.study.statistics import Estimates, Floats, Sums

_LABELS = {
    "arrived": "share that arrived",
    "length_cells": "length [cells]",
    "length_m": "length [m]",
    "exposure_sum": "exposure ΣP_s",
    "believed_exposure_sum": "believed ΣP_s, first route",
    "safety_factor": "safety factor ∏(1−P_s)",
    "believed_safety_factor": "believed ∏(1−P_s), first route",
    "believed_survival": "believed chance of survival",
    "true_survival": "chance of survival",
    "strikes": "strikes a vehicle",
    "mission_strikes": "strikes a mission",
    "strikes_per_km": "strikes a kilometre",
    "survived": "share without a strike",
    "searches": "searches",
    "within_bound": "share of routes within the bound",
    "is_safest": "share of routes that are the safest",
    "is_best_w": "share of routes that no w improves",
    "is_exact": "share of routes that are the exact best",
    "exposure_above_exact": "ΣP_s lost, of the shortest route's",
    "replans": "changes of route",
    "penalty": "communication penalty",
    "flight_time_s": "flight time [s]",
    "arrival_s": "arrival after first start [s]",
    "cells_known": "cells known at the end",
    "hostiles_known": "hostiles known at the end",
    "cells_own": "cells first seen by the vehicle",
    "cells_sensed": "cells seen by all together",
    "swath_m": "swath seen by all together [m]",
    "rms_along_m": "RMS error along [m]",
    "rms_across_m": "RMS error across [m]",
    "in_place_s": "time in place [s]",
}
_FACTORS = {
    "planner.w": ("w", "distance anxiety w"),
    "simulate.count": ("N", "number of vehicles N"),
    "simulate.delay_step_s": ("every", "time between starts [s]"),
    "communication.range": ("k", "communication range k [vehicles]"),
    "communication.loss": ("loss", "share of lost messages"),
    "communication.delay_s": ("delay", "delay of messages [s]"),
    "communication.relay": ("relaying", "relaying"),
    "communication.min_distance_m": ("beyond", "minimum distance [m]"),
    "communication.max_distance_m": ("within", "maximum distance [m]"),
    "planner.name": ("planner", "planner"),
    "search.observed": ("shown", "share of cells shown"),
    "search.longer": ("bound +", "length bound, above the shortest route"),
    "search.searches": ("budget", "budget of searches"),
    "threats.count": ("hostiles", "announced number of hostiles"),
}
_SHARES = {
    "arrived", "survived", "within_bound", "is_safest", "is_best_w", "is_exact", "exposure_above_exact",
    "communication.loss", "search.observed", "search.longer",
}  # fmt: skip
"""measures and factors in per cent"""
_ONE = {
    "messages_sent": "message", "length_m": "metre", "length_cells": "cell", "flight_time_s": "second",
    "searches": "search",
}  # fmt: skip
_UNITS = {
    "_m_s": "m/s", "_bytes_s": "bytes/s", "_per_m": "1/m", "_m": "m", "_s": "s",
    "_cells": "cells", "_deg": "deg",
}  # fmt: skip
DERIVED = {"mission_strikes": {"strikes"}, "strikes_per_km": {"strikes", "length_m"}}
"""measures that are computed from columns, with these columns"""


def label(name: str) -> str:
    """Return the words of a measure for an axis or a heading, with its unit."""
    return _LABELS.get(name) or _plain(name)


def one_of(name: str) -> str:
    """Return the words of one unit of a measure."""
    return _ONE.get(name, f"unit of {label(name)}")


def is_share(name: str) -> bool:
    """Return whether a measure or factor is shown in per cent."""
    return name in _SHARES


def factor_label(factor: str) -> str:
    """Return the words of a factor for an axis."""
    return _FACTORS[factor][1] if factor in _FACTORS else _plain(factor.rsplit(".", 1)[-1])


def _plain(name: str) -> str:
    for suffix, unit in _UNITS.items():
        if name.endswith(suffix):
            return f"{name.removesuffix(suffix).replace('_', ' ')} [{unit}]"
    return name.replace("_", " ")


def value_text(value: object) -> str:
    """Return a factor's value as in the experiment file: `0.5`, `all`, `true`."""
    if isinstance(value, bool | np.bool_):
        return "true" if value else "false"
    if isinstance(value, int | float | np.integer | np.floating):
        return f"{value:.6g}"
    return str(value)


def value_label(factor: str, value: object) -> str:
    """Return the label of a value: `w = 0.5`, `loss 10 %`, `no relaying`, or a bare name."""
    short = _FACTORS[factor][0] if factor in _FACTORS else factor.rsplit(".", 1)[-1].replace("_", " ")
    text = value_text(value)
    if isinstance(value, bool | np.bool_):
        return short if value else f"no {short}"
    if isinstance(value, int | float | np.integer | np.floating):
        return f"{short} {100 * value:g} %".replace("+ ", "+") if is_share(factor) else f"{short} = {text}"
    words = value_words(value)
    return f"{short} = {text}" if text == "all" and factor in _FACTORS else words.replace("_", " ")


def value_words(value: object) -> str:
    """Return a factor's value for people: a whole section without its brackets, `dijkstra, w = 0.5`."""
    text = value_text(value)
    if not text.startswith("{"):
        return text
    try:
        section = json.loads(text)
    except ValueError:
        return text
    return ", ".join(
        value_text(value) if key == "name" else f"{key} = {value_text(value)}"
        for key, value in section.items()
    )


def mathtext(text: str) -> str:
    """Return `text` with its formulas for matplotlib: P_s gets a subscript."""
    return text.replace("$", r"\$").replace("P_s", r"$P_\mathrm{s}$")


class Parts(msgspec.Struct, frozen=True, eq=False):
    """A measure as numerator and denominator by group and world, and the type of its values."""

    dtype: np.dtype[Any]
    top: Sums
    below: Floats


def parts(table: pd.DataFrame, name: str, groups: NDArray[np.int64], n_groups: int) -> Parts:
    """Return the sums of a measure; `groups` (rows of the table,) are group indices, negative: left out."""
    seeds = table["seed"].to_numpy()

    def sums(values: ArrayLike) -> Sums:
        return statistics.by_world(values, groups, seeds, n_groups)

    column = table["strikes" if name in DERIVED else name].to_numpy()
    top = sums(column)
    below = top.count
    if name == "mission_strikes":
        vehicles = table.groupby(["level", "seed"], sort=False)["uav"].transform("size").to_numpy()
        below = sums(1.0 / vehicles).total
    elif name == "strikes_per_km":
        below = sums(table["length_m"] / 1000.0).total
    return Parts(column.dtype, top, below)


def estimate(table: pd.DataFrame, name: str, groups: NDArray[np.int64], shape: Sequence[int]) -> Estimates:
    """Return the estimates of a measure by group, as arrays of `shape`; groups are flat indices into it."""
    part = parts(table, name, groups, int(np.prod(shape)))
    return statistics.estimates(part.dtype, part.top.total, part.below).reshape(shape)
