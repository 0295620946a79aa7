"""The error rates of a sensor, and the evidence of its looks at a cell."""

from __future__ import annotations

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.special import xlogy


class SensorModel(msgspec.Struct, frozen=True):
    """The error rates of one look at one cell; looks err independently.

    Raises ValueError unless both rates are in [0, 1) and their sum is below 1. With a sum of 1 a look carries
    no information; with a greater sum a look means the contrary.
    """

    p_miss: float = 0.0
    """probability that a look at a hostile shows no hostile"""
    p_false_alarm: float = 0.0
    """probability that a look at a clear cell shows a hostile"""

    def __post_init__(self) -> None:
        if not (self.p_miss >= 0.0 and self.p_false_alarm >= 0.0 and self.p_miss + self.p_false_alarm < 1.0):
            raise ValueError(
                f"sensor error rates p_miss {self.p_miss} and p_false_alarm {self.p_false_alarm}: expected "
                "two probabilities with a sum below 1, such as 0.1 and 0.02"
            )

    @property
    def is_perfect(self) -> bool:
        """True for the paper's sensor: one look makes a cell certain."""
        return self.p_miss == 0.0 and self.p_false_alarm == 0.0

    def settled(self, looks: int, hits: int) -> bool:
        """Return whether a cell is certain, so that another look would add nothing."""
        return (self.p_miss == 0.0 and looks > hits) or (self.p_false_alarm == 0.0 and hits > 0)

    def log_ratio(self, looks: NDArray[np.integer], hits: NDArray[np.integer]) -> NDArray[np.float64]:
        """Return log of P(these looks | occupied) / P(these looks | clear).

        `hits` of the `looks` at a cell showed a hostile. The result is 0 for cells without a look, and ±∞ for
        certain cells.

        DEVIATION: the paper's perfect sensors never contradict each other. Here a contradictory cell counts
        as occupied.
        """
        misses = looks - hits
        with np.errstate(invalid="ignore"):  # ∞ − ∞ for contradictory looks of a perfect sensor
            ratio = (
                xlogy(hits, 1.0 - self.p_miss)
                + xlogy(misses, self.p_miss)
                - xlogy(hits, self.p_false_alarm)
                - xlogy(misses, 1.0 - self.p_false_alarm)
            )
        return np.asarray(np.where(np.isnan(ratio), np.inf, ratio))


PERFECT = SensorModel()
