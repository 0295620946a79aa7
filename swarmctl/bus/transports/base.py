"""Interface of a transport of the bus."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

Receive = Callable[[str, bytes], None]
"""(key, payload), called on the event loop's thread"""
Reply = Callable[[bytes], None]
"""function that answers a query; called at most once, on the event loop's thread"""
Serve = Callable[[str, bytes | None, Reply], None]
"""(key, payload, reply), called on the event loop's thread; payload None: above the size limit"""
Failure = Callable[[str, Exception], None]
"""(key, exception of the `Receive` or `Serve` function of this key)"""

MAX_MESSAGE_BYTES = 65_536
"""limit on the payload of a put; a longer payload is neither sent nor delivered"""
MAX_QUERY_BYTES = 16_384
"""limit on the payload of a query, such as a report of observations"""


class BusError(Exception):
    """The bus cannot be opened or joined; the text has advice."""


class Transport(Protocol):
    """Transport of bytes by key. `put` does not wait: a message that is too long, or cannot be sent
    now, is dropped.

    An exception in a receiver is reported; other receivers and the loop continue.
    """

    def put(self, key: str, payload: bytes) -> None: ...

    def subscribe(self, key_expression: str, receive: Receive) -> None:
        """Receive messages under a key, or under all keys of `PREFIX/**`.

        `receive` gets the sender's key, which may be a wildcard. Raises ValueError for other expressions.
        """

    def serve(self, key: str, serve: Serve) -> None:
        """Answer queries under `key`. `serve` gets the query's key, which may be a wildcard.

        `serve` gets None instead of a payload above `MAX_QUERY_BYTES`.
        """

    async def ask(self, key: str, payload: bytes, timeout_s: float) -> tuple[bytes, ...]:
        """Send a query and return all answers; none if no process serves the key, or if a queue is full.

        Raises TimeoutError if answers are missing after `timeout_s`.
        """

    def close(self) -> None: ...
