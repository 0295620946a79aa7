"""What UAVs of a process have said to others of it and nobody has heard yet: so much of it and no more. Pure.

A machine that cannot keep up would else remember all that is said until its memory is full. What was seen
and goes is asked for again; where somebody is and will be is not: the newest that each told of that stays.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from swarmctl.bus.node.decoding import Reading
from swarmctl.core.frames import IntentShared, StateShared

ROOM_BYTES = 32_000_000
WEIGHS_BYTES = 1_000
"""a message, beside its frame"""


class Said(NamedTuple):
    sender: int
    act: str
    reading: Reading
    to: tuple[int, ...]
    """UAVs of this process"""

    @property
    def weighs_bytes(self) -> int:
        return len(self.reading.data) + WEIGHS_BYTES


class Backlog:
    """In the order in which it was said."""

    def __init__(self, room_bytes: int = ROOM_BYTES) -> None:
        self._least_room_bytes = self._room_bytes = room_bytes
        self._weighs_bytes = 0
        self._waiting: deque[Said] = deque()

    def __len__(self) -> int:
        return len(self._waiting)

    def append(self, said: Said) -> list[Said]:
        """Returns what goes for it, where there is no more room: the older half of what waits, but for the
        newest state and the newest intent of each sender to each."""
        self._waiting.append(said)
        self._weighs_bytes += said.weighs_bytes
        return self._make_room() if self._weighs_bytes > self._room_bytes else []

    def popleft(self) -> Said:
        """The oldest. Raises IndexError where nothing waits."""
        said = self._waiting.popleft()
        self._weighs_bytes -= said.weighs_bytes
        return said

    def _make_room(self) -> list[Said]:
        told: dict[tuple[int, type], set[int]] = {}
        stays: deque[Said] = deque()
        goes, newest_bytes, weighs_bytes = [], 0, 0
        for said in reversed(self._waiting):
            is_newest = _is_newest(said, told)
            if is_newest or weighs_bytes + said.weighs_bytes <= self._room_bytes // 2:
                stays.appendleft(said)
                weighs_bytes += said.weighs_bytes
                newest_bytes += said.weighs_bytes * is_newest
            else:
                goes.append(said)
        self._waiting, self._weighs_bytes = stays, weighs_bytes
        # A quarter is free now at least: not every message of a very large swarm looks through all of it.
        self._room_bytes = max(self._least_room_bytes, 4 * newest_bytes)
        return goes


def _is_newest(said: Said, told: dict[tuple[int, type], set[int]]) -> bool:
    """Whether to somebody it is the newest state, or the newest intent, of its sender. `told`: to whom newer
    ones go, by sender and kind; gets this one's."""
    content = said.reading.frame.content
    if not isinstance(content, StateShared | IntentShared):
        return False
    newer = told.setdefault((said.sender, type(content)), set())
    is_newest = not newer.issuperset(said.to)
    newer.update(said.to)
    return is_newest
