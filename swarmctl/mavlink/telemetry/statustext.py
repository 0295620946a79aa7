"""STATUSTEXT: assembly of long texts from chunks of 50 characters.

https://mavlink.io/en/messages/common.html#STATUSTEXT
"""

from __future__ import annotations

import re

from swarmctl.mavlink.protocol.codec import Message

CHUNK_LENGTH = 50
_STRIKE = re.compile(r"STRIKE (\d+) over -?\d+,-?\d+ from -?\d+,-?\d+\Z")


class TextAssembler:
    """Assembler of texts from chunks.

    A lost chunk leaves the gap " ... ". A text without its last chunk is returned when the next long text
    begins.
    """

    def __init__(self) -> None:
        self._id = 0
        self._severity = 0
        self._chunks: dict[int, str] = {}

    def receive(self, message: Message) -> list[tuple[int, str]]:
        """Return (severity, text) of the texts that this STATUSTEXT completes."""
        if message.id == 0:
            return [(int(message.severity), str(message.text))]
        done = self._flush() if self._chunks and message.id != self._id else []
        self._id = int(message.id)
        self._severity = int(message.severity)
        self._chunks[int(message.chunk_seq)] = str(message.text)
        if len(message.text) < CHUNK_LENGTH:
            done += self._flush()
        return done

    def _flush(self) -> list[tuple[int, str]]:
        parts = [self._chunks.get(i, " ... ") for i in range(max(self._chunks) + 1)]
        self._chunks = {}
        return [(self._severity, "".join(parts))]


def strike_count(text: str) -> int | None:
    """Return the running count in the simulator's `STRIKE {n} over r,c from r,c`; None for other texts."""
    match = _STRIKE.match(text)
    return int(match[1]) if match else None
