"""When a UAV asks whom for what it may have missed: one question at a time, and nobody too often. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from swarmctl.bus.node.exchange import NodeOptions

ANSWER_WITHIN_S = 2.0
"""beyond what the way there and back takes"""


class Questions:
    """One UAV's. Nobody is ever asked where `sync_every_s` is 0."""

    def __init__(self, options: NodeOptions, rng: np.random.Generator) -> None:
        self._options = options
        self._due: dict[int, float] = {}
        """peer -> from when on it is to be asked what it holds"""
        self._asked: tuple[int, float] | None = None
        """who was asked, and until when an answer is waited for"""
        self._next_sync_s = math.inf
        if options.sync_every_s > 0.0:
            self._next_sync_s = options.sync_every_s * (0.5 + 0.5 * float(rng.random()))

    @property
    def are_asked(self) -> bool:
        """Whether anybody is ever asked."""
        return self._options.sync_every_s > 0.0

    def soon(self, peer: int, now_s: float, not_before_s: float) -> None:
        """Ask it, after what may still be on its way has come."""
        if self.are_asked:
            self._due.setdefault(peer, max(now_s + self._options.round_trip_s / 2.0, not_before_s))

    def due(self, now_s: float) -> Iterator[int]:
        """Whom to ask now, each once; what an answer brings may make the others idle, so they wait for it."""
        while self._due and not self._is_waiting():
            peer = next((peer for peer, at_s in self._due.items() if at_s <= now_s), None)
            if peer is None:
                return
            del self._due[peer]
            yield peer

    def _is_waiting(self) -> bool:
        return self._asked is not None

    def asked(self, peer: int, now_s: float) -> None:
        self._asked = peer, now_s + self._options.round_trip_s + ANSWER_WITHIN_S

    def answered(self, peer: int) -> None:
        """With all it had."""
        if self._asked is not None and self._asked[0] == peer:
            self._asked = None

    def tick(self, now_s: float) -> bool:
        """Whether it is time to ask somebody, though nothing is known to be missing."""
        if self._asked is not None and now_s >= self._asked[1]:
            self._asked = None
        if now_s < self._next_sync_s:
            return False
        self._next_sync_s = now_s + self._options.sync_every_s
        return True

    @property
    def next_deadline_s(self) -> float:
        """When to `tick` at the latest."""
        if self._asked is not None:
            return min(self._next_sync_s, self._asked[1])
        return min(self._next_sync_s, *self._due.values()) if self._due else self._next_sync_s
