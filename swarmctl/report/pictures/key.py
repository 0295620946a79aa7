"""The legend beside the map: its rows, the north arrow and the scale bar."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from typing import Any

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.legend_handler import HandlerTuple
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from swarmctl.core.belief import OCCUPIED, UNKNOWN
from swarmctl.report.foxglove import colour_of
from swarmctl.report.pictures.scene import GROUP_EVERY_S, MapPicture, VehicleTrack, shading
from swarmctl.report.pictures.style import (
    BADGE_PT,
    FORBIDDEN,
    FOUND,
    GRID_LINE,
    GROUP_POINT,
    HATCH,
    INK,
    NEVER_FOUND,
    OBSERVED,
    STRIKE,
    UNOBSERVED,
    flown_widths,
    planned_styles,
)

MAX_KEY_VEHICLES = 30
ROW_CHARS = 29
"""greatest length of a line of a row's text [characters]"""
FONT_PT = 8.5
LAYOUT: dict[str, Any] = {
    "handlelength": 2.5, "handleheight": 1.2, "handletextpad": 1.0, "labelspacing": 0.5, "borderpad": 0.0,
    "borderaxespad": 0.0,
}  # fmt: skip
"""lengths in a legend, in units of FONT_PT; a line takes less than `sheet.ROW_IN`"""

KeyRow = tuple[tuple[Artist, ...], str]
"""the marks of a row of the legend, drawn over each other, and its text"""


def text_row(text: str = "") -> KeyRow:
    """Return a row without marks."""
    return (Line2D([], [], ls="none"),), text


def draw_rows(
    figure: Figure, rows: Sequence[KeyRow], upper_left: tuple[float, float], n_columns: int = 1
) -> None:
    """Draw rows as a legend; its corner is a share of the figure's width and height."""
    marks, texts = zip(*rows, strict=True)
    figure.legend(
        marks, texts, loc="upper left", bbox_to_anchor=upper_left, ncols=n_columns, frameon=False,
        fontsize=FONT_PT, labelcolor=INK, handler_map={tuple: HandlerTuple(ndivide=1)}, **LAYOUT,
    )  # fmt: skip


def n_lines(rows: Sequence[KeyRow]) -> int:
    """Return the number of lines of text of some rows."""
    return sum(1 + text.count("\n") for _, text in rows)


def vehicle_rows(picture: MapPicture) -> list[KeyRow]:
    """Return the row of each vehicle; a long outcome takes several lines."""
    widths = flown_widths(len(picture.tracks))
    shown = picture.tracks
    if len(picture.tracks) > MAX_KEY_VEHICLES:
        shown = picture.tracks[: MAX_KEY_VEHICLES - 1]
    rows = [_vehicle_row(index, track, widths[index]) for index, track in enumerate(shown)]
    if n_more := len(picture.tracks) - len(shown):
        rows.append(text_row(f"and {n_more} more"))
    return rows


def line_rows(picture: MapPicture) -> list[KeyRow]:
    rows: list[KeyRow] = []
    if flown := [track for track in picture.tracks if len(track.flown)]:
        rows.append(_line_row("flown", {"lw": 2.2}))
        if len(flown) > 1:
            rows.append(text_row("(widths differ so that lines\nthat overlap stay visible)"))
        if not all(track.is_lost for track in flown):
            rows.append(_point_row("end of flight", "s", {"ms": 6.5, "mec": "white"}))
        if any(track.is_lost for track in flown):
            style = {"ms": 6.5, "mfc": "white", "mec": INK, "mew": 0.9}
            rows.append(_point_row("last known position", "s", style))
    rows += [_line_row(label, style) for label, style in planned_styles(picture).items()]
    if picture.groups:
        line = Line2D([], [], color=INK, lw=1.0)
        rows.append(((line, Line2D([], [], **GROUP_POINT)), f"a group, every {GROUP_EVERY_S:g} s"))
    n_strikes = sum(len(track.strikes) for track in picture.tracks)
    if n_strikes:
        style = {"ms": 9.0, "mfc": STRIKE, "mec": INK, "mew": 0.7}
        rows.append(_point_row(f"strike ({n_strikes})", "*", style))
    return rows


