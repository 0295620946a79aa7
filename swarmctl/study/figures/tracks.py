"""Figure `tracks`: tracks of one world over the true threats, as the paper's Figures 10 to 12."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from pydantic import Field

from swarmctl.core.belief import CLEAR, OCCUPIED
from swarmctl.core.grid import Grid
from swarmctl.report.foxglove import colour_of
from swarmctl.report.pictures.chart import draw_area
from swarmctl.report.pictures.scene import MapPicture
from swarmctl.report.pictures.style import FOUND, HATCH, INK, STRIKE, Hatch, shaded_square
from swarmctl.study.figures.base import Spec, Study, index_of
from swarmctl.study.figures.measures import factor_label, mathtext
from swarmctl.study.figures.panels import words_of
from swarmctl.study.figures.style import SMALL_PT, WIDTH_MM, dark, page

KEY_MM, HEAD_MM = 6.0, 5.0


class Tracks(Spec):
    seed: int | None = Field(None, ge=0, description="World that is drawn. Default: the first one kept.")


def draw(study: Study, spec: Tracks) -> Figure:
    tracks, hostiles = study.tracks, study.hostiles
    if tracks is None or hostiles is None or tracks.empty:
        text = (
            "the results have no tracks; name seeds in `tracks:` of the experiment and run it in a new folder"
        )
        raise ValueError(text)
    seed = int(tracks["seed"].min()) if spec.seed is None else spec.seed
    if not (tracks["seed"] == seed).any():
        raise ValueError(f"the results have no tracks of seed {seed}; name it in `tracks:` of the experiment")
    rows, cols = study.area
    values = study.shown(spec, spec.panels)
    n_columns = min(len(values), 3 if spec.width == "two" else 1 if len(values) < 2 else 2)
    panel_mm = (WIDTH_MM[spec.width] - 2.0 * (n_columns + 1)) / n_columns * rows / cols + HEAD_MM
    figure, panels = page(spec.width, len(values), panel_mm, most_columns=3)
    figure.set_layout_engine("none")
    _arrange(figure, panels, n_columns, panel_mm)
    width_pt = panels[0].get_position().width * figure.get_size_inches()[0] * 72
    for axes, value in zip(panels, values, strict=True):
        level = _level(study, spec, value, seed)
        threats = hostiles[(hostiles["seed"] == seed) & (hostiles["level"] == level)]
        _draw_threats(axes, rows, cols, threats, width_pt / (cols + 1.6))
        _draw_tracks(axes, tracks[(tracks["seed"] == seed) & (tracks["level"] == level)])
        flown = study.table[(study.table["seed"] == seed) & (study.table["level"] == level)]
        about = f"{flown['length_cells'].mean():.1f} cells, ΣP_s {flown['exposure_sum'].mean():.2f}"
        n = int(flown["strikes"].sum())
        text = words_of(spec, value, f"{about}, {n} strike{'' if n == 1 else 's'}")
        axes.set_title(mathtext(text), pad=1.5, fontsize=SMALL_PT)
    _draw_key(figure)
    return figure


def _level(study: Study, spec: Tracks, value: object, seed: int) -> int:
    rows = study.table[study.table["seed"] == seed]
    chosen, _ = study.groups(spec, (), rows)
    is_here = chosen >= 0
    if spec.panels is not None:
        is_here &= study.codes(spec.panels, rows) == index_of(study.values(spec.panels), value)
    levels = rows["level"].to_numpy()[is_here]
    if not levels.size:
        raise ValueError(f"the results have no mission of seed {seed} at this level")
    return int(levels[0])


def _arrange(figure: Figure, panels: list[Axes], n_columns: int, panel_mm: float) -> None:
    """Place the panels by hand: squares that share the width, above the strip of the key."""
    width_mm, n_rows = figure.get_size_inches()[0] * 25.4, -(-len(panels) // n_columns)
    height_mm = n_rows * panel_mm + KEY_MM
    figure.set_size_inches(width_mm / 25.4, height_mm / 25.4)
    each_mm = (width_mm - 2.0 * (n_columns + 1)) / n_columns
    for index, axes in enumerate(panels):
        row, column = divmod(index, n_columns)
        left, bottom = 2.0 + column * (each_mm + 2.0), KEY_MM + (n_rows - 1 - row) * panel_mm + 0.5
        size = (each_mm / width_mm, (panel_mm - HEAD_MM) / height_mm)
        axes.set_position((left / width_mm, bottom / height_mm, *size))


def _draw_threats(axes: Axes, rows: int, cols: int, threats: pd.DataFrame, cell_pt: float) -> None:
    grid = Grid(rows, cols, 1.0, 0.0, 0.0)
    cells = frozenset(zip(threats["row"].tolist(), threats["col"].tolist(), strict=True))
    known = np.full((rows, cols), CLEAR, dtype=np.int8)
    for cell in cells:
        known[cell] = OCCUPIED
    draw_area(axes, MapPicture(grid, cells, known, (), ""), cell_pt)
    axes.set(xlim=(-0.8, cols + 0.8), ylim=(-0.2, rows + 0.2), aspect="equal", xticks=[], yticks=[])
    for spine in axes.spines.values():
        spine.set_visible(False)


def _draw_tracks(axes: Axes, tracks: pd.DataFrame) -> None:
    names = sorted(tracks["uav"].unique().tolist())
    widths = np.linspace(min(1.1 + 0.3 * len(names), 2.6), 1.1, len(names))
    for index, (uav, width) in enumerate(zip(names, widths.tolist(), strict=True)):
        own = tracks[tracks["uav"] == uav].sort_values("step")
        x, y = own["col"].to_numpy() + 0.5, own["row"].to_numpy() + 0.5
        colour = colour_of(index)
        axes.plot(x, y, color="white", lw=width + 1.2, alpha=0.9, zorder=6.5, solid_capstyle="round")
        axes.plot(x, y, color=colour, lw=width, solid_joinstyle="round", solid_capstyle="round", zorder=7)
        axes.plot(x[-1], y[-1], "s", ms=3.2, mfc=colour, mec="white", mew=0.5, zorder=8)
        axes.text(
            -0.25,
            y[0],
            str(int(uav)),
            color=dark(colour),
            ha="right",
            va="center",
            weight="bold",
            fontsize=6.5,
        )
        if "strikes" in own:
            hit = own["strikes"].to_numpy() > 0
            axes.plot(x[hit], y[hit], "*", ms=5.0, mfc=STRIKE, mec=INK, mew=0.4, ls="none", zorder=9)


def _draw_key(figure: Figure) -> None:
    """Draw the strip below: the shadings of the paper's Figure 8, and the marks."""
    width_mm, height_mm = (size * 25.4 for size in figure.get_size_inches())
    axes = figure.add_axes((0.0, 0.0, 1.0, KEY_MM / height_mm))
    axes.set(xlim=(0, width_mm), ylim=(0, KEY_MM))
    axes.axis("off")
    x, size, middle = 3.0, 2.8, KEY_MM / 2
    shadings: dict[str, Hatch | None] = {"hostile": None, "N1": "level", "N2": "upright"}
    marks: dict[str, dict[str, Any]] = {
        "strike": {"marker": "*", "mfc": STRIKE, "mec": INK, "ms": 5.0},
        "goal": {"marker": "s", "mfc": INK, "mec": "white", "ms": 3.6},
    }
    for text in (*shadings, *marks):
        if text in marks:
            axes.plot(x + size / 2, middle, mew=0.4, **marks[text])
        else:
            style = {"facecolor": FOUND} if text == "hostile" else {}
            shaded_square(axes, x, middle - size / 2, size, shadings[text], edgecolor=HATCH, lw=0.4, **style)
        axes.text(x + size + 1.0, middle, text, va="center", fontsize=6.5)
        x += size + 4.5 + 1.35 * len(text)


def caption(_study: Study, spec: Tracks) -> str:
    by = f", by {factor_label(spec.panels)}" if spec.panels else ""
    text = f"Tracks of all vehicles in one world{by}, over the true threats: grey a hostile, "
    text += "horizontal lines N1, vertical lines N2, white no threat. The number at the left is the vehicle. "
    text += "Headings: mean length and exposure of the vehicles, and their strikes"
    return f"{text}. One world has no interval."
