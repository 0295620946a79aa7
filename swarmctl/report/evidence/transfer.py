"""A running transfer of a mission, a fence or rally points, and its entries. Pure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from swarmctl.mavlink.protocol.codec import Message
from swarmctl.mavlink.protocol.command import name_of
from swarmctl.report.evidence.chain import EntryKind, canonical, sha256

PARTIAL = "MISSION_WRITE_PARTIAL_LIST"
ANNOUNCEMENTS = frozenset({"MISSION_COUNT", PARTIAL})
"""the messages that announce items"""

NewEntry = tuple[EntryKind, dict[str, Any]]


@dataclass(slots=True)
class Transfer:
    """The items of a transfer by number; a repeated item counts once."""

    mission_type: int
    """MAV_MISSION_TYPE"""
    count: int | None = None
    """number of items by MISSION_COUNT; None if no MISSION_COUNT was sent or received"""
    items: dict[int, tuple[Any, ...]] = field(default_factory=dict)
    announced: set[int] = field(default_factory=set)
    """numbers announced by partial lists"""
    answers: Counter[str] = field(default_factory=Counter)
    """results of partial lists that are not in an entry yet"""
    is_recorded: bool = False
    """True if an entry has the hash of all items received so far"""

    @property
    def is_partial(self) -> bool:
        return bool(self.announced)

    def add_item(self, message: Message) -> None:
        seq, fields = int(message.seq), _fields(message)
        self.is_recorded = self.is_recorded and self.items.get(seq) == fields
        self.items[seq] = fields

    def announce(self, message: Message) -> None:
        self.announced.update(range(int(message.start_index), int(message.end_index) + 1))

    def content(self) -> dict[str, Any]:
        """Return the number and hash of the items; `of`: number announced, None if unknown."""
        first = {"first": min(self.items)} if self.is_partial and self.items else {}
        return {
            **first,
            "items": len(self.items),
            "of": len(self.announced) if self.is_partial else self.count,
            "mission_type": self._type,
            "sha256": _hash(self.items),
        }

    def unrecorded_entries(self) -> list[NewEntry]:
        """Return entries for items, and for answers to partial lists, that have no entry yet."""
        entries: list[NewEntry] = []
        if self.items and not self.is_recorded:
            self.is_recorded = True
            entries.append(("command", {"message": "MISSION_ITEM_INT", **self.content()}))
        for result, times in self.answers.items():
            answer = {"message": "MISSION_ACK", "mission_type": self._type, "result": result, "times": times}
            entries.append(("acknowledgement", answer))
        self.answers.clear()
        return entries

    @property
    def _type(self) -> str:
        return name_of("MAV_MISSION_TYPE", self.mission_type)


def _fields(message: Message) -> tuple[Any, ...]:
    """Return the fields of a mission item that the hash covers."""
    m = message
    return (m.frame, m.command, m.autocontinue, m.param1, m.param2, m.param3, m.param4, m.x, m.y, m.z)


def _hash(items: Mapping[int, tuple[Any, ...]]) -> str:
    """Return the SHA-256 of the canonical list of [number, fields] in the order of the numbers."""
    return sha256(canonical([[seq, list(items[seq])] for seq in sorted(items)]))
