"""A bus inside one event loop: for virtual time and tests. Delivers in the order of sending."""

from __future__ import annotations

import asyncio

from swarmctl.bus.base import Receive


class MemoryBus:
    """Keys are matched as Zenoh does for the only expression in use: a prefix followed by `/**`."""

    def __init__(self) -> None:
        self.dropped = 0
        self._subscribers: dict[str, list[Receive]] = {}

    def put(self, key: str, payload: bytes) -> None:
        loop = asyncio.get_running_loop()
        end = key.find("/")
        while end >= 0:
            for receive in self._subscribers.get(key[: end + 1], ()):
                loop.call_soon(receive, key, payload)
            end = key.find("/", end + 1)

    def subscribe(self, key_expression: str, receive: Receive) -> None:
        if not key_expression.endswith("/**"):
            raise ValueError(f"expected a key expression that ends in /**, found {key_expression!r}")
        self._subscribers.setdefault(key_expression.removesuffix("**"), []).append(receive)

    def close(self) -> None:
        self._subscribers.clear()
