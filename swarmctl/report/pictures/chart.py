"""The map without its legend: the area, the tracks, the scales at the sides."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike
from scipy.sparse.csgraph import minimum_spanning_tree

from swarmctl.core.belief import OCCUPIED, UNKNOWN
from swarmctl.core.grid import Grid
from swarmctl.report.foxglove import colour_of
from swarmctl.report.pictures.scene import MapPicture, Points, local_m, shading
from swarmctl.report.pictures.style import (
    BADGE_PT,
    FORBIDDEN,
    FOUND,
    GRID_LINE,
    GROUP_LINE,
    GROUP_POINT,
    HATCH,
    INK,
    NEVER_FOUND,
    OBSERVED,
    QUIET,
    STRIKE,
    UNOBSERVED,
    draw_badge,
    flown_widths,
    hatch_lines,
    planned_styles,
)


def draw_area(axes: Axes, picture: MapPicture, points_per_m: float) -> None:
    """Draw goals and cells, shaded as in the paper's Figure 8; tint cells that no vehicle observed."""
    grid = picture.grid
    hostile, n1, n2 = shading(picture)
    missed = hostile & (picture.known != OCCUPIED)
    mistaken = ~hostile & (picture.known == OCCUPIED)
    hex_colours = (OBSERVED, UNOBSERVED, FOUND, NEVER_FOUND)
    colours = np.array([[*bytes.fromhex(colour[1:])] for colour in hex_colours], dtype=np.uint8)
    image = colours[np.where(hostile, np.where(missed, 3, 2), picture.known == UNKNOWN)]
    extent = (0.0, grid.size_east_m, 0.0, grid.size_north_m)
    axes.imshow(image, origin="lower", extent=extent, interpolation="nearest", aspect="auto", zorder=1)
    cell_pt = grid.cell_size_m * points_per_m
    if cell_pt > 5.0:
        edges: list[ArrayLike] = [((0, r), (grid.cols, r)) for r in range(1, grid.rows)]
        edges += [((c, 0), (c, grid.rows)) for c in range(1, grid.cols)]
        _draw_lines(axes, grid, edges, colors=GRID_LINE, linewidths=0.4, zorder=1.5)
    n = min(max(round(cell_pt / 3.2), 2), 6)
    hatch = [np.add(hatch_lines("level", n), (c, r)) for r, c in np.argwhere(n1).tolist()]
    hatch += [np.add(hatch_lines("upright", n), (c, r)) for r, c in np.argwhere(n2).tolist()]
    width = 0.7 if cell_pt > 8.0 else 0.4
    _draw_lines(axes, grid, hatch, colors=HATCH, linewidths=width, zorder=2)

    crosses = [np.add(hatch_lines("crossed"), (col, row)) for row, col in sorted(picture.no_fly)]
    _draw_lines(axes, grid, crosses, colors=FORBIDDEN, linewidths=1.2, zorder=3.5)
    for row, col in sorted(picture.no_fly):
        _outline(axes, grid, row, col, edgecolor=FORBIDDEN, lw=1.2, zorder=3.5)
    for row, col in np.argwhere(missed).tolist():
        _outline(axes, grid, row, col, edgecolor=FOUND, lw=0.8, ls=(0, (2, 1.5)), zorder=3)
    for row, col in np.argwhere(mistaken).tolist():
        _outline(axes, grid, row, col, edgecolor=FOUND, lw=1.6, zorder=3)
    for row, col in sorted({cell for track in picture.tracks for cell in track.goal_cells}):
        _outline(axes, grid, row, col, edgecolor=INK, lw=2.0, zorder=5)
    axes.add_patch(
        Rectangle((0.0, 0.0), grid.size_east_m, grid.size_north_m, fill=False, edgecolor=INK, zorder=4)
    )


def _draw_lines(axes: Axes, grid: Grid, ends: Sequence[ArrayLike], **style: Any) -> None:
    """Draw lines whose `ends` are columns east and rows north."""
    lines = np.array(ends, dtype=np.float64).reshape(-1, 2, 2) * grid.cell_size_m
    axes.add_collection(LineCollection(list(lines), **style))


def _outline(axes: Axes, grid: Grid, row: int, col: int, **style: Any) -> None:
    size = grid.cell_size_m
    axes.add_patch(Rectangle((col * size, row * size), size, size, fill=False, **style))


