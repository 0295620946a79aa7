"""Colours, lines, shadings and the numbered disc, the same on the map and in the legend."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from swarmctl.report.foxglove import colour_of
from swarmctl.report.pictures.scene import MapPicture

Hatch = Literal["level", "upright", "crossed"]
"""lines of a cell: next to a hostile (N1), diagonal to a hostile (N2), no-fly"""
Dashes = tuple[float, tuple[float, ...]]

STRIKE = "#F0E442"
INK, QUIET = "#222222", "#777777"
OUTSIDE, OBSERVED, UNOBSERVED, GRID_LINE = "#F3F1EC", "#FFFFFF", "#E4EBF3", "#D5DBE2"
FOUND, NEVER_FOUND, HATCH = "#7A7A7A", "#BDBDBD", "#9C9C9C"
FORBIDDEN = "#B3261E"
DASHES: tuple[Dashes, ...] = ((0, (4.0, 2.0)), (0, (1.0, 1.4)), (0, (7.0, 1.6, 1.2, 1.6)))
"""dashes of a vehicle's planned lines, in their order, on a map with flown lines; flown lines are solid"""
BANDS = ((5.4, 0.30), (3.2, 0.62), (1.2, 1.0))
"""width [pt] and opacity of planned lines on a map without flown lines; coinciding lines all stay visible"""

GROUP_LINE: dict[str, Any] = {"colors": INK, "linewidths": 1.0}
GROUP_POINT: dict[str, Any] = {"marker": "o", "ls": "none", "ms": 3.4, "mfc": INK, "mec": "white", "mew": 0.5}
"""a group at one time: lines between its members, and a dot for each"""

BADGE_PT = 11.5
"""diameter of the numbered disc of a vehicle with its white rim"""


def flown_widths(n: int) -> list[float]:
    """Return the line widths of n flown tracks [pt].

    The first line is the widest. If several vehicles flew the same track, a part of each line stays visible.
    """
    return [float(width) for width in np.linspace(min(1.5 + 0.5 * n, 3.9), 1.6, n)]


def planned_styles(picture: MapPicture) -> dict[str, dict[str, Any]]:
    """Return the line styles of planned tracks, by label."""
    labels = dict.fromkeys(planned.label for track in picture.tracks for planned in track.planned)
    if any(len(track.flown) for track in picture.tracks):
        return {label: {"ls": DASHES[i % len(DASHES)], "lw": 1.1} for i, label in enumerate(labels)}
    bands = BANDS[-len(labels) :] if labels else ()
    styles = [{"ls": "-", "lw": width, "alpha": alpha} for width, alpha in bands]
    return {label: {**styles[i % len(styles)], "zorder": 6 + i / 10} for i, label in enumerate(labels)}


def hatch_lines(hatch: Hatch, n: int = 4) -> NDArray[np.float64]:
    """Return the lines of a shading in the unit square, (n, 2, 2); `crossed` has two lines."""
    ends, offsets = np.array([0.0, 1.0]), (np.arange(n) + 0.5) / n
    if hatch == "crossed":
        return np.array([[[0.0, 0.0], [1.0, 1.0]], [[0.0, 1.0], [1.0, 0.0]]])
    along, across = np.meshgrid(ends, offsets)
    return np.stack([along, across] if hatch == "level" else [across, along], axis=-1)


def draw_badge(axes: Axes, x: float, y: float, index: int) -> None:
    """Draw the numbered disc of a vehicle."""
    axes.plot(x, y, "o", ms=BADGE_PT - 1.0, mfc=colour_of(index), mec="white", mew=0.9, zorder=10)
    style: dict[str, Any] = {"size": 6.8, "weight": "bold", "color": "white", "ha": "center", "va": "center"}
    axes.text(x, y, str(index + 1), clip_on=True, zorder=11, **style)
