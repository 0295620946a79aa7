"""Figure `tradeoff`: one measure against another, as a curve along a factor or as dots."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from pydantic import Field

from swarmctl.report.pictures.style import INK
from swarmctl.study.figures.base import Names, Spec, Study, factors_of, interval_text
from swarmctl.study.figures.labels import Label, Labels
from swarmctl.study.figures.marks import limits
from swarmctl.study.figures.measures import estimate, factor_label, label, mathtext, value_label
from swarmctl.study.figures.panels import Panel, estimates_of, panels_of
from swarmctl.study.figures.style import MARKERS, colours, from_zero, set_log, set_unit
from swarmctl.study.statistics import Estimates

MOST_LABELS = 6


class Tradeoff(Spec):
    x: str = Field(description="Measure on the horizontal axis.")
    y: Names = Field(description="Measures on the vertical axis, one panel each.")
    along: str | None = Field(None, description="Factor whose values are joined by a curve and labelled.")
    by: str | None = Field(None, description="Factor with one curve, or one dot, for each value.")
    x_scale: Literal["linear", "log"] = Field("linear", description="Scale of the horizontal axis.")

    def factors(self) -> set[str]:
        return factors_of(self.along, self.by, self.panels)

    def measures(self) -> set[str]:
        return {self.x, *self.y}


def draw(study: Study, spec: Tradeoff) -> Figure:
    figure, panels = panels_of(study, spec, spec.y)
    labels = Labels()
    for panel in panels:
        y = estimates_of(study, spec, panel, (spec.by, spec.along), estimate)
        across = Panel(panel.axes, spec.x, panel.value)
        x = estimates_of(study, spec, across, (spec.by, spec.along), estimate)
        if spec.x_scale == "log":
            if (x.value <= 0.0).any():
                raise ValueError(f"a logarithmic axis cannot show means of {spec.x} of 0 or less")
            set_log(panel.axes)
        _draw(panel.axes, labels, spec, study, x, y)
        panel.axes.set_xlabel(mathtext(label(spec.x)))
        set_unit(panel.axes.xaxis, spec.x)
        set_unit(panel.axes.yaxis, panel.measure)
        from_zero(panel.axes, *limits(y))
        panel.axes.margins(x=0.1)
    labels.place(figure)
    return figure


def _draw(axes: Axes, labels: Labels, spec: Tradeoff, study: Study, x: Estimates, y: Estimates) -> None:
    by, along = study.shown(spec, spec.by), study.shown(spec, spec.along)
    for index, (value, colour) in enumerate(zip(by, colours(by), strict=True)):
        mark = MARKERS[index % len(MARKERS)]
        at_x, at_y = x.value[index], y.value[index]
        there = np.isfinite(at_x) & np.isfinite(at_y)
        if not there.any():
            continue
        axes.hlines(at_y, x.low[index], x.high[index], color=colour, lw=0.6, alpha=0.6, zorder=2)
        axes.vlines(at_x, y.low[index], y.high[index], color=colour, lw=0.6, alpha=0.6, zorder=2)
        size = 3.6 if spec.along is not None else 5.0
        axes.plot(at_x, at_y, color=colour, marker=mark, ms=size, mec="white", mew=0.4, zorder=4)
        labels.avoid(axes, at_x, at_y)
        for k in np.flatnonzero(there).tolist():
            labels.avoid(axes, [x.low[index][k], x.high[index][k]], [at_y[k], at_y[k]])
            labels.avoid(axes, [at_x[k], at_x[k]], [y.low[index][k], y.high[index][k]])
        last = int(np.flatnonzero(there)[-1])
        if spec.by is not None:
            labels.add_point(
                axes, Label(float(at_x[last]), float(at_y[last]), value_label(spec.by, value), colour)
            )
        if spec.along is not None and index == 0:
            for k in labelled(along, [bool(is_there) for is_there in there]):
                if spec.by is not None and k == last:
                    continue
                axes.plot(
                    at_x[k], at_y[k], color=colour, marker=mark, ms=size, mfc="white", mew=1.0, zorder=5
                )
                text = value_label(spec.along, along[k])
                labels.add_point(axes, Label(float(at_x[k]), float(at_y[k]), text, INK))


def labelled(values: Sequence[object], there: Sequence[bool]) -> list[int]:
    """Return the indices of the values to label: first and last, and at equal steps between them."""
    n = len(values)
    step = next(step for step in (1, 2, 4, 5, 10, 20, 50, n) if (n - 1) / step < MOST_LABELS)
    return [k for k in range(n) if there[k] and (k % step == 0 or k == n - 1)]


def caption(study: Study, spec: Tradeoff) -> str:
    along = f" along {factor_label(spec.along)}" if spec.along else ""
    by = f", one series for each value of {factor_label(spec.by)}" if spec.by else ""
    names = "; ".join(label(name) for name in spec.y)
    text = f"{names} against {label(spec.x)}{along}{by}; each mark is a mean"
    return f"{text[0].upper()}{text[1:]}. Crosses: {interval_text(study, [spec.x, *spec.y])}"