def cell_rows(picture: MapPicture) -> list[KeyRow]:
    """Return rows for the kinds of cell that are on this map."""
    hostile, n1, n2 = shading(picture)
    occupied, unseen = picture.known == OCCUPIED, picture.known == UNKNOWN
    n_found, n_missed = int((hostile & occupied).sum()), int((hostile & ~occupied).sum())
    n_mistaken = int((~hostile & occupied).sum())
    n_unseen, n_seen = int(unseen.sum()), int((~unseen).sum())
    missed = {"facecolor": NEVER_FOUND, "edgecolor": FOUND, "ls": (0, (2, 1.5))}
    rows: tuple[tuple[bool, str, dict[str, Any]], ...] = (
        (True, "goal", {"edgecolor": INK, "lw": 2.0}),
        (bool(picture.no_fly), "no-fly", {"edgecolor": FORBIDDEN, "lw": 1.2, "hatch": "xx"}),
        (n_found > 0, f"hostile, found ({n_found})", {"facecolor": FOUND}),
        (n_missed > 0, f"hostile, not found ({n_missed})", missed),
        (n_mistaken > 0, f"false alarm believed ({n_mistaken})", {"edgecolor": FOUND, "lw": 1.6}),
        (bool(n1.any()), "next to a hostile (N1)", {"edgecolor": HATCH, "hatch": "----"}),
        (bool(n2.any()), "diagonal to a hostile (N2)", {"edgecolor": HATCH, "hatch": "||||"}),
        (n_seen > 0, f"seen ({n_seen} cells)", {}),
        (n_unseen > 0, f"never seen ({n_unseen} cells)", {"facecolor": UNOBSERVED}),
    )
    plain = {"facecolor": OBSERVED, "edgecolor": GRID_LINE, "lw": 0.8}
    return [((Patch(**{**plain, **style}),), text) for is_there, text, style in rows if is_there]


def _vehicle_row(index: int, track: VehicleTrack, width: float) -> KeyRow:
    """Return the row of a vehicle, with its line as wide as on the map, and its numbered disc."""
    colour = colour_of(index)
    line = Line2D([], [], color=colour, lw=width)
    disc = Line2D([], [], marker="o", ls="none", ms=BADGE_PT - 1.0, mfc=colour, mec="white", mew=0.9)
    number = Line2D([], [], marker=f"$\\mathbf{{{index + 1}}}$", ls="none", ms=5.2, mfc="white", mew=0.0)
    return (line, disc, number), textwrap.fill(f"{track.name}   {track.outcome}", ROW_CHARS)


def _line_row(text: str, style: dict[str, Any]) -> KeyRow:
    return (Line2D([], [], **{"color": INK, **style}),), text


def _point_row(text: str, marker: str, style: dict[str, Any]) -> KeyRow:
    return (Line2D([], [], marker=marker, ls="none", **{"mfc": INK, **style}),), text


def draw_north_and_scale(axes: Axes, bottom_in: float, inch_per_m: float) -> None:
    """Draw the north arrow and the scale bar at the foot of the legend."""
    y = bottom_in - 0.06
    arrow = {"arrowstyle": "-|>", "color": INK, "lw": 1.2, "shrinkB": 0}
    axes.annotate("", (0.12, y - 0.42), (0.12, y), arrowprops=arrow)
    axes.text(0.12, y - 0.44, "N", fontsize=9, fontweight="bold", color=INK, ha="center", va="bottom")
    longest_m = 1.2 / inch_per_m
    power = 10.0 ** math.floor(math.log10(longest_m))
    bar_m = max(step * power for step in (1, 2, 5) if step * power <= longest_m)
    left, right = 0.5, 0.5 + bar_m * inch_per_m
    axes.plot(
        [left, left, right, right], [y - 0.07, y, y, y - 0.07], color=INK, lw=1.2, solid_joinstyle="miter"
    )
    label = f"{bar_m / 1000.0:g} km" if bar_m >= 1000.0 else f"{bar_m:g} m"
    axes.text((left + right) / 2, y - 0.1, label, fontsize=8, color=INK, ha="center", va="bottom")
