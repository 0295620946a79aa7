"""What a sensor gets wrong, and what its looks at a cell say about it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import xlogy


@dataclass(frozen=True, slots=True)
class SensorModel:
    """Rates of error of one look at one cell; looks err independently of each other.

    Raises ValueError unless both are in [0, 1) and their sum is below 1: at 1 a look says nothing, above it
    the contrary.
    """

    p_miss: float = 0.0
    """chance that a hostile is not seen"""
    p_false_alarm: float = 0.0
    """chance that one is seen where there is none"""

    def __post_init__(self) -> None:
        if not (self.p_miss >= 0.0 and self.p_false_alarm >= 0.0 and self.p_miss + self.p_false_alarm < 1.0):
            raise ValueError(
                f"a sensor that misses {self.p_miss} and raises false alarms {self.p_false_alarm}: expected "
                "two probabilities whose sum is below 1, such as 0.1 and 0.02; at 1 a look tells nothing"
            )

    @property
    def is_perfect(self) -> bool:
        """The paper's sensor: one look settles a cell."""
        return self.p_miss == 0.0 and self.p_false_alarm == 0.0

    def settled(self, looks: int, hits: int) -> bool:
        """Whether what is known of a cell is certain, so that another look would add nothing."""
        return (self.p_miss == 0.0 and looks > hits) or (self.p_false_alarm == 0.0 and hits > 0)

    def log_ratio(self, looks: NDArray[np.integer], hits: NDArray[np.integer]) -> NDArray[np.float64]:
        """log of P(these looks | occupied) / P(these looks | clear), for cells looked at `looks` times of
        which `hits` showed a hostile: 0 for cells not looked at, ±∞ where it is certain.

        DEVIATION: the paper's perfect sensors never contradict each other. Where some do, occupied wins.
        """
        misses = looks - hits
        with np.errstate(invalid="ignore"):  # ∞ − ∞ where looks contradict each other that cannot
            ratio = (
                xlogy(hits, 1.0 - self.p_miss)
                + xlogy(misses, self.p_miss)
                - xlogy(hits, self.p_false_alarm)
                - xlogy(misses, 1.0 - self.p_false_alarm)
            )
        return np.asarray(np.where(np.isnan(ratio), np.inf, ratio))


PERFECT = SensorModel()
