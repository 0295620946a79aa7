"""`Transport`: the protocol of a carrier of bytes, which sends to addresses and calls back with input."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Protocol

Address = Hashable
"""identity of a peer for its transport: (host, port), a connection, a device"""

Receive = Callable[[bytes, Address], None]


class Transport(Protocol):
    async def open(self, receive: Receive) -> None:
        """Open the transport. Raises TransportError for a taken port or a missing device."""

    def send(self, data: bytes, address: Address) -> None:
        """Send without blocking; bytes that cannot be sent are dropped, as on any radio."""

    def peers(self) -> tuple[Address, ...]:
        """Return the addresses for a first heartbeat, before any input."""

    @property
    def trouble(self) -> str:
        """Return the present fault for error texts; empty if none is known."""

    async def close(self) -> None: ...
