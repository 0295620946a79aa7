"""Schedule of a UAV's requests for missed observations: one at a time, at limited rates. No I/O."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from swarmctl.bus.node.exchange import NodeOptions

ANSWER_WITHIN_S = 2.0
"""time-out of an answer, in addition to the round trip of the radio model"""


class RequestSchedule:
    """The schedule of one UAV; empty if `sync_every_s` is 0."""

    def __init__(self, options: NodeOptions, rng: np.random.Generator) -> None:
        self._options = options
        self._due: dict[int, float] = {}
        """peer -> earliest time of the next request to this peer [s]"""
        self._pending: tuple[int, float] | None = None
        """receiver of the unanswered request, and end of the wait for the answer [s]"""
        self._next_sync_s = math.inf
        if options.sync_every_s > 0.0:
            self._next_sync_s = options.sync_every_s * (0.5 + 0.5 * float(rng.random()))

    @property
    def is_enabled(self) -> bool:
        return self._options.sync_every_s > 0.0

    def schedule(self, peer: int, now_s: float, not_before_s: float) -> None:
        """Schedule a request to a peer, unless a request is scheduled, after messages that are under way."""
        if self.is_enabled:
            self._due.setdefault(peer, max(now_s + self._options.round_trip_s / 2.0, not_before_s))

    def due(self, now_s: float) -> Iterator[int]:
        """Yield the due peers and remove them from the schedule.

        After `record_request` no peer is yielded until the answer, which may make other requests unnecessary.
        """
        while self._due and not self._is_waiting():
            peer = next((peer for peer, at_s in self._due.items() if at_s <= now_s), None)
            if peer is None:
                return
            del self._due[peer]
            yield peer

    def _is_waiting(self) -> bool:
        return self._pending is not None

    def record_request(self, peer: int, now_s: float) -> None:
        self._pending = peer, now_s + self._options.round_trip_s + ANSWER_WITHIN_S

    def record_answer(self, peer: int) -> None:
        """Record the arrival of an answer's last part."""
        if self._pending is not None and self._pending[0] == peer:
            self._pending = None

    def tick(self, now_s: float) -> bool:
        """Return whether the periodic request is due; end the wait for an answer after its time-out."""
        if self._pending is not None and now_s >= self._pending[1]:
            self._pending = None
        if now_s < self._next_sync_s:
            return False
        self._next_sync_s = now_s + self._options.sync_every_s
        return True

    @property
    def next_deadline_s(self) -> float:
        """Time at which the node must tick again [s]."""
        if self._pending is not None:
            return min(self._next_sync_s, self._pending[1])
        return min(self._next_sync_s, *self._due.values()) if self._due else self._next_sync_s
