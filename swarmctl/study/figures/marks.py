"""Marks of several kinds of figures: lines with bands, rows of dots with intervals, names of series."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from swarmctl.report.pictures.style import INK
from swarmctl.study.figures.measures import factor_label, mathtext, value_label, value_words
from swarmctl.study.figures.style import (
    MARKERS,
    SMALL_PT,
    colours,
    dark,
    from_zero,
    is_numeric,
    set_scale,
    set_unit,
)
from swarmctl.study.statistics import Estimates

NAMES_MM = 3.6
"""height of a row of names above the panels"""
BAND = 0.18
"""opacity of an interval"""


def positions(values: Sequence[object]) -> list[float]:
    """Return the places of values on a horizontal axis."""
    if is_numeric(values):
        return [float(value) for value in values]  # type: ignore[arg-type]
    return [float(index) for index in range(len(values))]


def draw_lines(
    axes: Axes, x: tuple[str, Sequence[object]], by: Sequence[object], found: Estimates, scale: str
) -> None:
    """Draw one line for each row of `found` (by, x), with its interval as a band."""
    factor, values = x
    places = np.array(positions(values))
    for index, colour in enumerate(colours(by)):
        y, low, high = found.value[index], found.low[index], found.high[index]
        there = np.isfinite(y)
        if not there.any():
            continue
        at = places[there]
        axes.fill_between(at, low[there], high[there], color=colour, alpha=BAND, lw=0, zorder=2 + index / 50)
        mark = MARKERS[index % len(MARKERS)]
        every = max(round(there.sum() / 7), 1)
        if there.sum() == 1:
            axes.errorbar(at, y[there], [y[there] - low[there], high[there] - y[there]], color=colour, lw=0.9)
        axes.plot(
            at,
            y[there],
            color=colour,
            marker=mark,
            markevery=every,
            mec="white",
            mew=0.4,
            zorder=4 + index / 50,
        )
    set_scale(axes, scale, values)
    set_unit(axes.xaxis, factor)
    if not is_numeric(values):
        axes.set_xticks(places, [value_words(value) for value in values])
        axes.set_xlim(-0.3, len(values) - 0.7)
    axes.set_xlabel(mathtext(factor_label(factor)))
    axes.grid(axis="x", visible=False)
    low, high = limits(found)
    from_zero(axes, low, high)


def limits(found: Estimates) -> tuple[float, float]:
    """Return the least and the greatest end of the intervals; NaN without any value."""
    low = np.where(np.isfinite(found.low), found.low, found.value)
    high = np.where(np.isfinite(found.high), found.high, found.value)
    if not np.isfinite(low).any():
        return np.nan, np.nan
    return float(np.nanmin(low)), float(np.nanmax(high))


def draw_rows(
    axes: Axes, x: tuple[str, Sequence[object]], by: Sequence[object], found: Estimates, named: bool
) -> None:
    """Draw `found` (by, x) as dots with intervals, one row a value, the first one at the top."""
    factor, values = x
    n = len(by)
    step = min(0.7 / n, 0.24)
    for index, colour in enumerate(colours(by)):
        rows = np.arange(len(values)) + (index - (n - 1) / 2) * step
        value, low, high = found.value[index], found.low[index], found.high[index]
        low, high = (np.where(np.isfinite(limit), limit, value) for limit in (low, high))
        axes.hlines(rows, low, high, color=colour, lw=1.1, zorder=3)
        mark = MARKERS[index % len(MARKERS)]
        axes.plot(value, rows, mark, color=colour, ms=4.2, mec="white", mew=0.5, zorder=4)
    names = [value_label(factor, value) for value in values] if named else ["" for _ in values]
    axes.set_yticks(np.arange(len(values)), names)
    axes.set_ylim(len(values) - 0.5, -0.5)
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    low_x, high_x = limits(found)
    if np.isfinite(low_x + high_x):
        spare = 0.07 * (high_x - low_x) or 0.05 * abs(high_x) or 0.5
        axes.set_xlim(low_x - spare, high_x + spare)
    axes.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]))


def name_series(figure: Figure, names: Sequence[str], shades: Sequence[str]) -> None:
    """Write the names of the series above the panels, each in its colour and after its mark.

    The page grows by the height of the names.
    """
    width, height = figure.get_size_inches()
    widest_pt = 0.6 * SMALL_PT * max(map(len, names)) + 20.0
    n_fitting = max(int((72.0 * width - 10.0) / widest_pt), 1)
    n_lines = math.ceil(len(names) / n_fitting)
    n_columns = math.ceil(len(names) / n_lines)
    figure.set_size_inches(width, height + n_lines * NAMES_MM / 25.4)
    marks = [
        Line2D([], [], color=shade, marker=MARKERS[index % len(MARKERS)], mec="white", mew=0.4)
        for index, shade in enumerate(shades)
    ]
    figure.legend(
        marks, [*map(mathtext, names)], loc="outside upper left", ncols=n_columns, frameon=False,
        labelcolor=[*map(dark, shades)], handlelength=1.6, columnspacing=1.0, borderpad=0.0,
    )  # fmt: skip


def name_values(figure: Figure, factor: str | None, values: Sequence[object]) -> None:
    """Write the names of the values of a factor, if each has a series."""
    if factor is not None:
        name_series(figure, [value_label(factor, value) for value in values], colours(values))


def draw_zero(axes: Axes, upright: bool) -> None:
    """Draw the line of no difference, and widen the axis until it is inside."""
    (axes.axvline if upright else axes.axhline)(0.0, color=INK, lw=0.7, zorder=1.5)
    low, high = axes.get_xlim() if upright else axes.get_ylim()
    spare = 0.06 * (max(high, 0.0) - min(low, 0.0))
    (axes.set_xlim if upright else axes.set_ylim)(min(low, -spare), max(high, spare))
