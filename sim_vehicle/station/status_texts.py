"""Texts of STATUSTEXT, assembled from their chunks."""

from typing import Any

GAP = "[...]"  # text in place of a missing chunk


class StatusTexts:
    """Texts of STATUSTEXT, assembled from their chunks, in the order of the first received chunks."""

    def __init__(self) -> None:
        self.texts: list[str] = []
        self._open: dict[int, tuple[int, dict[int, str]]] = {}  # id -> index in `texts`, chunks by number

    def receive(self, message: Any) -> None:
        """Process a STATUSTEXT; a text with id 0 has one chunk."""
        if message.id == 0:
            self.texts.append(message.text)
            return
        index, chunks = self._open.get(message.id, (-1, {}))
        if index < 0 or chunks.get(message.chunk_seq, message.text) != message.text:
            # A new text, or a reused id; a repeated chunk has equal text.
            index, chunks = len(self.texts), {}
            self._open[message.id] = index, chunks
            self.texts.append("")
        chunks[message.chunk_seq] = message.text
        self.texts[index] = "".join(chunks.get(i, GAP) for i in range(max(chunks) + 1))
