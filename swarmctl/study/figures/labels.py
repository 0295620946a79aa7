"""Direct labels: beside the ends of lines, and beside points, without collisions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import msgspec
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.text import Annotation

from swarmctl.study.figures.measures import mathtext
from swarmctl.study.figures.style import SMALL_PT, dark
from swarmctl.study.statistics import Floats

HALO = withStroke(linewidth=1.8, foreground="white")
LINE_PT = 1.22 * SMALL_PT
"""least distance of two labels above each other"""
GAP_PT = 5.0
REACH_PT = 9.0
"""distance of labels from the right edge of a panel"""


class Label(msgspec.Struct, frozen=True):
    """A text at a point in data coordinates."""

    x: float
    y: float
    text: str
    colour: str


@dataclass(slots=True)
class Labels:
    """Labels of a figure; `place` moves them when the layout is known."""

    ends: dict[Axes, list[tuple[Label, Annotation]]] = field(default_factory=dict)
    points: dict[Axes, list[Label]] = field(default_factory=dict)
    obstacles: dict[Axes, list[Floats]] = field(default_factory=dict)

    def add_end(self, axes: Axes, label: Label) -> None:
        """Add a label right of the panel, beside the end of its line."""
        text = axes.annotate(
            mathtext(label.text), (1.0, label.y), (REACH_PT, 0), xycoords=axes.get_yaxis_transform(),
            textcoords="offset points", color=dark(label.colour), va="center", ha="left",
            annotation_clip=False,
        )  # fmt: skip
        self.ends.setdefault(axes, []).append((label, text))

    def add_point(self, axes: Axes, label: Label) -> None:
        """Add a label beside a point inside the panel, where it covers least."""
        self.points.setdefault(axes, []).append(label)

    def avoid(self, axes: Axes, x: Sequence[float] | Floats, y: Sequence[float] | Floats) -> None:
        """Add a curve that labels of points shall not cover."""
        curve = np.stack([np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)], axis=1)
        self.obstacles.setdefault(axes, []).append(curve[np.isfinite(curve).all(axis=1)])

    def place(self, figure: Figure) -> None:
        """Compute the layout, keep it, and move the labels apart."""
        figure.draw_without_rendering()
        figure.set_layout_engine("none")
        for axes, ends in self.ends.items():
            _spread_ends(axes, ends, 72.0 / figure.dpi)
        for axes, labels in self.points.items():
            _place_points(axes, labels, self.obstacles.get(axes, []), 72.0 / figure.dpi)


def _spread_ends(axes: Axes, ends: list[tuple[Label, Annotation]], pt: float) -> None:
    """Move the labels up and down, and draw a thin line from each end to its label."""
    box = axes.bbox
    at = np.array([axes.transData.transform((label.x, label.y)) * pt for label, _ in ends])
    heights = spread(at[:, 1], LINE_PT, box.y0 * pt - 3.0, box.y1 * pt + 3.0)
    right = box.x1 * pt
    for (label, text), (x, y), height in zip(ends, at, heights.tolist(), strict=True):
        text.set_position((REACH_PT, height - y))
        reach = right - x + REACH_PT
        if abs(height - y) > 1.0 or reach > REACH_PT + 9:
            line = {
                "arrowstyle": "-",
                "color": label.colour,
                "lw": 0.5,
                "alpha": 0.8,
                "ls": ":" if right > x + 12 else "-",
                "shrinkA": 0,
                "shrinkB": 0,
            }
            axes.annotate(
                "", (label.x, label.y), (reach - 1.5, height - y), textcoords="offset points",
                arrowprops=line, annotation_clip=False,
            )  # fmt: skip


def spread(wanted: Floats, least: float, low: float, high: float) -> Floats:
    """Return positions near `wanted` with distances of `least` or more, if they fit between the limits."""
    order = np.argsort(wanted, kind="stable")
    # Labels that touch form a block, and a block lies at the mean of the places that its labels want.
    blocks: list[list[float]] = []
    for place in np.clip(wanted[order], low, high).tolist():
        blocks.append([place, 1.0])
        while len(blocks) > 1 and _begin(blocks[-1], least) < _end(blocks[-2], least) + least:
            (b, n), (a, m) = blocks.pop(), blocks.pop()
            blocks.append([(a * m + b * n) / (m + n), m + n])
            middle, size = blocks[-1]
            half = (size - 1) / 2 * least
            blocks[-1][0] = min(max(middle, low + half), max(high - half, low + half))
    placed = np.concatenate([_begin(block, least) + least * np.arange(int(block[1])) for block in blocks])
    result = np.empty_like(placed)
    result[order] = placed
    return result


def _begin(block: list[float], least: float) -> float:
    return block[0] - (block[1] - 1) / 2 * least


def _end(block: list[float], least: float) -> float:
    return block[0] + (block[1] - 1) / 2 * least


def _place_points(axes: Axes, labels: list[Label], curves: list[Floats], pt: float) -> None:
    """Write each label at the candidate place that covers the fewest lines and labels."""
    transform, box = axes.transData, axes.bbox
    blocked = [_dense(transform.transform(curve) * pt) for curve in curves if len(curve)]
    points = np.concatenate(blocked) if blocked else np.empty((0, 2))
    taken: list[tuple[float, float, float, float]] = []
    for label in labels:
        x, y = transform.transform((label.x, label.y)) * pt
        width, height = 0.6 * SMALL_PT * len(label.text), SMALL_PT
        best = None
        for turn, (side, up) in enumerate(_NEAR + _FAR):
            left = x + side * GAP_PT - (width if side < 0 else width / 2 if side == 0 else 0.0)
            bottom = y + up * GAP_PT - height / 2 + up * height / 2
            area = (left - 1, bottom - 1, left + width + 1, bottom + height + 1)
            covered = _inside(points, area)
            hidden = sum(_overlap(area, other) for other in taken)
            outside = area[2] > box.x1 * pt + 2 or area[0] < box.x0 * pt or area[1] < box.y0 * pt
            outside = outside or area[3] > box.y1 * pt + 2
            cost = (covered + 200 * hidden + 400 * outside, turn)
            if best is None or cost < best[0]:
                best = (cost, left, bottom, area)
        assert best is not None
        taken.append(best[3])
        if best[0][1] >= len(_NEAR):
            begin = (0.0 if best[1] > x else width, height / 2)
            axes.annotate(
                "", (label.x, label.y), (best[1] + begin[0] - x, best[2] + begin[1] - y),
                textcoords="offset points", annotation_clip=False, zorder=7,
                arrowprops={"arrowstyle": "-", "color": label.colour, "lw": 0.5, "shrinkA": 0, "shrinkB": 2},
            )  # fmt: skip
        axes.annotate(
            mathtext(label.text), (label.x, label.y), (best[1] - x, best[2] - y), textcoords="offset points",
            color=dark(label.colour), ha="left", va="bottom", path_effects=[HALO], annotation_clip=False,
            zorder=8,
        )  # fmt: skip


_NEAR = ((1, 0), (-1, 0), (1, 0.7), (-1, 0.7), (1, -0.7), (-1, -0.7), (0, 1), (0, -1))
_FAR = (
    (1, 1.8), (-1, -1.8), (1, -1.8), (-1, 1.8),
    (1, 3.2), (-1, -3.2), (1, -3.2), (-1, 3.2), (1, 4.6), (-1, -4.6),
)  # fmt: skip
"""places for labels of points that lie close together; a thin line leads from the point to the label"""


def _dense(curve: Floats) -> Floats:
    """Return points of a curve, at most about 1 pt apart."""
    parts = [curve[:1]]
    for a, b in pairwise(curve):
        n = int(np.clip(np.hypot(*(b - a)), 1, 2000))
        parts.append(a + (b - a) * (np.arange(1, n + 1) / n)[:, None])
    return np.concatenate(parts)


def _inside(points: Floats, area: tuple[float, float, float, float]) -> int:
    x, y = points[:, 0], points[:, 1]
    return int(((x > area[0]) & (x < area[2]) & (y > area[1]) & (y < area[3])).sum())


def _overlap(a: tuple[float, float, float, float], b: tuple[float, float, float, float]) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]
