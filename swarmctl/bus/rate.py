"""Rate limits: a token bucket. Time is an argument."""

from __future__ import annotations


class TokenBucket:
    """A rate limit: `burst` events at once, `per_s` in the long run [1/s]."""

    __slots__ = ("_at_s", "_burst", "_tokens", "per_s")

    def __init__(self, per_s: float, burst: int) -> None:
        self.per_s = per_s
        self._burst = float(burst)
        self._tokens = float(burst)
        self._at_s = 0.0

    def try_take(self, now_s: float, n: int = 1) -> bool:
        """Take `n` tokens and return True; return False if fewer are left."""
        tokens = min(self._tokens + (now_s - self._at_s) * self.per_s, self._burst)
        self._at_s = now_s
        is_within = tokens >= n
        self._tokens = tokens - n if is_within else tokens
        return is_within

    def is_full(self, now_s: float) -> bool:
        """Return whether a whole burst is available."""
        return self._tokens + (now_s - self._at_s) * self.per_s >= self._burst
