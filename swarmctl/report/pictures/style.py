"""Colours, lines and the numbered disc, alike on the map and in its key."""

from __future__ import annotations

from typing import Any

from matplotlib.axes import Axes

from swarmctl.report.pictures.scene import MapPicture

Dashes = tuple[float, tuple[float, ...]]

# Okabe and Ito's colours, which people with any colour vision tell apart; their yellow marks the strikes.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#5B4A8A")
STRIKE = "#F0E442"
INK, QUIET = "#222222", "#777777"
OUTSIDE, SEEN, VEIL, GRID_LINE = "#F3F1EC", "#FFFFFF", "#E4EBF3", "#D5DBE2"
FOUND, NEVER_FOUND, HATCH = "#7A7A7A", "#BDBDBD", "#9C9C9C"
FORBIDDEN = "#B3261E"
DASHES: tuple[Dashes, ...] = ((0, (4.0, 2.0)), (0, (1.0, 1.4)), (0, (7.0, 1.6, 1.2, 1.6)))
"""for the planned lines of a vehicle, in their order, beside flown ones, which are solid"""
BANDS = ((5.4, 0.30), (3.2, 0.62), (1.2, 1.0))
"""for the planned lines where nothing was flown: width [pt] and strength of the colour. One over the other
they stay visible where they coincide."""

BADGE_PT = 11.5
"""diameter of the numbered disc of a vehicle with its white rim"""


def colour_of(index: int) -> str:
    return COLOURS[index % len(COLOURS)]


def planned_styles(picture: MapPicture) -> dict[str, dict[str, Any]]:
    """How a planned line is drawn, by its label."""
    labels = dict.fromkeys(planned.label for track in picture.tracks for planned in track.planned)
    if any(len(track.flown) for track in picture.tracks):
        return {label: {"ls": DASHES[i % len(DASHES)], "lw": 1.1} for i, label in enumerate(labels)}
    bands = BANDS[-len(labels) :] if labels else ()
    styles = [{"ls": "-", "lw": width, "alpha": alpha} for width, alpha in bands]
    return {label: {**styles[i % len(styles)], "zorder": 6 + i / 10} for i, label in enumerate(labels)}


def draw_badge(axes: Axes, x: float, y: float, index: int) -> None:
    """The numbered disc that stands for a vehicle."""
    axes.plot(x, y, "o", ms=BADGE_PT - 1.0, mfc=colour_of(index), mec="white", mew=0.9, zorder=10)
    style: dict[str, Any] = {"size": 6.8, "weight": "bold", "color": "white", "ha": "center", "va": "center"}
    axes.text(x, y, str(index + 1), clip_on=True, zorder=11, **style)
