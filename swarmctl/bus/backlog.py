"""Bounded queue of messages between UAVs of a process. No I/O.

Without a bound, an overloaded machine would queue messages until its memory is full. UAVs request dropped
observations again, but not dropped messages of other kinds. So the newest state, intent and member message
of each sender stay.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from swarmctl.bus.node.decoding import DecodedFrame
from swarmctl.core.frames import IntentShared, MemberShared, StateShared

MAX_QUEUE_BYTES = 32_000_000
OVERHEAD_BYTES = 1_000
"""memory of a message in addition to its frame"""


class QueuedMessage(NamedTuple):
    """A message and its receivers."""

    decoded: DecodedFrame
    to: tuple[int, ...]
    """receivers in this process"""

    @property
    def n_bytes(self) -> int:
        return len(self.decoded.data) + OVERHEAD_BYTES


class Backlog:
    """Queued messages in the order of sending."""

    def __init__(self, max_bytes: int = MAX_QUEUE_BYTES) -> None:
        self._min_limit_bytes = self._limit_bytes = max_bytes
        self._n_bytes = 0
        self._waiting: deque[QueuedMessage] = deque()

    def __len__(self) -> int:
        return len(self._waiting)

    def append(self, message: QueuedMessage) -> list[QueuedMessage]:
        """Append a message; return the messages dropped for lack of memory.

        Above the limit, the oldest messages are dropped until half the limit remains. The newest
        message of each other kind, of each sender to each receiver, stays.
        """
        self._waiting.append(message)
        self._n_bytes += message.n_bytes
        return self._drop_old() if self._n_bytes > self._limit_bytes else []

    def popleft(self) -> QueuedMessage:
        """Remove and return the oldest message. Raises IndexError if the backlog is empty."""
        message = self._waiting.popleft()
        self._n_bytes -= message.n_bytes
        return message

    def _drop_old(self) -> list[QueuedMessage]:
        newer_to: dict[tuple[int, type], set[int]] = {}
        kept: deque[QueuedMessage] = deque()
        dropped, newest_bytes, n_bytes = [], 0, 0
        for message in reversed(self._waiting):
            is_newest = _is_newest(message, newer_to)
            if is_newest or n_bytes + message.n_bytes <= self._limit_bytes // 2:
                kept.appendleft(message)
                n_bytes += message.n_bytes
                newest_bytes += message.n_bytes * is_newest
            else:
                dropped.append(message)
        self._waiting, self._n_bytes = kept, n_bytes
        # Usually at least a quarter of the limit is free now, so the next messages cause no search.
        self._limit_bytes = max(self._min_limit_bytes, 4 * newest_bytes)
        return dropped


def _is_newest(message: QueuedMessage, newer_to: dict[tuple[int, type], set[int]]) -> bool:
    """Return whether a message is its sender's newest of its kind for a receiver; False for observations.

    `newer_to`: receivers of newer messages by sender and kind. This message's receivers are added.
    """
    content = message.decoded.frame.content
    if not isinstance(content, StateShared | IntentShared | MemberShared):
        return False
    newer = newer_to.setdefault((message.decoded.frame.sender, type(content)), set())
    is_newest = not newer.issuperset(message.to)
    newer.update(message.to)
    return is_newest
