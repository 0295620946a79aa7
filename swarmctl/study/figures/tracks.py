"""Figure `tracks`: tracks of one world over the true threats, as the paper's Figures 10 to 12."""

from __future__ import annotations

import itertools

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from pydantic import Field

from swarmctl.core.belief import CLEAR, OCCUPIED
from swarmctl.core.grid import Grid
from swarmctl.report.pictures.chart import draw_area, draw_tracks
from swarmctl.report.pictures.scene import MapPicture, VehicleTrack
from swarmctl.report.pictures.style import FOUND, HATCH, INK, OBSERVED, STRIKE
from swarmctl.study.figures.base import Spec, Study, index_of
from swarmctl.study.figures.measures import factor_label, mathtext
from swarmctl.study.figures.panels import words_of
from swarmctl.study.figures.style import SMALL_PT, WIDTH_MM, n_columns_of, page

HEAD_MM = 5.0


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
    cell_mm = WIDTH_MM[spec.width] / n_columns_of(spec.width, len(values)) / (cols + 1.6)
    figure, panels = page(spec.width, len(values), (rows + 0.4) * cell_mm + HEAD_MM)
    for axes, value in zip(panels, values, strict=True):
        level = _level(study, spec, value, seed)
        _draw_map(axes, _picture(study, level, seed), cell_mm / 25.4 * 72)
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


def _picture(study: Study, level: int, seed: int) -> MapPicture:
    """Return the map of one mission, in an area with cells of 1 m."""
    rows, cols = study.area
    grid = Grid(rows, cols, 1.0, 0.0, 0.0)
    tracks, threats = (
        table[(table["seed"] == seed) & (table["level"] == level)]
        for table in (study.tracks, study.hostiles)
        if table is not None
    )
    cells = frozenset(zip(threats["row"].tolist(), threats["col"].tolist(), strict=True))
    known = np.full((rows, cols), CLEAR, dtype=np.int8)
    for cell in cells:
        known[cell] = OCCUPIED
    flown = []
    for uav, own in tracks.sort_values("step").groupby("uav"):
        points = [grid.centre(cell) for cell in zip(own["row"].tolist(), own["col"].tolist(), strict=True)]
        is_hit = own["strikes"] > 0 if "strikes" in own else np.zeros(len(own), dtype=bool)
        strikes = [*itertools.compress(points, is_hit)]
        flown.append(VehicleTrack(str(uav), points[0], (), flown=points, strikes=strikes))
    return MapPicture(grid, cells, known, flown, "")


def _draw_map(axes: Axes, picture: MapPicture, points_per_m: float) -> None:
    draw_area(axes, picture, points_per_m)
    draw_tracks(axes, picture, points_per_m)
    rows, cols = picture.known.shape
    axes.set(xlim=(-0.8, cols + 0.8), ylim=(-0.2, rows + 0.2), aspect="equal", xticks=[], yticks=[])
    for spine in axes.spines.values():
        spine.set_visible(False)


def _draw_key(figure: Figure) -> None:
    """Name the shadings of the paper's Figure 8, and the marks, below the panels."""
    hatches = {"hostile": "", "N1": "------", "N2": "||||||"}
    shadings = [
        Patch(facecolor=FOUND if text == "hostile" else OBSERVED, edgecolor=HATCH, hatch=hatch, lw=0.4)
        for text, hatch in hatches.items()
    ]
    marks = [
        Line2D([], [], marker="*", ls="none", mfc=STRIKE, mec=INK, mew=0.4, ms=6.0),
        Line2D([], [], marker="s", ls="none", mfc=INK, mec="white", mew=0.4, ms=4.0),
    ]
    names = [*hatches, "strike", "goal"]
    figure.legend([*shadings, *marks], names, loc="outside lower left", ncols=len(names), frameon=False)


def caption(_study: Study, spec: Tracks) -> str:
    by = f", by {factor_label(spec.panels)}" if spec.panels else ""
    text = f"Tracks of all vehicles in one world{by}, over the true threats: grey a hostile, "
    text += "horizontal lines N1, vertical lines N2, white no threat. The numbers are the vehicles in the "
    text += "order of their system ids. Headings: mean length and exposure of the vehicles, and their strikes"
    return f"{text}. One world has no interval."
