"""The rate limit of long answers, such as files and logs."""

import math

BYTES_S = 200_000  # default rate [bytes/s]
MAX_BYTES_AT_ONCE = 40_000


class Pacer:
    """A token bucket, full at the start: fills at `bytes_s` [bytes/s] up to `max_bytes`."""

    def __init__(self, bytes_s: float = BYTES_S, max_bytes: float = MAX_BYTES_AT_ONCE) -> None:
        self._bytes_s, self._max_bytes = bytes_s, max_bytes
        self._bytes = max_bytes
        self._filled_s = -math.inf

    def take(self, size: int, now: float) -> bool:
        """Take `size` bytes at `now` [s]; return False and take none if the bytes must wait."""
        if now > self._filled_s:
            self._bytes = min(self._bytes + (now - self._filled_s) * self._bytes_s, self._max_bytes)
            self._filled_s = now
        if self._bytes < min(size, self._max_bytes):
            return False
        self._bytes -= size
        return True
