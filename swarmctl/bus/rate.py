"""Rate limits: a token bucket. Time is an argument."""

from __future__ import annotations


class TokenBucket:
    """A rate limit: `burst` events at once, `per_s` in the long run [1/s]."""

    def __init__(self, per_s: float, burst: int) -> None:
        self._per_s = per_s
        self._burst = float(burst)
        self._tokens = float(burst)
        self._at_s = 0.0

    def try_take(self, now_s: float) -> bool:
        """Take a token and return True; return False if no token is left."""
        tokens = self._tokens
        if tokens < self._burst:
            tokens = min(tokens + (now_s - self._at_s) * self._per_s, self._burst)
        self._at_s = now_s
        if tokens < 1.0:
            self._tokens = tokens
            return False
        self._tokens = tokens - 1.0
        return True

    def is_full(self, now_s: float) -> bool:
        """Return whether a whole burst is available."""
        return self._tokens + (now_s - self._at_s) * self._per_s >= self._burst
