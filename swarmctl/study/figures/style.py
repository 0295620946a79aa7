"""Sizes, colours and files of the figures: for print, at the width of one or two columns."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import LinearSegmentedColormap, to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

from swarmctl.report.foxglove import colour_of
from swarmctl.report.pictures.style import GRID_LINE, INK, QUIET
from swarmctl.study.figures.measures import is_share, mathtext

WIDTH_MM = {"one": 88.0, "two": 180.0}
PANEL_MM = 52.0
"""height of a panel"""
DPI = 300
SMALL_PT, TEXT_PT = 7.0, 7.5
LETTER_MM = 1.55
"""mean width of a letter of a heading"""
ORDERED = LinearSegmentedColormap.from_list("ordered", ("#E69F00", "#CC5A1E", "#8A2D6B", "#1B2A6B"))
"""colours of values in order; the brightness falls along the map, so grey prints keep the order"""
HEADING = "heading"
"""label of the headings, by which `fit` finds them"""
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "p")
RC: Any = {
    "font.family": "DejaVu Sans",
    "font.size": SMALL_PT,
    "axes.titlesize": TEXT_PT,
    "axes.titlelocation": "left",
    "axes.titlepad": 5.0,
    "axes.labelsize": TEXT_PT,
    "axes.labelcolor": INK,
    "axes.edgecolor": QUIET,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "grid.color": GRID_LINE,
    "grid.linewidth": 0.4,
    "xtick.labelsize": SMALL_PT,
    "ytick.labelsize": SMALL_PT,
    "xtick.color": QUIET,
    "ytick.color": QUIET,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "xtick.minor.size": 1.5,
    "lines.linewidth": 1.2,
    "lines.markersize": 3.6,
    "text.color": INK,
    "mathtext.fontset": "dejavusans",
    "mathtext.default": "regular",
    "pdf.fonttype": 42,
    "svg.fonttype": "path",
    "svg.hashsalt": "swarmctl",
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
}


@contextmanager
def print_style() -> Iterator[None]:
    """Set matplotlib's defaults for drawing and saving a figure."""
    with mpl.rc_context(RC):
        yield


def n_columns_of(width: str, n_panels: int, most_columns: int = 3) -> int:
    """Return the number of columns of the panels of a page."""
    if width == "one":
        return 1 if n_panels <= 3 else 2
    if n_panels == most_columns + 1 and n_panels % most_columns:
        return (n_panels + 1) // 2
    return min(n_panels, most_columns)


