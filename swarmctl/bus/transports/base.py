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
Failure = Callable[[str, Exception], None]
"""(key, what a `Receive` or `Serve` raised when it was given what came under that key)"""

MAX_MESSAGE_BYTES = 65_536
"""A payload that is put: a longer one is neither sent nor handed over."""
MAX_QUESTION_BYTES = 16_384
"""A payload that asks; a command that names 254 vehicles takes less than 10 000."""


class BusError(Exception):
    """The bus cannot be opened or joined; the text says what to check."""


class Transport(Protocol):
    """Moves bytes by key. `put` never waits: what cannot be sent now is dropped and counted.

    A bug in one receiver stops neither the others nor the loop: it is counted and reported.
    """

    too_long: int
    """messages of more than `MAX_MESSAGE_BYTES`, from here or from elsewhere"""

    @property
    def dropped(self) -> int:
        """Messages that could not be sent, and messages and questions that nobody had time for."""

    @property
    def failed(self) -> int:
        """Deliveries that ended with an exception of the receiver."""

    def put(self, key: str, payload: bytes) -> None: ...

    def subscribe(self, key_expression: str, receive: Receive) -> None:
        """Hear what is put under a key, or under all keys of `PREFIX/**`.

        The key handed over is the sender's, which may be a wildcard. Raises ValueError for other expressions.
        """

    def serve(self, key: str, serve: Serve) -> None:
        """Answer what is asked under `key`. The key handed over is the asker's, which may be a wildcard.

        A payload of more than `MAX_QUESTION_BYTES` is not read: None is handed over.
        """

    async def ask(self, key: str, payload: bytes, timeout_s: float) -> tuple[bytes, ...]:
        """Every answer; none where nobody serves the key, or who does has no time for more questions.

        Raises TimeoutError if they are not all there.
        """

    def close(self) -> None: ...
