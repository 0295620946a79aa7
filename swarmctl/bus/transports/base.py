"""The interface of a transport of the bus."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

Receive = Callable[[str, bytes], None]
"""(key, payload), called on the event loop's thread"""
Reply = Callable[[bytes], None]
"""answers a question once, on the event loop's thread; an unanswered question ends by itself"""
Serve = Callable[[str, bytes | None, Reply], None]
"""(key, payload, reply), called on the event loop's thread; payload None: above the size limit"""
Failure = Callable[[str, Exception], None]
"""(key, exception of a `Receive` or `Serve` that was called for it)"""

MAX_MESSAGE_BYTES = 65_536
"""Limit on a put payload; a longer one is neither sent nor delivered."""
MAX_QUESTION_BYTES = 16_384
"""Limit on a question's payload; a command that names 254 vehicles takes less than 10 000."""


class BusError(Exception):
    """The bus cannot be opened or joined; the text says what to check."""


class Transport(Protocol):
    """Moves bytes by key. `put` never waits: a message that cannot be sent now is dropped and counted.

    A bug in one receiver stops neither the others nor the loop: it is counted and reported.
    """

    @property
    def dropped(self) -> int:
        """Number of messages that could not be sent, and of messages and questions beyond queue sizes.

        Messages above `MAX_MESSAGE_BYTES` count too, sent or received.
        """

    @property
    def failed(self) -> int:
        """Number of deliveries that ended with an exception of the receiver."""

    def put(self, key: str, payload: bytes) -> None: ...

    def subscribe(self, key_expression: str, receive: Receive) -> None:
        """Receive messages under a key, or under all keys of `PREFIX/**`.

        `receive` gets the sender's key, which may be a wildcard. Raises ValueError for other expressions.
        """

    def serve(self, key: str, serve: Serve) -> None:
        """Answer questions under `key`. `serve` gets the asker's key, which may be a wildcard.

        In place of a payload above `MAX_QUESTION_BYTES` it gets None.
        """

    async def ask(self, key: str, payload: bytes, timeout_s: float) -> tuple[bytes, ...]:
        """Return all answers; none if the key is not served, or its queue is full.

        Raises TimeoutError if answers are missing after `timeout_s`.
        """

    def close(self) -> None: ...
