"""The pace of long answers, so that a slow link is not flooded."""

import math

BYTES_S = 200_000
MOST_BYTES_AT_ONCE = 40_000


class Pacer:
    """A token bucket that fills at `bytes_s` [bytes/s] up to `most_bytes`; full at the start."""

    def __init__(self, bytes_s: float = BYTES_S, most_bytes: float = MOST_BYTES_AT_ONCE) -> None:
        self._bytes_s, self._most = bytes_s, most_bytes
        self._bytes = most_bytes
        self._filled_s = -math.inf

    def take(self, size: int, now: float) -> bool:
        """Take `size` bytes at `now` [s]; return False if the bytes must wait."""
        if now > self._filled_s:
            self._bytes = min(self._bytes + (now - self._filled_s) * self._bytes_s, self._most)
            self._filled_s = now
        if self._bytes < min(size, self._most):
            return False
        self._bytes -= size
        return True
