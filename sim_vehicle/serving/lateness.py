"""How late what was due went out: a histogram, because a mean hides what hurts."""

import math

BIN_S = 0.0005
BINS = 4000  # beyond 2 s everything falls into the last bin


class Lateness:
    """Counts of lateness in bins of half a millisecond; memory does not grow with the run."""

    def __init__(self) -> None:
        self._counts = [0] * BINS
        self.count = 0
        self.worst_s = 0.0

    def add(self, late_s: float, times: int = 1) -> None:
        """`times` things went out `late_s` [s] late; early counts as in time."""
        if times <= 0:
            return
        self._counts[min(int(max(late_s, 0.0) / BIN_S), BINS - 1)] += times
        self.count += times
        self.worst_s = max(self.worst_s, late_s)

    def quantile_s(self, share: float) -> float:
        """The lateness [s] that `share` of all did not exceed, up to half a millisecond too long; or nan."""
        if self.count == 0:
            return math.nan
        left = share * self.count
        for i, count in enumerate(self._counts):
            left -= count
            if left <= 0:
                return min((i + 1) * BIN_S, max(self.worst_s, 0.0)) if i < BINS - 1 else self.worst_s
        return self.worst_s
