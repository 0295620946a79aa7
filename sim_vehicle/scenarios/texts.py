"""What a vehicle says by STATUSTEXT, long texts put together from their chunks."""

from typing import Any

GAP = "[...]"  # for chunks that are missing


class Texts:
    """`said` in order of the first chunks; a text grows in its place as more of it is heard."""

    def __init__(self) -> None:
        self.said: list[str] = []
        self._open: dict[int, tuple[int, dict[int, str]]] = {}  # id -> place in `said`, chunks by number

    def note(self, message: Any) -> None:
        """A STATUSTEXT; id 0 is a text of one chunk."""
        if message.id == 0:
            self.said.append(message.text)
            return
        place, chunks = self._open.get(message.id, (-1, {}))
        if place < 0 or chunks.get(message.chunk_seq, message.text) != message.text:
            # New, or the ids have begun again: a chunk that comes twice says the same.
            place, chunks = len(self.said), {}
            self._open[message.id] = place, chunks
            self.said.append("")
        chunks[message.chunk_seq] = message.text
        self.said[place] = "".join(chunks.get(i, GAP) for i in range(max(chunks) + 1))
