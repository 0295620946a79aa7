"""The bus over Zenoh: one session a process, shared by all its agents."""

from __future__ import annotations

import asyncio
from collections import deque
from types import TracebackType

import zenoh
from zenoh.handlers import Callback

from swarmctl.bus.base import BusError, Receive

QUEUE = 4096


def _config() -> zenoh.Config:
    """Nobody is looked for and nobody listened to: no multicast scouting, no gossip, no shared memory."""
    config = zenoh.Config()
    for key, value in (
        ("mode", '"peer"'),
        ("connect/endpoints", "[]"),
        ("listen/endpoints", "[]"),
        ("scouting/multicast/enabled", "false"),
        ("scouting/gossip/enabled", "false"),
        ("transport/shared_memory/enabled", "false"),
    ):
        config.insert_json5(key, value)
    return config


class ZenohBus:
    """A context manager: a session that is not closed keeps the process alive for ever."""

    def __init__(self) -> None:
        self.dropped = 0
        self._queue: deque[tuple[Receive, str, bytes]] = deque()
        self._loop = asyncio.get_running_loop()
        self._closed = False
        try:
            self._session = zenoh.open(_config())
        except zenoh.ZError as error:
            text = f"Zenoh cannot open a session: {error}; `communication: {{bus: memory}}` needs none"
            raise BusError(text) from error

    def __enter__(self) -> ZenohBus:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def put(self, key: str, payload: bytes) -> None:
        self._session.put(key, payload, congestion_control=zenoh.CongestionControl.DROP)

    def subscribe(self, key_expression: str, receive: Receive) -> None:
        def arrived(sample: zenoh.Sample) -> None:
            # Called on a thread of Zenoh's, or inside put: nothing here but append and wake.
            if self._closed or len(self._queue) >= QUEUE:
                self.dropped += 1
                return
            self._queue.append((receive, str(sample.key_expr), bytes(sample.payload)))
            self._loop.call_soon_threadsafe(self._deliver_one)

        self._session.declare_subscriber(key_expression, Callback(arrived, indirect=False))

    def _deliver_one(self) -> None:
        receive, key, payload = self._queue.popleft()
        if not self._closed:
            receive(key, payload)

    def close(self) -> None:
        if not self._closed:
            self._closed = True
            # zenoh-python types close() as untyped.
            self._session.close()  # type: ignore[no-untyped-call]
