"""The firing strength of a hostile, Eq. 1 of the paper."""

from __future__ import annotations

import msgspec
import numpy as np
from numpy.typing import NDArray


class FiringStrength(msgspec.Struct, frozen=True):
    """Hit probabilities on entry into a cell near a hostile.

    `direct`: the hostile's own cell; `first_neighbour`: a cell with a shared edge; `second_neighbour`: a cell
    with only a shared corner.

    Raises ValueError unless 0 ≤ second_neighbour < first_neighbour < direct ≤ 1.
    """

    direct: float
    """fs_o"""
    first_neighbour: float
    """fs_N1"""
    second_neighbour: float
    """fs_N2"""

    def __post_init__(self) -> None:
        if not 0.0 <= self.second_neighbour < self.first_neighbour < self.direct <= 1.0:
            raise ValueError(
                f"firing strengths direct {self.direct}, first neighbour {self.first_neighbour}, "
                f"second neighbour {self.second_neighbour}: expected probabilities in [0, 1] that decrease "
                "strictly with distance, such as 0.6, 0.3, 0.1"
            )

    @property
    def kernel(self) -> NDArray[np.float64]:
        """Eq. 1 as shape (3, 3), the hostile in the middle."""
        fs_o, fs_n1, fs_n2 = self.direct, self.first_neighbour, self.second_neighbour
        return np.array([[fs_n2, fs_n1, fs_n2], [fs_n1, fs_o, fs_n1], [fs_n2, fs_n1, fs_n2]])  # Eq. 1
