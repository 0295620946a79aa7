"""What a transport of the bus offers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

Receive = Callable[[str, bytes], None]
"""(key, payload), called on the event loop's thread"""
Reply = Callable[[bytes], None]
"""answers a question, once, on the event loop's thread; a question let go unanswered ends by itself"""
Serve = Callable[[str, bytes | None, Reply], None]
"""(key, payload, reply), called on the event loop's thread; None in place of what is too long to be read"""

MAX_QUESTION_BYTES = 16_384
"""A payload that asks; a command that names 254 vehicles takes less than 10 000."""


class BusError(Exception):
    """The bus cannot be opened or joined; the text says what to check."""


class Transport(Protocol):
    """Moves bytes by key. `put` never waits: what cannot be sent now is dropped and counted."""

    dropped: int

    def put(self, key: str, payload: bytes) -> None: ...

    def subscribe(self, key_expression: str, receive: Receive) -> None: ...

    def serve(self, key: str, serve: Serve) -> None:
        """Answer what is asked under `key`. The key handed over is the asker's, which may be a wildcard.

        A payload of more than `MAX_QUESTION_BYTES` is not read: None is handed over.
        """

    async def ask(self, key: str, payload: bytes, timeout_s: float) -> tuple[bytes, ...]:
        """Every answer; none where nobody serves the key, or who does has no time for more questions.

        Raises TimeoutError if they are not all there.
        """

    def close(self) -> None: ...
