"""Inbox from other threads to the event loop: bounded queues, delivered in batches.

Deliveries that arrive together wake the loop once. After an exception in a receiver the loop and other
deliveries continue.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable

from swarmctl.bus.transports.base import Failure

Delivery = Callable[[], None]

TURN_S = 0.02
"""time for deliveries in one turn of the event loop, shared by the queues; links and timers come next"""


class Inbox:
    """Queues by number, each with a size limit; queues with lower numbers are delivered first.

    In each turn each queue has a time slice and at least one delivery, so no queue blocks another.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        limits: tuple[int, ...],
        on_failure: Failure,
        clock: Callable[[], float],
    ) -> None:
        self.dropped = 0
        self.failed = 0
        self._loop = loop
        self._on_failure = on_failure
        self._clock = clock
        self._slice_s = TURN_S / len(limits)
        self._limits = limits
        self._queues: tuple[deque[tuple[str, Delivery]], ...] = tuple(deque() for _ in limits)
        self._is_scheduled = False
        self._is_closed = False

    def enqueue(self, queue: int, key: str, delivery: Delivery) -> bool:
        """Queue a delivery from any thread; return False if the queue is full or the inbox closed."""
        if self._is_closed or len(self._queues[queue]) >= self._limits[queue]:
            self.dropped += 1
            return False
        self._queues[queue].append((key, delivery))
        self._wake()
        return True

    def close(self) -> None:
        """Stop all deliveries; call it on the loop's thread."""
        self._is_closed = True

    def _wake(self) -> None:
        if not self._is_scheduled:
            self._is_scheduled = True
            try:
                self._loop.call_soon_threadsafe(self._deliver)
            except RuntimeError:  # the loop has ended before the bus was closed
                self.dropped += 1

    def _deliver(self) -> None:
        self._is_scheduled = False  # before the queues are read, so that later deliveries wake the loop again
        for queue in self._queues:
            until_s = self._clock() + self._slice_s
            # Deliveries that are added during this turn wait for the next turn.
            for _ in range(len(queue)):
                if self._is_closed:
                    return
                self._run(*queue.popleft())
                if self._clock() >= until_s:
                    break
        if any(self._queues):
            self._wake()

    def _run(self, key: str, delivery: Delivery) -> None:
        try:
            delivery()
        except Exception as error:  # noqa: BLE001 - a bug in one receiver does not affect the others
            self.failed += 1
            self._on_failure(key, error)
