"""What carries bytes: a `Transport` is opened, sends to addresses, and calls back with what comes in."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Protocol

Address = Hashable
"""whatever the transport tells its peers apart by: (host, port), a connection, a device"""

Receive = Callable[[bytes, Address], None]


class Transport(Protocol):
    async def open(self, receive: Receive) -> None:
        """Raises TransportError where it can never work: a port that is taken, a device that is missing."""

    def send(self, data: bytes, address: Address) -> None:
        """Never blocks; what cannot be sent is dropped, as on any radio."""

    def peers(self) -> tuple[Address, ...]:
        """Where to say hello before anything was heard."""

    @property
    def trouble(self) -> str:
        """Why nothing comes through at the moment, for error texts; empty where it knows of nothing."""

    async def close(self) -> None: ...
