"""The searches of all planners, for small and for large areas.

scipy, numpy and kernels that the interpreter runs search a small area (at most SMALL_CELLS). Kernels compiled
to machine code search a large area (`compilation`). The results are equal bit for bit.

Kernels are plain functions of flat arrays. The arrays have one cell of padding around the area, so every cell
has eight neighbours. The index of a cell is (row + 1) * (cols + 2) + col + 1.
"""

from __future__ import annotations

from collections.abc import Sequence

from swarmctl.core.grid import Cell
from swarmctl.planners.kernels.descent import LENGTH_TIE
from swarmctl.planners.kernels.field import Field, is_small
from swarmctl.planners.kernels.labels import ToGo, label_search
from swarmctl.planners.kernels.large_field import spread_large
from swarmctl.planners.kernels.lattice import Floats
from swarmctl.planners.kernels.small_field import SmallField


def spread(
    exposure: Floats, goals: Sequence[Cell], w: float, psi_per_cell: float, *, into: Field | None = None
) -> Field:
    """Return the field by Eq. 5 for P_s of shape (rows, cols), without checks.

    `into` is an older, unused field. A large field of the same shape is overwritten to save memory.
    """
    if is_small(exposure.size):
        return SmallField(exposure, goals, w, psi_per_cell)
    return spread_large(exposure, goals, w, psi_per_cell, into=into)


__all__ = [
    "LENGTH_TIE",
    "Field",
    "ToGo",
    "is_small",
    "label_search",
    "spread",
]
