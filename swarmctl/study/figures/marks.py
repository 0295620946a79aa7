"""Marks that several kinds of figures share: lines with bands, and rows of dots with intervals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from swarmctl.report.pictures.style import INK
from swarmctl.study.figures.labels import Label, Labels
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

GLYPHS = "●■▲◆▼✚✖◀▶⬟"
"""the letters that look like MARKERS"""
LEGEND_PT = 160.0
"""width of a row of names above a panel of one column"""
BAND = 0.18
"""opacity of an interval"""


def positions(values: Sequence[object]) -> list[float]:
    """Return the places of values on a horizontal axis."""
    if is_numeric(values):
        return [float(value) for value in values]  # type: ignore[arg-type]
    return [float(index) for index in range(len(values))]


def draw_lines(
    axes: Axes, labels: Labels, x: tuple[str, Sequence[object]], by: tuple[str | None, Sequence[object]],
    found: Estimates, scale: str, named: bool,
) -> None:  # fmt: skip
    """Draw one line for each row of `found` (by, x), with its interval as a band and its name at its end."""
    factor, values = x
    places = np.array(positions(values))
    shades = colours(by[1])
    for index, (value, colour) in enumerate(zip(by[1], shades, strict=True)):
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
        if by[0] is not None and named:
            labels.add_end(axes, Label(at[-1], float(y[there][-1]), value_label(by[0], value), colour))
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
    axes: Axes, x: tuple[str, Sequence[object]], by: tuple[str | None, Sequence[object]], found: Estimates,
    named: bool,
) -> None:  # fmt: skip
    """Draw `found` (by, x) as dots with intervals, one row a value, the first one at the top."""
    factor, values = x
    n = len(by[1])
    shades = colours(by[1])
    step = min(0.7 / n, 0.24)
    for index, colour in enumerate(shades):
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


def name_series(axes: Axes, by: tuple[str | None, Sequence[object]]) -> None:
    """Write the names of the series above the panel, each in its colour and after its mark."""
    if by[0] is None:
        return
    n_lines = axes.get_title(loc="left").count("\n") + 1
    names = [f"{GLYPHS[i % len(GLYPHS)]} {value_label(by[0], value)}" for i, value in enumerate(by[1])]
    widths = [0.64 * SMALL_PT * (len(name) + 1) for name in names]
    rows: list[list[int]] = [[]]
    for index, width in enumerate(widths):
        if rows[-1] and sum(widths[k] for k in rows[-1]) + width > LEGEND_PT:
            rows.append([])
        rows[-1].append(index)
    shades = colours(by[1])
    for row, members in enumerate(reversed(rows)):
        for index in members:
            x, y = sum(widths[k] for k in members if k < index), 16 + 9.5 * (row + n_lines - 1)
            axes.annotate(
                mathtext(names[index]), (0, 1), (x, y), xycoords="axes fraction", va="bottom",
                textcoords="offset points", color=dark(shades[index]), annotation_clip=False,
            )  # fmt: skip


def draw_zero(axes: Axes, upright: bool) -> None:
    """Draw the line of no difference, and widen the axis until it is inside."""
    (axes.axvline if upright else axes.axhline)(0.0, color=INK, lw=0.7, zorder=1.5)
    low, high = axes.get_xlim() if upright else axes.get_ylim()
    spare = 0.06 * (max(high, 0.0) - min(low, 0.0))
    (axes.set_xlim if upright else axes.set_ylim)(min(low, -spare), max(high, spare))
