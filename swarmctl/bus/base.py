"""What a transport of the bus offers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

Receive = Callable[[str, bytes], None]
"""(key, payload), called on the event loop's thread"""


class BusError(Exception):
    """The bus cannot be opened or joined; the text says what to check."""


class Transport(Protocol):
    """Moves bytes by key. `put` never waits: what cannot be sent now is dropped and counted."""

    dropped: int

    def put(self, key: str, payload: bytes) -> None: ...

    def subscribe(self, key_expression: str, receive: Receive) -> None: ...

    def close(self) -> None: ...
