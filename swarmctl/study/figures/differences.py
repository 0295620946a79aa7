"""Figure `differences`: what a factor changes against one of its values, in the same worlds."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import NDArray
from pydantic import Field

from swarmctl.study import statistics
from swarmctl.study.figures.base import (
    Names,
    Spec,
    Study,
    Value,
    factors_of,
    index_of,
    n_text,
    require_log_values,
    require_value,
    same,
)
from swarmctl.study.figures.dots import height_mm
from swarmctl.study.figures.marks import draw_lines, draw_rows, draw_zero, name_values
from swarmctl.study.figures.measures import factor_label, label, one_of, parts, value_label
from swarmctl.study.figures.panels import estimates_of, panels_of, words_of
from swarmctl.study.figures.style import columns_of, fit, heading, is_numeric, set_unit
from swarmctl.study.statistics import Estimates


class Differences(Spec):
    compare: str = Field(description="Factor whose values are compared.")
    reference: Value = Field(description="Value of this factor that the others are compared with.")
    y: Names = Field(description="Measures, one panel each.")
    x: str | None = Field(None, description="Factor on the horizontal axis. Default: the compared factor.")
    by: str | None = Field(None, description="Factor with one line for each value, if `x` is not given.")
    per: str | None = Field(
        None, description="Measure: the figure shows how much of `y` is saved for each unit of it spent more."
    )
    x_scale: Literal["linear", "log"] = Field("linear", description="Scale of the horizontal axis.")

    def factors(self) -> set[str]:
        return factors_of(self.compare, self.x, self.by, self.panels)

    def measures(self) -> set[str]:
        return {*self.y, *factors_of(self.per)}

    def check(self, factors: Mapping[str, Sequence[object]]) -> None:
        require_value(self.compare, self.reference, factors)
        if self.x is not None and self.by is not None:
            raise ValueError(
                "with `x`, the lines are the compared values; remove `by`, or name it in `panels`"
            )
        if self.x_scale == "log":
            along = self.x or self.compare
            is_drawn = [along != self.compare or not same(value, self.reference) for value in factors[along]]
            require_log_values(along, [*itertools.compress(factors[along], is_drawn)])


def draw(study: Study, spec: Differences) -> Figure:
    reference = index_of(study.values(spec.compare), spec.reference)
    others = [value for value in study.values(spec.compare) if not same(value, spec.reference)]
    rest = [index for index in range(len(study.values(spec.compare))) if index != reference]
    along = spec.x if spec.x is not None else spec.compare
    lines = spec.compare if spec.x is not None else spec.by
    by = others if lines == spec.compare else study.shown(spec, lines)
    x = (along, others if along == spec.compare else study.shown(spec, along))
    is_rows = not is_numeric(x[1])
    if is_rows:
        figure, panels = panels_of(study, spec, spec.y, height_mm(len(x[1]), len(by)), most_columns=4)
    else:
        figure, panels = panels_of(study, spec, spec.y)
    against = value_label(spec.compare, spec.reference)
    axes = (lines, along)

    def estimator(
        table: pd.DataFrame, name: str, groups: NDArray[np.int64], shape: Sequence[int]
    ) -> Estimates:
        dimension = 1 + axes.index(spec.compare)
        indices = np.arange(int(np.prod(shape))).reshape(tuple(shape))
        row = np.take(indices, [reference], axis=dimension)
        rows = np.broadcast_to(row, tuple(shape)).ravel()
        return _compared(table, name, spec.per, groups, rows).reshape(shape)

    for panel in panels:
        found = estimates_of(study, spec, panel, axes, estimator)
        found = found[:, rest] if along == spec.compare else found[rest]
        heading(panel.axes, _heading(spec, panel.measure, panel.value, against))
        if spec.per is None:
            set_unit(panel.axes.xaxis if is_rows else panel.axes.yaxis, panel.measure)
        if is_rows:
            draw_rows(panel.axes, x, by, found, named=columns_of(panel.axes)[0] == 0)
        else:
            draw_lines(panel.axes, x, by, found, spec.x_scale)
        draw_zero(panel.axes, upright=is_rows)
    name_values(figure, lines, by)
    if is_rows:
        fit(figure)
    return figure


def _compared(
    table: pd.DataFrame, name: str, per: str | None, groups: NDArray[np.int64], reference: NDArray[np.int64]
) -> Estimates:
    saved = parts(table, name, groups, reference.size)
    if per is None:
        return statistics.differences(saved.top.total, saved.below, reference)
    return statistics.savings(saved.top, parts(table, per, groups, reference.size).top, reference)


def _heading(spec: Differences, measure: str, value: object, against: str) -> str:
    text = f"{label(measure)}: difference to {against}"
    if spec.per is not None:
        text = f"{label(measure)} saved for each {one_of(spec.per)} more than with {against}"
    return words_of(spec, value, text)


def caption(study: Study, spec: Differences) -> str:
    names = "; ".join(label(name) for name in spec.y)
    against = value_label(spec.compare, spec.reference)
    worlds = f"95 % intervals by bootstrap over {n_text(study.n_worlds)} worlds"
    if spec.per is not None:
        text = f"Saved for each {one_of(spec.per)} more than with {against}: {names}"
        return f"{text}. No mark: a sample of worlds spends no more. Lines and bands: {worlds}."
    text = f"Difference to {against} in the same worlds, by {factor_label(spec.x or spec.compare)}: {names}"
    return f"{text}. Lines and bands: {worlds}."
