"""The Pareto fronts of the vehicles' routes: for each vehicle a chart and a small map of the routes.

Colours run along the front from the shortest route to the least exposed, in the chart and on the map.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, to_hex
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike

from swarmctl.core.belief import CLEAR
from swarmctl.core.grid import Grid
from swarmctl.report.pictures.chart import draw_area
from swarmctl.report.pictures.panel import FrontPanel
from swarmctl.report.pictures.scene import MapPicture, VehicleTrack, local_m, view_of
from swarmctl.report.pictures.sheet import LEFT_IN, WIDTH_IN, Sheet, save_png
from swarmctl.report.pictures.style import FORBIDDEN, GRID_LINE, INK, OUTSIDE, QUIET

ALONG = LinearSegmentedColormap.from_list("along the front", ("#D55E00", "#A0568C", "#0072B2", "#00506B"))
EXPOSED = LinearSegmentedColormap.from_list("exposure", ("#FFFFFF", "#AEB9C6"))
OUT_OF_BOUND = FORBIDDEN
HALO = withStroke(linewidth=2.5, foreground="white")
"""outline of labels that may cover points"""

HEAD_IN, KEY_IN, ROW_HEAD_IN, ROW_FOOT_IN = 0.74, 0.34, 0.58, 0.52
CHART_WIDE_IN, MAP_WIDE_IN, GAP_IN = 4.45, 3.1, 0.45
RIGHT_IN = LEFT_IN + CHART_WIDE_IN + GAP_IN + MAP_WIDE_IN
FLAT_SHARE = 1e-9
"""share of the greatest exposure up to which a difference counts as a rounding error"""
ALONE_HIGH_IN, SHARED_HIGH_IN = 3.6, 2.15
"""height of a chart that is alone on a sheet, and of a chart beside others"""
WIDEST_PT, NARROWEST_PT, WIDEST_CELLS = 5.0, 1.2, 0.6
"""limits of the line width on the map: greatest and least [pt], greatest [cells]"""

CHOSEN_DASHES = (0, (3, 1.5))
"""dashes of a configured route that is on the map, but not on the front"""


def draw_fronts(path: Path, grid: Grid, panels: Sequence[FrontPanel], title: str, subtitle: str) -> None:
    """Write the PNG, 1440 pixels wide; equal fronts give equal bytes. Raises OSError."""
    save_png(front_figure(grid, panels, title, subtitle), path)


def front_figure(grid: Grid, panels: Sequence[FrontPanel], title: str, subtitle: str) -> Figure:
    """Return the figure: the legend, and for each vehicle a chart with a time scale and a map."""
    high_in = ALONE_HIGH_IN if len(panels) == 1 else SHARED_HIGH_IN
    row_in = ROW_HEAD_IN + high_in + ROW_FOOT_IN
    sheet = Sheet(HEAD_IN + KEY_IN + len(panels) * row_in + 0.06)
    sheet.write(0.12, title, fontsize=14, fontweight="bold", color=INK)
    sheet.write(0.42, subtitle, fontsize=9.5, color=QUIET)
    _draw_key(sheet.key_at(LEFT_IN, HEAD_IN, WIDTH_IN - LEFT_IN - 0.2, KEY_IN), panels)
    for index, panel in enumerate(panels):
        top_in = HEAD_IN + KEY_IN + index * row_in
        sheet.write(top_in + 0.1, panel.name, fontsize=11, fontweight="bold", color=INK)
        sheet.write(top_in + 0.125, panel.about, left_in=RIGHT_IN, ha="right", fontsize=8.5, color=QUIET)
        _draw_chart(sheet.axes_at(LEFT_IN, top_in + ROW_HEAD_IN, CHART_WIDE_IN, high_in), panel)
        _draw_map(sheet, grid, panel, top_in + ROW_HEAD_IN, high_in)
    return sheet.figure


def colours(n: int) -> list[str]:
    """Return the colours along a front of n points, by length."""
    return [to_hex(ALONG(k / max(n - 1, 1))) for k in range(n)]


def _draw_chart(axes: Axes, panel: FrontPanel) -> None:
    points = panel.points
    length_m = np.array([p.length_m for p in points])
    exposure = np.array([p.exposure_sum for p in points])
    supported = np.array([p.supported for p in points])
    _set_limits(axes, panel, length_m, exposure)
    axes.plot(length_m[supported], exposure[supported], color=QUIET, lw=1.0, zorder=3)
    size = 5.5 if len(points) <= 40 else 4.2
    for colour, point in zip(colours(len(points)), points, strict=True):
        face, order = (colour, 5) if point.supported else ("white", 4)
        axes.plot(
            point.length_m, point.exposure_sum, "o", ms=size, mfc=face, mec=colour, mew=1.1, zorder=order
        )
    axes.plot(*panel.chosen, "o", ms=size + 5.5, mfc="none", mec=INK, mew=1.4, zorder=6)
    if panel.chosen_track is not None:
        axes.plot(*panel.chosen, "o", ms=size, mfc=INK, mec=INK, mew=1.1, zorder=6)
    _label_chosen(axes, panel.chosen, panel.chosen_label)
    if len(points) == 1:
        axes.text(
            0.5, 0.25, "one route is shortest and least exposed", transform=axes.transAxes, fontsize=8.5,
            color=QUIET, ha="center", va="bottom", zorder=8, path_effects=[HALO],
        )  # fmt: skip
    _draw_bounds(axes, panel)
    _draw_scales(axes, panel)


def _set_limits(axes: Axes, panel: FrontPanel, length_m: ArrayLike, exposure: ArrayLike) -> None:
    lengths, exposures = np.append(length_m, panel.chosen[0]), np.append(exposure, panel.chosen[1])
    shown = [bound.length_m for bound in panel.bounds if 0.0 < bound.length_m < 1.6 * lengths.max()]
    lengths = np.append(lengths, shown)
    if exposures.max() - exposures.min() <= FLAT_SHARE * exposures.max():  # too flat for an axis
        exposures = np.append(exposures, 0.0 if exposures.max() > 0.0 else 1.0)
    for set_limits, values in ((axes.set_xlim, lengths), (axes.set_ylim, exposures)):
        low, high = float(values.min()), float(values.max())
        spare = 0.09 * (high - low) or 0.05 * high or 1.0
        set_limits(low - spare, high + spare)


def _label_chosen(axes: Axes, chosen: tuple[float, float], text: str) -> None:
    """Write the label above and to the right, or below and to the left, where a front has no points."""
    low, high = axes.get_xlim()
    is_right = chosen[0] > low + 0.7 * (high - low)
    offset = (-9, -1) if is_right else (9, 1)
    axes.annotate(
        text, chosen, offset, textcoords="offset points", fontsize=8, fontweight="bold", color=INK,
        ha="right" if is_right else "left", va="top" if is_right else "bottom", zorder=8, path_effects=[HALO],
    )  # fmt: skip


def _draw_bounds(axes: Axes, panel: FrontPanel) -> None:
    """Tint the lengths outside the time bound."""
    low, high = axes.get_xlim()
    for bound in panel.bounds:
        if not low < bound.length_m < high:
            continue
        out = (bound.length_m, high) if bound.is_latest else (low, bound.length_m)
        axes.axvspan(*out, color=OUT_OF_BOUND, alpha=0.07, lw=0, zorder=2)
        axes.axvline(bound.length_m, color=OUT_OF_BOUND, lw=1.2, ls=(0, (4, 2)), zorder=2.5)
        is_right = bound.length_m > (low + high) / 2
        axes.annotate(
            bound.text, (bound.length_m, 1.0), (-4 if is_right else 4, -4),
            xycoords=axes.get_xaxis_transform(), textcoords="offset points",
            ha="right" if is_right else "left", va="top", fontsize=8, color=OUT_OF_BOUND, zorder=8,
        )  # fmt: skip


def _draw_scales(axes: Axes, panel: FrontPanel) -> None:
    axes.set_xlabel("length through the area [m]", fontsize=8.5, color=QUIET, labelpad=2)
    axes.set_ylabel("exposure ΣP_s", fontsize=8.5, color=QUIET)
    for axis, n in ((axes.xaxis, 6), (axes.yaxis, 5)):
        axis.set_major_locator(MaxNLocator(n, steps=[1, 2, 2.5, 5, 10], min_n_ticks=3))
    axes.ticklabel_format(useOffset=False)
    axes.tick_params(labelsize=8, colors=QUIET, length=3)
    axes.grid(color=GRID_LINE, lw=0.5, alpha=0.7)
    axes.set_axisbelow(True)
    for spine in axes.spines.values():
        spine.set_color(GRID_LINE)

    def to_s(metres: ArrayLike) -> ArrayLike:
        return panel.entry_s + np.asarray(metres) / panel.speed_m_s

    def to_m(seconds: ArrayLike) -> ArrayLike:
        return (np.asarray(seconds) - panel.entry_s) * panel.speed_m_s

    seconds = axes.secondary_xaxis("top", functions=(to_s, to_m))
    seconds.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 2.5, 5, 10]))
    seconds.tick_params(labelsize=7, colors=QUIET, length=2, pad=1)
    seconds.set_xlabel("seconds from take-off to goal, without turns", fontsize=7.5, color=QUIET, labelpad=3)
    seconds.spines["top"].set_visible(False)


def _draw_map(sheet: Sheet, grid: Grid, panel: FrontPanel, top_in: float, high_in: float) -> None:
    known = np.full((grid.rows, grid.cols), CLEAR, dtype=np.int8)
    walls = frozenset((int(row), int(col)) for row, col in np.argwhere(np.isinf(panel.exposure)))
    vehicle = VehicleTrack(panel.name, panel.start, panel.goal_cells)
    picture = MapPicture(grid, frozenset(), known, [vehicle], panel.name, no_fly=walls)
    west, south, east, north = view_of(picture)
    inch_per_m = min(MAP_WIDE_IN / (east - west), high_in / (north - south))
    wide_in = (east - west) * inch_per_m
    left_in = LEFT_IN + CHART_WIDE_IN + GAP_IN + (MAP_WIDE_IN - wide_in) / 2
    axes = sheet.axes_at(left_in, top_in, wide_in, (north - south) * inch_per_m)
    axes.set(xlim=(west, east), ylim=(south, north), facecolor=OUTSIDE, xticks=[], yticks=[])
    for spine in axes.spines.values():
        spine.set_color(GRID_LINE)
    draw_area(axes, picture, 72.0 * inch_per_m)
    finite = np.where(np.isfinite(panel.exposure), panel.exposure, 0.0)
    extent = (0.0, grid.size_east_m, 0.0, grid.size_north_m)
    shades: dict[str, Any] = {"cmap": EXPOSED, "vmin": 0.0, "vmax": float(finite.max()) or 1.0}
    axes.imshow(
        finite, origin="lower", extent=extent, interpolation="nearest", aspect="auto", zorder=1.2, **shades
    )
    _draw_tracks(axes, grid, panel, grid.cell_size_m * 72.0 * inch_per_m)
    label = f"grey: P_s, up to {finite.max():.3g}"
    if sum(point.track is not None for point in panel.points) > 1:
        label = f"{label} · widest line: least exposed"
    axes.set_xlabel(label, fontsize=8, color=QUIET, labelpad=4)


def _draw_tracks(axes: Axes, grid: Grid, panel: FrontPanel, cell_pt: float) -> None:
    drawn = [
        (colour, point.track)
        for colour, point in zip(colours(len(panel.points)), panel.points, strict=True)
        if point.track is not None
    ]
    if panel.chosen_track is not None:
        line = local_m(grid, panel.chosen_track)
        axes.plot(*line.T, color=INK, lw=1.6, ls=CHOSEN_DASHES, zorder=7, path_effects=[HALO])
    widest = max(min(WIDEST_PT, WIDEST_CELLS * cell_pt), 1.8 * NARROWEST_PT)
    widths = np.linspace(widest, NARROWEST_PT, len(drawn))
    # Wide lines come first, so each narrower line stays visible on top.
    for (colour, track), width in zip(reversed(drawn), widths, strict=True):
        line = local_m(grid, track)
        axes.plot(*line.T, color=colour, lw=float(width), solid_joinstyle="round", zorder=6)
    axes.plot(*local_m(grid, [panel.start])[0], "o", ms=6.0, mfc=INK, mec="white", mew=0.9, zorder=9)


def _draw_key(axes: Axes, panels: Sequence[FrontPanel]) -> None:
    x, y = 0.0, 0.17
    n_inside = sum(not point.supported for panel in panels for point in panel.points)
    symbols = [("on the hull: found with some w", 5.5, QUIET, QUIET, 1.1)]
    if n_inside:
        symbols.append(("inside: found by `constrained` only", 5.5, "white", QUIET, 1.1))
    symbols.append(("configured", 9.5, "none", INK, 1.4))
    for text, size, face, edge, width in symbols:
        axes.plot(x + 0.08, y, "o", ms=size, mfc=face, mec=edge, mew=width)
        axes.text(x + 0.24, y, text, fontsize=8.5, color=INK, va="center")
        x += 0.45 + 0.062 * len(text)
    axes.text(x, y, "short", fontsize=8.5, color=INK, va="center")
    ramp = np.linspace(0.0, 1.0, 128)[None, :]
    axes.imshow(ramp, cmap=ALONG, extent=(x + 0.4, x + 1.25, y + 0.05, y - 0.05), aspect="auto")
    axes.text(x + 1.32, y, "least exposed", fontsize=8.5, color=INK, va="center")
    axes.set(xlim=(0.0, WIDTH_IN - LEFT_IN - 0.2), ylim=(KEY_IN, 0.0))