def draw_tracks(axes: Axes, picture: MapPicture, points_per_m: float) -> None:
    """Draw planned and flown lines, strikes, and the start and end of each vehicle."""
    grid, styles, widths = picture.grid, planned_styles(picture), flown_widths(len(picture.tracks))
    for index, track in enumerate(picture.tracks):
        colour = colour_of(index)
        for planned in track.planned:
            line = local_m(grid, planned.points)
            axes.plot(*line.T, **{"color": colour, "zorder": 6, **styles[planned.label]})
        if len(track.flown):
            flown = local_m(grid, track.flown)
            axes.plot(*flown.T, color="white", lw=widths[index] + 1.6, alpha=0.9, zorder=6.5)
            axes.plot(*flown.T, color=colour, lw=widths[index], solid_joinstyle="round", zorder=7)
            face, edge = ("white", colour) if track.is_lost else (colour, "white")
            axes.plot(*flown[-1], "s", ms=6.5, mfc=face, mec=edge, mew=0.9, zorder=8)
        strikes = local_m(grid, track.strikes)
        axes.plot(*strikes.T, "*", ms=9.0, mfc=STRIKE, mec=INK, mew=0.7, ls="none", zorder=9)
    _draw_groups(axes, picture)
    starts = local_m(grid, [track.start for track in picture.tracks])
    for index, (start, badge) in enumerate(
        zip(starts, _spread(starts, BADGE_PT / points_per_m), strict=True)
    ):
        axes.plot(*np.stack([start, badge]).T, color=colour_of(index), lw=0.8, zorder=9.5)
        draw_badge(axes, float(badge[0]), float(badge[1]), index)


def _draw_groups(axes: Axes, picture: MapPicture) -> None:
    """Draw the members of each group at one time as dots, with lines between neighbours."""
    lines: list[Points] = []
    for members in picture.groups:
        points = local_m(picture.grid, members)
        between_m = np.hypot(*(points[:, None] - points[None, :]).transpose(2, 0, 1))
        ends = np.argwhere(minimum_spanning_tree(between_m).toarray() > 0.0)
        lines += [points[pair] for pair in ends]
        axes.plot(*points.T, **GROUP_POINT, zorder=8.6)
    axes.add_collection(LineCollection(lines, **GROUP_LINE, zorder=8.5))


def _spread(points: Points, least_m: float) -> Points:
    """Return the points (n, 2), moved apart until the distances are about `least_m` or more."""
    angles = 2.4 * np.arange(len(points))
    # Points in the same place get small offsets in different directions.
    moved = points + 1e-3 * least_m * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    for _ in range(100):
        between = moved[:, None] - moved[None, :]
        gap_m = np.hypot(between[..., 0], between[..., 1]) + np.eye(len(points)) * least_m
        if gap_m.min(initial=least_m) >= 0.99 * least_m:
            break
        push = np.maximum(least_m - gap_m, 0.0) / (2.0 * gap_m)
        moved = moved + (between * push[..., None]).sum(axis=1)
    return moved


def draw_scales(axes: Axes, grid: Grid) -> None:
    """Draw scales: metres at the left and below, cell indices at the right and above."""
    axes.set_xlabel("metres east of the area's south-west corner", fontsize=8.5, color=QUIET)
    axes.set_ylabel("metres north", fontsize=8.5, color=QUIET)
    axes.tick_params(labelsize=8, colors=QUIET, length=3)
    for axis, length_m in ((axes.xaxis, grid.size_east_m), (axes.yaxis, grid.size_north_m)):
        ticks = MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]).tick_values(0.0, length_m)
        axis.set_ticks([tick for tick in ticks if 0.0 <= tick <= length_m])
    for spine in axes.spines.values():
        spine.set_color(GRID_LINE)
    size = grid.cell_size_m

    def to_cells(metres: ArrayLike) -> ArrayLike:
        return np.asarray(metres) / size - 0.5

    def to_metres(cells: ArrayLike) -> ArrayLike:
        return (np.asarray(cells) + 0.5) * size

    columns = axes.secondary_xaxis("top", functions=(to_cells, to_metres))
    rows = axes.secondary_yaxis("right", functions=(to_cells, to_metres))
    for scale, n, label in ((columns.xaxis, grid.cols, "col"), (rows.yaxis, grid.rows, "row")):
        interval = next(step for step in (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, n) if n / step <= 10)
        indices = range(0, n, interval)
        scale.set_ticks(indices, [f"{label} {k}" if k == 0 else str(k) for k in indices])
    for secondary in (columns, rows):
        secondary.tick_params(labelsize=6.5, colors=QUIET, length=0, pad=2)
        for spine in secondary.spines.values():
            spine.set_visible(False)
