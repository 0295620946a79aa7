"""From other threads to the event loop: bounded queues, delivered in batches.

Who appends wakes the loop once, however much is appended until it comes to it. A receiver's bug stops neither
the loop nor the other deliveries.
"""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Callable

from swarmctl.bus.transports.base import Failure

Delivery = Callable[[], None]

TURN_S = 0.02
"""of work in one turn of the loop, shared by the queues; what is left waits, so that links and timers are
served whatever comes"""


class Inbox:
    """Queues of so much room each, by number: of several that wait, the first is delivered first.

    Each queue has its share of a turn, and one delivery at least: none keeps the others waiting for ever.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        rooms: tuple[int, ...],
        on_failure: Failure,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        self.dropped = 0
        self.failed = 0
        self._loop = loop
        self._on_failure = on_failure
        self._clock = clock
        self._share_s = TURN_S / len(rooms)
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
            until_s = self._clock() + self._share_s
            # No more than wait now: what a delivery puts is for the next turn.
            for _ in range(len(queue)):
                if self._is_closed:
                    return
                self._hand_over(*queue.popleft())
                if self._clock() >= until_s:
                    break
        if any(self._queues):
            self._wake()

    def _hand_over(self, key: str, delivery: Delivery) -> None:
        try:
            delivery()
        except Exception as error:  # noqa: BLE001 - whatever a receiver raises is its own bug
            self.failed += 1
            self._on_failure(key, error)
