"""The picture of a group's route for the documentation: a wedge that becomes a column in a narrow passage.

`python benchmarks/formation_picture.py` writes docs/images/formation-plan.png and prints the costs.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray
from rich.console import Console
from tables import make_table

from swarmctl.core.belief import CLEAR
from swarmctl.core.exposure import exposure
from swarmctl.core.grid import Grid
from swarmctl.core.threat import FiringStrength
from swarmctl.planners import Problem, dijkstra, formation
from swarmctl.report.foxglove import colour_of
from swarmctl.report.pictures.chart import draw_area
from swarmctl.report.pictures.front import EXPOSED
from swarmctl.report.pictures.scene import MapPicture
from swarmctl.report.pictures.sheet import LEFT_IN, WIDTH_IN, Sheet, save_png
from swarmctl.report.pictures.style import INK, OUTSIDE, QUIET

PICTURE = Path(__file__).parents[1] / "docs" / "images" / "formation-plan.png"
GRID = Grid(21, 40, 25.0, 47.0, 8.0)
WALL_COLS, GAP_ROW = slice(19, 22), 12
WEDGE = ((0.0, 0.0), (-1.5, 1.5), (-1.5, -1.5), (-3.0, 3.0), (-3.0, -3.0))
COLUMN = ((0.0, 0.0), (-1.5, 0.0), (-3.0, 0.0), (-4.5, 0.0), (-6.0, 0.0))
PARAMS = formation.Params((WEDGE, COLUMN), other_shape_cost=0.25, start_heading_deg=90.0, start_shape=0)
SHOWN_EVERY = 6
"""number of steps between the shapes on the map"""


def crossing() -> Problem:
    """Return a field with some threats, and a wall with a passage one cell wide."""
    occupied = np.zeros((GRID.rows, GRID.cols))
    for cell in (
        (7, 10),
        (8, 10),
        (7, 11),
        (16, 9),
        (2, 15),
        (18, 14),
        (7, 28),
        (6, 29),
        (7, 29),
        (3, 33),
        (18, 27),
    ):
        occupied[cell] = 0.8
    field = exposure(occupied, FiringStrength(0.6, 0.3, 0.1))
    gap = field[GAP_ROW, WALL_COLS].copy()
    field[:, WALL_COLS] = np.inf
    field[GAP_ROW, WALL_COLS] = gap
    return Problem(field, (9, 5), ((12, 39),), w=0.8, psi_per_cell=0.13)


def draw(problem: Problem, tracks: NDArray[np.int64], shapes: tuple[int, ...], subtitle: str) -> None:
    """Write the picture: P_s, the members' cells, and the shape every few steps."""
    wide_in = WIDTH_IN - LEFT_IN - 0.3
    high_in = wide_in * GRID.rows / GRID.cols
    sheet = Sheet(high_in + 1.45)
    sheet.write(
        0.12,
        "A wedge of five becomes a column in a narrow passage",
        fontsize=14,
        fontweight="bold",
        color=INK,
    )
    sheet.write(0.42, subtitle, fontsize=9.5, color=QUIET)
    axes = sheet.axes_at(LEFT_IN, 0.75, wide_in, high_in)
    axes.set(xlim=(0.0, GRID.size_east_m), ylim=(0.0, GRID.size_north_m), facecolor=OUTSIDE)
    _draw_field(axes, problem, 72.0 * wide_in / GRID.size_east_m)
    metres = (tracks[..., ::-1] + 0.5) * GRID.cell_size_m
    # The members take their new places first, while the leader stays, and then go one step.
    turned = metres[1:] - np.diff(metres[:, :1], axis=0)
    ways = np.concatenate((metres[:1], np.stack((turned, metres[1:]), axis=1).reshape(-1, *metres.shape[1:])))
    for member, line in enumerate(ways.swapaxes(0, 1)):
        axes.plot(*line.T, color="white", lw=3.2, zorder=5)
        axes.plot(*line.T, color=colour_of(member), lw=1.7, zorder=6, label=_name(member))
    for step in range(0, len(metres), SHOWN_EVERY):
        _draw_shape(axes, metres[step], shapes[step])
    axes.set_xlabel("metres east", fontsize=8.5, color=QUIET)
    axes.set_ylabel("metres north", fontsize=8.5, color=QUIET)
    axes.tick_params(labelsize=8, colors=QUIET, length=3)
    axes.legend(
        loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=5, frameon=False, fontsize=8.5, labelcolor=INK
    )
    save_png(sheet.figure, PICTURE)


def _name(member: int) -> str:
    return "leader" if member == 0 else f"member {member + 1}"


def _draw_field(axes: Axes, problem: Problem, points_per_m: float) -> None:
    known = np.full(problem.exposure.shape, CLEAR, dtype=np.int8)
    walls = frozenset((int(row), int(col)) for row, col in np.argwhere(np.isinf(problem.exposure)))
    draw_area(axes, MapPicture(GRID, frozenset(), known, [], "", no_fly=walls), points_per_m)
    finite = np.where(np.isfinite(problem.exposure), problem.exposure, 0.0)
    axes.imshow(
        finite, origin="lower", extent=(0.0, GRID.size_east_m, 0.0, GRID.size_north_m), cmap=EXPOSED,
        interpolation="nearest", aspect="auto", zorder=1.2,
    )  # fmt: skip


def _draw_shape(axes: Axes, places: NDArray[np.float64], shape: int) -> None:
    """Draw the members' places, joined from wing to wing over the leader, or along the column."""
    order = [3, 1, 0, 2, 4] if shape == 0 else [0, 1, 2, 3, 4]
    axes.plot(*places[order].T, color=INK, lw=1.0, ls=(0, (2, 1.5)), zorder=7)
    for member, place in enumerate(places):
        axes.plot(*place, "o", ms=6.0, mfc=colour_of(member), mec="white", mew=0.9, zorder=8)


def main() -> None:
    problem = crossing()
    route = formation.plan(problem, PARAMS)
    tracks = formation.members_along(problem, route.cells, PARAMS)
    shapes = formation.shapes_along(problem, route.cells, PARAMS)
    alone = dijkstra.plan(problem, dijkstra.Params())
    table = make_table("A group of five", "route", "measure J", "leader's length [cells]", left=["route"])
    table.add_row("formation", f"{route.cost:.2f}", f"{route.length_cells:.1f}")
    table.add_row(
        "the leader alone (dijkstra), times 5", f"{5 * alone.cost:.2f}", f"{alone.length_cells:.1f}"
    )
    of_alone = formation.measure(problem, alone.cells, PARAMS)
    table.add_row("the group on the leader's own route", f"{of_alone:.2f}", f"{alone.length_cells:.1f}")
    Console(width=130).print(table)
    subtitle = (
        f"w = {problem.w:g}; J = {route.cost:.1f}. Grey: P_s. Crosses: no-fly cells. Dots: members every "
    )
    draw(problem, tracks, shapes, subtitle + f"{SHOWN_EVERY} steps of the leader")


if __name__ == "__main__":
    main()
