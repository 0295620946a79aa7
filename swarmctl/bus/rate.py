"""How fast something may come: a token bucket. Time is an argument."""

from __future__ import annotations


class Pace:
    """`burst` at once, `per_s` in the long run [1/s]."""

    def __init__(self, per_s: float, burst: int) -> None:
        self._per_s = per_s
        self._burst = float(burst)
        self._left = float(burst)
        self._at_s = 0.0

    def takes(self, now_s: float) -> bool:
        """Whether one more may come now; what may not costs nothing."""
        left = self._left
        if left < self._burst:
            left = min(left + (now_s - self._at_s) * self._per_s, self._burst)
        self._at_s = now_s
        if left < 1.0:
            self._left = left
            return False
        self._left = left - 1.0
        return True

    def rested(self, now_s: float) -> bool:
        """Whether nothing has come for so long that a whole burst may."""
        return self._left + (now_s - self._at_s) * self._per_s >= self._burst
