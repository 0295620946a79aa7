"""Figure `tradeoff`: one measure against another, as a curve along a factor or as dots."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from pydantic import Field

from swarmctl.report.pictures.style import INK
from swarmctl.study.figures.base import Names, Spec, Study, factors_of, interval_text
from swarmctl.study.figures.marks import limits, name_values
from swarmctl.study.figures.measures import estimate, factor_label, label, mathtext, value_label
from swarmctl.study.figures.panels import Panel, estimates_of, panels_of
from swarmctl.study.figures.style import MARKERS, colours, from_zero, set_log, set_unit
from swarmctl.study.statistics import Estimates, Floats

MOST_LABELS = 6
HALO = withStroke(linewidth=1.8, foreground="white")


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
    for panel in panels:
        y = estimates_of(study, spec, panel, (spec.by, spec.along), estimate)
        across = Panel(panel.axes, spec.x, panel.value)
        x = estimates_of(study, spec, across, (spec.by, spec.along), estimate)
        if spec.x_scale == "log":
            if (x.value <= 0.0).any():
                raise ValueError(f"a logarithmic axis cannot show means of {spec.x} of 0 or less")
            set_log(panel.axes)
        _draw(panel.axes, spec, study, x, y)
        panel.axes.set_xlabel(mathtext(label(spec.x)))
        set_unit(panel.axes.xaxis, spec.x)
        set_unit(panel.axes.yaxis, panel.measure)
        from_zero(panel.axes, *limits(y))
        if spec.along is not None:
            low, high = panel.axes.get_ylim()
            panel.axes.set_ylim(low, high + 0.1 * (high - low))  # room for the names of points
        panel.axes.margins(x=0.14)
    name_values(figure, spec.by, study.shown(spec, spec.by))
    return figure


def _draw(axes: Axes, spec: Tradeoff, study: Study, x: Estimates, y: Estimates) -> None:
    by, along = study.shown(spec, spec.by), study.shown(spec, spec.along)
    for index, colour in enumerate(colours(by)):
        mark = MARKERS[index % len(MARKERS)]
        at_x, at_y = x.value[index], y.value[index]
        there = np.isfinite(at_x) & np.isfinite(at_y)
        if not there.any():
            continue
        axes.hlines(at_y, x.low[index], x.high[index], color=colour, lw=0.6, alpha=0.6, zorder=2)
        axes.vlines(at_x, y.low[index], y.high[index], color=colour, lw=0.6, alpha=0.6, zorder=2)
        size = 3.6 if spec.along is not None else 5.0
        axes.plot(at_x, at_y, color=colour, marker=mark, ms=size, mec="white", mew=0.4, zorder=4)
        if spec.along is not None and index == 0:
            shown = labelled(along, [bool(is_there) for is_there in there])
            axes.plot(at_x[shown], at_y[shown], mark, color=colour, ms=size, mfc="white", mew=1.0, zorder=5)
            _label(axes, at_x[shown], at_y[shown], [value_label(spec.along, along[k]) for k in shown])


def _label(axes: Axes, x: Floats, y: Floats, names: Sequence[str]) -> None:
    """Write the names of points beside a curve, alternately above and below it."""
    rises = (y[-1] > y[0]) == (x[-1] > x[0])
    for index, name in enumerate(names):
        up = 1 if index % 2 == 0 else -1
        right = -up if rises else up
        axes.annotate(
            mathtext(name), (x[index], y[index]), (4 * right, 4 * up), textcoords="offset points", color=INK,
            ha="left" if right > 0 else "right", va="bottom" if up > 0 else "top", annotation_clip=False,
            path_effects=[HALO], zorder=8,
        )  # fmt: skip


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
