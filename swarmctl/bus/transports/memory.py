"""Bus inside one event loop. Messages arrive in the order of sending."""

from __future__ import annotations

import asyncio

from swarmctl.bus.transports.base import MAX_MESSAGE_BYTES, MAX_QUERY_BYTES, Failure, Receive, Serve
from swarmctl.bus.transports.subscriptions import Subscriptions, report_to_loop


class MemoryBus:
    """Transport without sockets. Key expressions match as in Zenoh, for the forms that this program uses."""

    def __init__(self, on_failure: Failure = report_to_loop) -> None:
        self.dropped = 0
        self.failed = 0
        self._on_failure = on_failure
        self._routes = Subscriptions()
        self._served: dict[str, Serve] = {}

    def put(self, key: str, payload: bytes) -> None:
        if len(payload) > MAX_MESSAGE_BYTES:
            self.dropped += 1
            return
        loop = asyncio.get_running_loop()
        for receive in self._routes.reached_by(key):
            loop.call_soon(self._deliver, receive, key, payload)

    def subscribe(self, key_expression: str, receive: Receive) -> None:
        self._routes.add(key_expression, receive)

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

        def served() -> None:
            try:
                self._served[key](key, payload if len(payload) <= MAX_QUERY_BYTES else None, reply)
            except Exception as error:  # noqa: BLE001 - a bug in one receiver does not affect the others
                self._report_failure(key, error)

        loop.call_soon(served)
        async with asyncio.timeout(timeout_s):
            return (await answer,)

    def close(self) -> None:
        self._routes.clear()
        self._served.clear()

    def _deliver(self, receive: Receive, key: str, payload: bytes) -> None:
        try:
            receive(key, payload)
        except Exception as error:  # noqa: BLE001 - a bug in one receiver does not affect the others
            self._report_failure(key, error)

    def _report_failure(self, key: str, error: Exception) -> None:
        self.failed += 1
        self._on_failure(key, error)
