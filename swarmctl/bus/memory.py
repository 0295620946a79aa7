"""A bus inside one event loop: for virtual time and tests. Delivers in the order of sending."""

from __future__ import annotations

import asyncio

from swarmctl.bus.base import MAX_QUESTION_BYTES, Receive, Serve


class MemoryBus:
    """Keys are matched as Zenoh does for the only expression in use: a prefix followed by `/**`."""

    def __init__(self) -> None:
        self.dropped = 0
        self._subscribers: dict[str, list[Receive]] = {}
        self._served: dict[str, Serve] = {}

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

    def serve(self, key: str, serve: Serve) -> None:
        self._served[key] = serve

    async def ask(self, key: str, payload: bytes, timeout_s: float) -> tuple[bytes, ...]:
        if key not in self._served:
            return ()
        loop = asyncio.get_running_loop()
        answer: asyncio.Future[bytes] = loop.create_future()

        def reply(payload: bytes) -> None:
            if not answer.done():
                answer.set_result(payload)

        loop.call_soon(self._served[key], key, payload if len(payload) <= MAX_QUESTION_BYTES else None, reply)
        async with asyncio.timeout(timeout_s):
            return (await answer,)

    def close(self) -> None:
        self._subscribers.clear()
        self._served.clear()
