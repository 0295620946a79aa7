"""How fast something may come: a token bucket. Time is an argument."""

from __future__ import annotations


class Pace:
    """`burst` at once, `per_s` in the long run [1/s]."""

    def __init__(self, per_s: float, burst: int) -> None:
        self._per_s = per_s
        self._burst = burst
        self._left = float(burst)
        self._at_s: float | None = None

    def rested(self, now_s: float) -> bool:
        """Whether nothing has come for so long that a whole burst may."""
        self._fill(now_s)
        return self._left >= self._burst

    def takes(self, now_s: float) -> bool:
        """Whether one more may come now; what may not costs nothing."""
        self._fill(now_s)
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True

    def _fill(self, now_s: float) -> None:
        elapsed_s = 0.0 if self._at_s is None else now_s - self._at_s
        self._left = min(self._left + elapsed_s * self._per_s, float(self._burst))
        self._at_s = now_s
