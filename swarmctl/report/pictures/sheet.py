"""The map and its legend on a sheet, as a figure and as a PNG file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from swarmctl.report.pictures.chart import draw_area, draw_scales, draw_tracks
from swarmctl.report.pictures.key import (
    KeyRow,
    cell_rows,
    draw_north_and_scale,
    draw_rows,
    line_rows,
    n_lines,
    text_row,
    vehicle_rows,
)
from swarmctl.report.pictures.scene import MapPicture, view_of
from swarmctl.report.pictures.style import INK, OUTSIDE, QUIET

DPI = 160
WIDTH_IN = 9.0
MAP_WIDTH_IN, MAP_HEIGHT_IN = 5.55, 7.5
"""greatest size of a map"""
KEY_WIDTH_IN = 2.35
LEFT_IN, TOP_IN, BOTTOM_IN, GAP_IN = 0.62, 0.86, 0.58, 0.36
ROW_IN = 0.205
"""greatest height of a line of the legend"""
FOOT_IN = 0.8
"""height of the legend's foot: a gap, the north arrow and the scale bar"""
BELOW_COLUMNS = 2
"""number of columns of a legend below the map, for more vehicles than fit beside the map"""


def draw_map(path: Path, picture: MapPicture) -> None:
    """Write the PNG, 1440 pixels wide; equal pictures give equal bytes. Raises OSError."""
    save_png(figure_of(picture), path)


def save_png(figure: Figure, path: Path) -> None:
    """Write a figure; the bytes do not depend on matplotlib's version number. Raises OSError."""
    figure.savefig(path, dpi=DPI, format="png", metadata={"Software": None})


def figure_of(picture: MapPicture) -> Figure:
    """Return the figure: the map and the legend. Many vehicles have their rows below the map."""
    west, south, east, north = view_of(picture)
    inch_per_m = min(MAP_WIDTH_IN / (east - west), MAP_HEIGHT_IN / (north - south))
    map_wide_in, map_high_in = (east - west) * inch_per_m, (north - south) * inch_per_m
    beside, below = _beside_and_below(picture, map_high_in)
    beside_in = max(n_lines(beside) * ROW_IN + FOOT_IN, map_high_in)
    in_column = -(-len(below) // BELOW_COLUMNS)
    below_in = max(n_lines(below[:in_column]), n_lines(below[in_column:])) * ROW_IN
    sheet = Sheet(TOP_IN + max(beside_in, map_high_in + BOTTOM_IN + below_in) + 0.15)

    axes = sheet.axes_at(LEFT_IN, TOP_IN, map_wide_in, map_high_in)
    axes.set(xlim=(west, east), ylim=(south, north), facecolor=OUTSIDE)
    draw_area(axes, picture, 72.0 * inch_per_m)
    draw_tracks(axes, picture, 72.0 * inch_per_m)
    draw_scales(axes, picture.grid)

    key_left_in = LEFT_IN + map_wide_in + GAP_IN
    draw_rows(sheet.figure, beside, sheet.share_at(key_left_in, TOP_IN))
    key = sheet.key_at(key_left_in, TOP_IN, KEY_WIDTH_IN, beside_in)
    draw_north_and_scale(key, beside_in, inch_per_m)
    if below:
        place = sheet.share_at(LEFT_IN, TOP_IN + map_high_in + BOTTOM_IN)
        draw_rows(sheet.figure, below, place, BELOW_COLUMNS)
    sheet.write(0.12, picture.title, fontsize=14, fontweight="bold", color=INK)
    sheet.write(0.42, picture.subtitle, fontsize=9.5, color=QUIET)
    return sheet.figure


def _beside_and_below(picture: MapPicture, map_high_in: float) -> tuple[list[KeyRow], list[KeyRow]]:
    """Return the legend's rows beside the map and, if not all rows fit, those of the vehicles below it."""
    vehicles, symbols = vehicle_rows(picture), [*line_rows(picture), text_row(), *cell_rows(picture)]
    beside = [*vehicles, text_row(), *symbols]
    if n_lines(beside) * ROW_IN + FOOT_IN <= map_high_in:
        return beside, []
    return symbols, vehicles


class Sheet:
    """A figure with coordinates in inches from its upper left corner."""

    def __init__(self, high_in: float) -> None:
        self._high_in = high_in
        self.figure = Figure(figsize=(WIDTH_IN, high_in), dpi=DPI, facecolor="white")
        FigureCanvasAgg(self.figure)

    def axes_at(self, left_in: float, top_in: float, wide_in: float, high_in: float) -> Axes:
        bottom_in = self._high_in - top_in - high_in
        return self.figure.add_axes(
            (left_in / WIDTH_IN, bottom_in / self._high_in, wide_in / WIDTH_IN, high_in / self._high_in)
        )

    def share_at(self, left_in: float, top_in: float) -> tuple[float, float]:
        """Return a place as shares of the figure's width and height, from its lower left corner."""
        return left_in / WIDTH_IN, 1.0 - top_in / self._high_in

    def key_at(self, left_in: float, top_in: float, wide_in: float, high_in: float) -> Axes:
        """Return axes without a frame, with coordinates in inches."""
        axes = self.axes_at(left_in, top_in, wide_in, high_in)
        axes.set(xlim=(0.0, wide_in), ylim=(high_in, 0.0))
        axes.set_axis_off()
        return axes

    def write(self, top_in: float, text: str, *, left_in: float = LEFT_IN, **style: Any) -> None:
        self.figure.text(left_in / WIDTH_IN, 1.0 - top_in / self._high_in, text, va="top", **style)