def page(
    width: str, n_panels: int, panel_mm: float = PANEL_MM, most_columns: int = 3
) -> tuple[Figure, list[Axes]]:
    """Return a figure of the width of a column, or two, with panels in a grid that reads by rows."""
    n_columns = n_columns_of(width, n_panels, most_columns)
    n_rows = -(-n_panels // n_columns)
    size = (WIDTH_MM[width] / 25.4, (n_rows * panel_mm + 2.0) / 25.4)
    figure = Figure(figsize=size, layout="constrained")
    figure.set_layout_engine("constrained", w_pad=2.5 / 72, h_pad=3.0 / 72, wspace=0.03, hspace=0.03)
    panels = [figure.add_subplot(n_rows, n_columns, index + 1) for index in range(n_panels)]
    return figure, panels


def columns_of(axes: Axes) -> tuple[int, int]:
    """Return the column of a panel and the number of columns of its page."""
    spec = axes.get_subplotspec()
    assert spec is not None
    return spec.colspan.start, spec.get_gridspec().ncols


def colours(values: Sequence[object]) -> list[str]:
    """Return a colour for each value: in order for numbers, else distinct."""
    n = len(values)
    is_ordered = n > 1 and sum(isinstance(value, int | float | np.number) for value in values) >= n - 1
    if n > 2 and (is_ordered or n > 7):
        return [to_hex(ORDERED(k / (n - 1))) for k in range(n)]
    return [colour_of(k) for k in range(n)]


def dark(colour: str) -> str:
    """Return the colour, darker if letters in it would be too pale on white."""
    rgb = np.array(to_rgb(colour))
    brightness = float(rgb @ (0.2126, 0.7152, 0.0722))
    return to_hex(tuple((rgb * min(1.0, 0.42 / brightness)).tolist())) if brightness > 0 else colour


def heading(axes: Axes, text: str) -> None:
    """Write the words of the vertical axis above it, where they need no turned head."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    width_mm = figure.get_size_inches()[0] * 25.4 / columns_of(axes)[1] - 9.0
    lines = textwrap.wrap(text, max(int(width_mm / LETTER_MM), 12))
    axes.set_title(mathtext("\n".join(lines)), color=INK).set_label(HEADING)


def fit(figure: Figure) -> None:
    """Give each panel room by its laid-out place: shorter lines of a heading, fewer numbers on the axis.

    Names of rows make panels narrower than `heading` expects.
    """
    figure.draw_without_rendering()
    page_right = figure.get_window_extent().x1
    for axes in figure.axes:
        rights = [other.get_window_extent().x0 for other in figure.axes if _is_right_of(axes, other)]
        for title in axes.findobj(lambda artist: artist.get_label() == HEADING):
            assert isinstance(title, Text)
            place = title.get_window_extent()
            room = min([page_right, *rights]) - place.x0 - 0.6 * TEXT_PT * figure.dpi / 72
            if place.width > room:
                lines = title.get_text().split("\n")
                most = max(map(len, lines)) * room / place.width
                title.set_text("\n".join(textwrap.wrap(" ".join(lines), int(most), break_long_words=False)))
        boxes = [tick.label1.get_window_extent() for tick in axes.xaxis.get_major_ticks()]
        if any(left.x1 + 0.5 * left.height > right.x0 for left, right in pairwise(boxes)):
            axes.xaxis.set_major_locator(MaxNLocator(3, steps=[1, 2, 2.5, 5, 10]))


def _is_right_of(axes: Axes, other: Axes) -> bool:
    here, there = axes.get_subplotspec(), other.get_subplotspec()
    assert here is not None
    assert there is not None
    return there.rowspan == here.rowspan and there.colspan.start > here.colspan.start


def set_scale(axes: Axes, scale: str, values: Sequence[object]) -> None:
    """Set the scale and the labels of a horizontal axis of numbers; an axis of names stays as it is."""
    if is_numeric(values):
        numbers = sorted(float(value) for value in values)  # type: ignore[arg-type]
        if scale == "log":
            set_log(axes)
        elif all(number.is_integer() for number in numbers):
            axes.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10], integer=True))
        gaps = np.diff(np.log(numbers) if scale == "log" else numbers)
        if len(numbers) <= 7 and (gaps >= 0.08 * gaps.sum()).all():
            axes.set_xticks(numbers, [f"{number:g}" for number in numbers])
            axes.set_xticks([], minor=True)


def set_log(axes: Axes) -> None:
    """Make the horizontal axis logarithmic, with numbers at 1, 2 and 5 of each decade."""
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())


def is_numeric(values: Sequence[object]) -> bool:
    return all(isinstance(value, int | float | np.number) and not isinstance(value, bool) for value in values)


def set_unit(axis: Axis, name: str) -> None:
    """Write the numbers of an axis in per cent if its measure or factor is a share."""
    if is_share(name):
        axis.set_major_formatter(lambda value, _: f"{100 * value:.6g} %")


def from_zero(axes: Axes, low: float, high: float) -> None:
    """Set vertical limits around values; values near zero get an axis that begins there."""
    if not np.isfinite(low + high):
        return
    spare = 0.06 * (high - low) or 0.05 * abs(high) or 0.5
    begins = 0.0 if 0.0 <= low < 0.4 * high or (low == 0.0 == high) else low - spare
    axes.set_ylim(begins, high + spare)


def files(figure: Figure, folder: Path, name: str) -> None:
    """Write NAME.png and NAME.pdf; equal figures give equal bytes."""
    figure.savefig(folder / f"{name}.png", dpi=DPI, metadata={"Software": None})
    figure.savefig(folder / f"{name}.pdf", metadata={"CreationDate": None, "Creator": "swarmctl"})


def svg(figure: Figure) -> bytes:
    """Return the figure as SVG, its letters as outlines."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": "swarmctl"})
    return buffer.getvalue()
