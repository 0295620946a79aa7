"""A vehicle of the simulator behind a link that takes its time, and loses nothing."""

from __future__ import annotations

import heapq

from flying_bench import FlyingBench


class SlowBench(FlyingBench):
    """Everything arrives `delay_s` after it was sent."""

    delay_s = 0.0

    def _post(self, data: bytes, up: bool) -> None:
        self._n += 1
        heapq.heappush(self._queue, (self.now + self.delay_s, self._n, up, data))
