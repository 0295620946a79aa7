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
        tokens, burst = self._tokens + (now_s - self._at_s) * self.per_s, self._burst
        tokens = burst if tokens > burst else tokens  # each message comes here, and `min` takes longer
        self._at_s = now_s
        if tokens < n:
            self._tokens = tokens
            return False
        self._tokens = tokens - n
        return True
