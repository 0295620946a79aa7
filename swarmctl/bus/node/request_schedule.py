"""Schedule of a UAV's requests for missed observations: one at a time, at limited rates. No I/O."""

from __future__ import annotations

import math

import numpy as np

from swarmctl.bus.node.exchange import NodeOptions

ANSWER_WITHIN_S = 2.0
"""time-out of an answer, in addition to the round trip of the radio model"""
MIN_REQUEST_PAUSE_S = 1.0
MAX_REQUEST_PAUSE_S = 8.0
"""first and longest pause between requests to a peer; each request doubles the pause, news resets it"""


class RequestSchedule:
    """The schedule of one UAV; empty if `sync_every_s` is 0."""

    def __init__(self, options: NodeOptions, rng: np.random.Generator) -> None:
        self._options = options
        self._due: dict[int, float] = {}
        """peer -> earliest time of the next request to this peer [s]"""
        self._not_before_s: dict[int, float] = {}
        """peer -> end of the pause after the last request to this peer [s]"""
        self._pause_s: dict[int, float] = {}
        """peer -> length of the pause after the next request to this peer [s]"""
        self._pending: tuple[int, float] | None = None
        """receiver of the unanswered request, and end of the wait for the answer [s]"""
        self._next_sync_s = math.inf
        if options.sync_every_s > 0.0:
            self._next_sync_s = options.sync_every_s * (0.5 + 0.5 * float(rng.random()))

    @property
    def is_enabled(self) -> bool:
        return self._options.sync_every_s > 0.0

    def schedule(self, peer: int, now_s: float) -> None:
        """Schedule a request to a peer, unless a request is scheduled, after messages that are under way."""
        if self.is_enabled and peer not in self._due:
            at_s = now_s + self._options.round_trip_s / 2.0
            self._due[peer] = max(at_s, self._not_before_s.get(peer, -math.inf))

    def pop_due(self, now_s: float) -> int | None:
        """Remove and return a due peer; None if no peer is due.

        After `record_request` the result is None until the answer, which may make other requests unnecessary.
        """
        if not self._due or self._pending is not None:
            return None
        peer = next((peer for peer, at_s in self._due.items() if at_s <= now_s), None)
        if peer is not None:
            del self._due[peer]
        return peer

    def record_request(self, peer: int, now_s: float) -> None:
        self._pending = peer, now_s + self._options.round_trip_s + ANSWER_WITHIN_S
        pause_s = self._pause_s.get(peer, MIN_REQUEST_PAUSE_S)
        self._not_before_s[peer] = now_s + pause_s
        self._pause_s[peer] = min(2.0 * pause_s, MAX_REQUEST_PAUSE_S)

    def record_answer(self, peer: int, *, has_news: bool, is_last: bool) -> None:
        """Record the arrival of a part of an answer."""
        if has_news:
            self._pause_s.pop(peer, None)
        if is_last and self._pending is not None and self._pending[0] == peer:
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
