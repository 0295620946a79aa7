"""Figure `calibration`: how often happens what a probability says."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from pydantic import Field

from swarmctl.report.pictures.style import QUIET
from swarmctl.study import statistics
from swarmctl.study.figures.base import Names, Spec, Study, factors_of, index_of, n_text
from swarmctl.study.figures.marks import name_series
from swarmctl.study.figures.measures import label, mathtext, value_label
from swarmctl.study.figures.panels import words_of
from swarmctl.study.figures.style import MARKERS, colours, page
from swarmctl.study.statistics import Estimates, Floats

LEAST_ROWS = 10
"""fewest vehicles of a bin that is drawn"""


class Calibration(Spec):
    predicted: Names = Field(description="Measures that are probabilities from 0 to 1.")
    observed: str = Field("survived", description="Measure that is true or false.")
    by: str | None = Field(
        None, description="Factor with one line for each value, for one predicted measure."
    )
    bins: int = Field(10, ge=2, le=50, description="Number of intervals of equal width from 0 to 1.")

    def factors(self) -> set[str]:
        return factors_of(self.by, self.panels)

    def measures(self) -> set[str]:
        return {*self.predicted, self.observed}


def draw(study: Study, spec: Calibration) -> Figure:
    values = study.shown(spec, spec.panels)
    figure, panels = page(spec.width, len(values), 74.0 if spec.width == "one" else 62.0)
    series = [(name, value) for name in spec.predicted for value in study.shown(spec, spec.by)]
    shades = colours([name if spec.by is None else value for name, value in series])
    for axes, value in zip(panels, values, strict=True):
        _draw(axes, study, spec, series, shades, value)
        axes.set_title(mathtext(words_of(spec, value, f"{label(spec.observed)}, as observed")))
    if spec.by is not None or len(series) > 1:
        name_series(figure, [_name(spec, *each) for each in series], shades)
    return figure


def _name(spec: Calibration, name: str, value: object) -> str:
    """Return the name of the series of a predicted measure and a value of the factor `by`."""
    if spec.by is None:
        return label(name)
    text = value_label(spec.by, value)
    return f"{label(name)}, {text}" if len(spec.predicted) > 1 else text


def _draw(
    axes: Axes,
    study: Study,
    spec: Calibration,
    series: Sequence[tuple[str, object]],
    shades: Sequence[str],
    panel: object,
) -> None:
    axes.plot([0, 1], [0, 1], color=QUIET, lw=0.7, zorder=1.5)
    axes.annotate(
        "as\npredicted", (1, 1), (4, 0), textcoords="offset points", color=QUIET, va="center",
        annotation_clip=False,
    )  # fmt: skip
    for index, ((name, value), colour) in enumerate(zip(series, shades, strict=True)):
        at, found = binned(study, spec, name, value, panel)
        drawn = np.isfinite(at)
        axes.vlines(at, found.low, found.high, color=colour, lw=0.8, zorder=3)
        mark = MARKERS[index % len(MARKERS)]
        axes.plot(
            at[drawn], found.value[drawn], color=colour, marker=mark, mec="white", mew=0.4, lw=0.9, zorder=4
        )
    axes.set(xlim=(0, 1), ylim=(0, 1), aspect="equal")
    ticks = np.linspace(0, 1, 6)
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks.round(1)])
    axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks.round(1)])
    one = len(spec.predicted) == 1
    axes.set_xlabel(mathtext(label(spec.predicted[0])) if one else "as predicted")


def binned(
    study: Study, spec: Calibration, name: str, value: object, panel: object
) -> tuple[Floats, Estimates]:
    """Return the mean prediction of each bin, and the share observed."""
    table = study.table
    chosen, _ = study.groups(spec, ())
    for factor, wanted in ((spec.by, value), (spec.panels, panel)):
        if factor is not None:
            code = index_of(study.values(factor), wanted)
            chosen = np.where(study.codes(factor, table) == code, chosen, -1)
    predicted = table[name].to_numpy(dtype=np.float64)
    is_known = np.isfinite(predicted)
    bins = np.clip((np.where(is_known, predicted, 0.0) * spec.bins).astype(np.int64), 0, spec.bins - 1)
    groups = np.where((chosen >= 0) & is_known, bins, -1)
    seeds = table["seed"].to_numpy()
    sums = statistics.by_world(table[spec.observed], groups, seeds, spec.bins)
    below = sums.count.sum(axis=1)
    found = statistics.proportions(sums.total, sums.count)
    means = statistics.by_world(predicted, groups, seeds, spec.bins).total.sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        at = np.where(below >= LEAST_ROWS, means / below, np.nan)
    return at, found


def caption(study: Study, spec: Calibration) -> str:
    predicted = "; ".join(label(name) for name in spec.predicted)
    text = f"Observed {label(spec.observed)} by {predicted}, in {spec.bins} bins of equal width"
    text += f" (bins with {LEAST_ROWS} vehicles or more). A true probability lies on the diagonal"
    worlds = f"{n_text(study.n_worlds)} worlds"
    return f"{text}. Lines: 95 % Wilson intervals over {worlds}, with the effective number of vehicles."
