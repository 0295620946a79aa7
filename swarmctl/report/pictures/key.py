"""The legend beside the map: its rows, the north arrow and the scale bar."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable
from typing import Any

from matplotlib.axes import Axes

from swarmctl.core.belief import OCCUPIED, UNKNOWN
from swarmctl.report.foxglove import colour_of
from swarmctl.report.pictures.scene import GROUP_EVERY_S, MapPicture, VehicleTrack, shading
from swarmctl.report.pictures.style import (
    FORBIDDEN,
    FOUND,
    GROUP_POINT,
    INK,
    NEVER_FOUND,
    STRIKE,
    UNOBSERVED,
    Hatch,
    draw_badge,
    flown_widths,
    planned_styles,
    shaded_square,
)

MAX_KEY_VEHICLES = 30
ROW_CHARS = 29
"""greatest length of a vehicle row's text [characters]"""

KeyRow = Callable[[Axes, float, float], None]
"""a function that draws one row of the legend at (x, y) [in]"""


def blank_row(_axes: Axes, _x: float, _y: float) -> None:
    """Draw nothing: an empty row."""


def vehicle_rows(picture: MapPicture) -> list[list[KeyRow]]:
    """Return the rows of each vehicle; a long outcome takes several rows."""
    widths = flown_widths(len(picture.tracks))
    shown = picture.tracks
    if len(picture.tracks) > MAX_KEY_VEHICLES:
        shown = picture.tracks[: MAX_KEY_VEHICLES - 1]
    blocks = [_vehicle_block(index, track, widths[index]) for index, track in enumerate(shown)]
    if n_more := len(picture.tracks) - len(shown):
        blocks.append([_text_row(f"and {n_more} more")])
    return blocks


def line_rows(picture: MapPicture) -> list[KeyRow]:
    rows: list[KeyRow] = []
    if flown := [track for track in picture.tracks if len(track.flown)]:
        rows.append(_line_row("flown", {"lw": 2.2}))
        if len(flown) > 1:
            rows += [
                _text_row(text) for text in ("(widths differ so that lines", "that overlap stay visible)")
            ]
        if not all(track.is_lost for track in flown):
            rows.append(_point_row("end of flight", "s", {"ms": 6.5, "mec": "white"}))
        if any(track.is_lost for track in flown):
            style = {"ms": 6.5, "mfc": "white", "mec": INK, "mew": 0.9}
            rows.append(_point_row("last known position", "s", style))
    rows += [_line_row(label, style) for label, style in planned_styles(picture).items()]
    if picture.groups:
        rows.append(_group_row(f"a group, every {GROUP_EVERY_S:g} s"))
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
    rows = {
        _cell_row("goal", {"edgecolor": INK, "lw": 2.0}): True,
        _cell_row("no-fly", {"edgecolor": FORBIDDEN, "lw": 1.2}, "crossed"): bool(picture.no_fly),
        _cell_row(f"hostile, found ({n_found})", {"facecolor": FOUND}): n_found > 0,
        _cell_row(f"hostile, not found ({n_missed})", missed): n_missed > 0,
        _cell_row(f"false alarm believed ({n_mistaken})", {"edgecolor": FOUND, "lw": 1.6}): n_mistaken > 0,
        _cell_row("next to a hostile (N1)", {}, "level"): n1.any(),
        _cell_row("diagonal to a hostile (N2)", {}, "upright"): n2.any(),
        _cell_row(f"seen ({n_seen} cells)", {}): n_seen > 0,
        _cell_row(f"never seen ({n_unseen} cells)", {"facecolor": UNOBSERVED}): n_unseen > 0,
    }
    return [row for row, is_there in rows.items() if is_there]


def _text(axes: Axes, x: float, y: float, text: str) -> None:
    axes.text(x + 0.42, y, text, fontsize=8.5, color=INK, va="center")


def _vehicle_block(index: int, track: VehicleTrack, width: float) -> list[KeyRow]:
    """Return the rows of a vehicle; the first row has the vehicle's line, as wide as on the map."""
    first, *more = textwrap.wrap(f"{track.name}   {track.outcome}", ROW_CHARS)

    def draw(axes: Axes, x: float, y: float) -> None:
        axes.plot([x, x + 0.3], [y, y], color=colour_of(index), lw=width)
        draw_badge(axes, x + 0.15, y, index)
        _text(axes, x, y, first)

    return [draw, *map(_text_row, more)]


def _text_row(text: str) -> KeyRow:
    return lambda axes, x, y: _text(axes, x, y, text)


def _line_row(text: str, style: dict[str, Any]) -> KeyRow:
    def draw(axes: Axes, x: float, y: float) -> None:
        axes.plot([x, x + 0.3], [y, y], color=INK, **style)
        _text(axes, x, y, text)

    return draw


def _group_row(text: str) -> KeyRow:
    def draw(axes: Axes, x: float, y: float) -> None:
        xs, ys = [x + 0.03, x + 0.15, x + 0.27], [y + 0.05, y - 0.05, y + 0.05]
        axes.plot(xs, ys, color=INK, lw=1.0)
        axes.plot(xs, ys, **GROUP_POINT)
        _text(axes, x, y, text)

    return draw


def _point_row(text: str, marker: str, style: dict[str, Any]) -> KeyRow:
    def draw(axes: Axes, x: float, y: float) -> None:
        axes.plot(x + 0.15, y, marker, **{"mfc": INK, **style})
        _text(axes, x, y, text)

    return draw


def _cell_row(text: str, style: dict[str, Any], hatch: Hatch | None = None) -> KeyRow:
    def draw(axes: Axes, x: float, y: float) -> None:
        shaded_square(axes, x + 0.07, y - 0.08, 0.16, hatch, **style)
        _text(axes, x, y, text)

    return draw


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
