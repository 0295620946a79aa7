"""The small panels of a figure: one for each measure, or for each value of the factor `panels`."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import msgspec
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from swarmctl.study.figures.base import Spec, Study, index_of
from swarmctl.study.figures.measures import label, value_label
from swarmctl.study.figures.style import PANEL_MM, heading, page
from swarmctl.study.statistics import Estimates

Estimator = Callable[[pd.DataFrame, str, NDArray[np.int64], Sequence[int]], Estimates]


class Panel(msgspec.Struct, frozen=True, eq=False):
    """One panel: where it is, its measure, and its value of the factor `panels`."""

    axes: Axes
    measure: str
    value: object


def words_of(spec: Spec, value: object, text: str) -> str:
    """Return the words above a panel, after its value of the factor `panels`."""
    return text if spec.panels is None else f"{value_label(spec.panels, value)}: {text}"


def panels_of(
    study: Study, spec: Spec, names: Sequence[str], panel_mm: float = PANEL_MM, most_columns: int = 3
) -> tuple[Figure, list[Panel]]:
    """Return the figure and its panels with headings: by measure, and within it by the value of `panels`."""
    values = study.shown(spec, spec.panels)
    pairs = [(name, value) for name in names for value in values]
    if len(names) > 1 and 1 < len(values) <= most_columns:
        most_columns = len(values)  # one row a measure
    figure, places = page(spec.width, len(pairs), panel_mm, most_columns)
    panels = [Panel(axes, *pair) for axes, pair in zip(places, pairs, strict=True)]
    for panel in panels:
        heading(panel.axes, words_of(spec, panel.value, label(panel.measure)))
    return figure, panels


def estimates_of(
    study: Study, spec: Spec, panel: Panel, axes: Sequence[str | None], estimator: Estimator
) -> Estimates:
    """Return the estimates of a panel, with one dimension for each of `axes`, for the values drawn."""
    index, shape = study.groups(spec, (spec.panels, *axes))
    found = estimator(study.table, panel.measure, index, shape)
    found = found[index_of(study.values(spec.panels), panel.value)]
    for dimension, factor in enumerate(axes):
        if factor is not None and factor in spec.where:
            rows = [index_of(study.values(factor), value) for value in study.shown(spec, factor)]
            found = found[*(slice(None) for _ in range(dimension)), rows]
    return found
