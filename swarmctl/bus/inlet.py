"""From other threads to the event loop: bounded queues, delivered in batches.

Who appends wakes the loop once, however much is appended until it comes to it. A receiver's bug stops neither
the loop nor the other deliveries.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable

from swarmctl.bus.base import Failure

Delivery = Callable[[], None]

BATCH = 512
"""of each queue, delivered in one turn of the loop; what is left waits, so that timers are on time"""


class Inlet:
    """Queues of so much room each, by number: of several that wait, the first is delivered first."""

    def __init__(self, loop: asyncio.AbstractEventLoop, rooms: tuple[int, ...], on_failure: Failure) -> None:
        self.dropped = 0
        self.failed = 0
        self._loop = loop
        self._on_failure = on_failure
        self._rooms = rooms
        self._queues: tuple[deque[tuple[str, Delivery]], ...] = tuple(deque() for _ in rooms)
        self._is_woken = False
        self._is_closed = False

    def take(self, queue: int, key: str, delivery: Delivery) -> bool:
        """Deliver on the loop, from any thread; False where there is no room, or nobody any more."""
        if self._is_closed or len(self._queues[queue]) >= self._rooms[queue]:
            self.dropped += 1
            return False
        self._queues[queue].append((key, delivery))
        self._wake()
        return True

    def close(self) -> None:
        """Nothing is delivered any more, on the loop's thread."""
        self._is_closed = True

    def _wake(self) -> None:
        if not self._is_woken:
            self._is_woken = True
            try:
                self._loop.call_soon_threadsafe(self._deliver)
            except RuntimeError:  # the loop has ended before the bus was closed
                self.dropped += 1

    def _deliver(self) -> None:
        # Before looking: what is appended from here on wakes the loop again.
        self._is_woken = False
        for queue in self._queues:
            for _ in range(min(len(queue), BATCH)):
                key, delivery = queue.popleft()
                if self._is_closed:
                    return
                try:
                    delivery()
                except Exception as error:  # noqa: BLE001 - whatever a receiver raises is its own bug
                    self.failed += 1
                    self._on_failure(key, error)
        if any(self._queues):
            self._wake()
