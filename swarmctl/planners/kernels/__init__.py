"""All compiled code of the planners.

The compiled functions release the interpreter lock and are cached on disk. They see flat arrays of the area
with one cell of padding around it, so that every cell has eight neighbours and no bounds need checking; index
(row + 1) * (cols + 2) + col + 1.
"""

from swarmctl.planners.kernels.bounds import warm_up_bounds
from swarmctl.planners.kernels.descent import LENGTH_TIE, REL_TIE
from swarmctl.planners.kernels.field import Field, compilable, extent, spread, warm_up
from swarmctl.planners.kernels.labels import Found, ToGo, label_search, warm_up_labels

__all__ = [
    "LENGTH_TIE",
    "REL_TIE",
    "Field",
    "Found",
    "ToGo",
    "compilable",
    "extent",
    "label_search",
    "spread",
    "warm_up",
    "warm_up_bounds",
    "warm_up_labels",
]
