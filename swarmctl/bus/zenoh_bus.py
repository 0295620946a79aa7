"""The bus over Zenoh: one session a process, shared by all its agents."""

from __future__ import annotations

import asyncio
import json
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from types import TracebackType
from typing import Any

import zenoh
from zenoh.handlers import Callback

from swarmctl.bus.base import MAX_QUESTION_BYTES, BusError, Receive, Serve
from swarmctl.bus.endpoint import BusEndpoint, parse_endpoint

QUEUE = 4096
QUESTIONS = 32
"""that wait for an answer: whoever asks too much displaces nothing that the UAVs tell each other"""
MAX_FROM_OUTSIDE_BYTES = 65_536
"""a message from another process; Zenoh's own limit is 1 GiB"""
JOIN_TIMEOUT_S = 3.0
ADMIN_TIMEOUT_S = 2.0


class ZenohBus:
    """A context manager: a session that is not closed keeps the process alive for ever.

    By itself it neither listens nor connects. With `listen` others may come in there and ask under the keys
    `open_keys`; nothing else of theirs is let in, and nothing but the answers let out. With `connect` it
    joins who listens there. Raises BusError.
    """

    def __init__(
        self,
        *,
        listen: BusEndpoint | None = None,
        open_keys: tuple[str, ...] = (),
        connect: BusEndpoint | None = None,
    ) -> None:
        self.dropped = 0
        self.endpoint: BusEndpoint | None = None
        """where it listens"""
        self._queue: deque[Callable[[], None]] = deque()
        self._questions: deque[Callable[[], None]] = deque()
        self._loop = asyncio.get_running_loop()
        self._closed = False
        try:
            self._session = zenoh.open(_config(listen, open_keys, connect))
        except zenoh.ZError as error:
            raise BusError(_cure(listen, connect, error)) from error
        if listen is not None:
            self.endpoint = listen if listen.port else replace(listen, port=self._bound_port())

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
            delivery = partial(receive, str(sample.key_expr), bytes(sample.payload))
            self._hand_over(self._queue, QUEUE, delivery)

        self._session.declare_subscriber(key_expression, Callback(arrived, indirect=False))

    def serve(self, key: str, serve: Serve) -> None:
        def asked(query: zenoh.Query) -> None:
            def reply(payload: bytes) -> None:
                if not self._closed:
                    query.reply(key, payload)
                    # zenoh-python types drop() and close() as untyped.
                    query.drop()  # type: ignore[no-untyped-call]

            delivery = partial(serve, str(query.key_expr), _read(query.payload), reply)
            if not self._hand_over(self._questions, QUESTIONS, delivery):
                query.drop()  # type: ignore[no-untyped-call]

        self._session.declare_queryable(key, Callback(asked, indirect=False))

    async def ask(self, key: str, payload: bytes, timeout_s: float) -> tuple[bytes, ...]:
        answers: list[bytes] = []
        ended = asyncio.Event()

        def arrived(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                answers.append(bytes(reply.ok.payload))

        def over() -> None:
            if not self._closed:
                self._loop.call_soon_threadsafe(ended.set)

        # Our own time-out comes first: Zenoh does not tell its own from an answer.
        self._session.get(
            key, Callback(arrived, over, indirect=False), payload=payload, timeout=timeout_s + JOIN_TIMEOUT_S
        )
        async with asyncio.timeout(timeout_s):
            await ended.wait()
        return tuple(answers)

    def close(self) -> None:
        if not self._closed:
            self._closed = True
            self._session.close()  # type: ignore[no-untyped-call]

    def _hand_over(self, queue: deque[Callable[[], None]], room: int, delivery: Callable[[], None]) -> bool:
        # Called on a thread of Zenoh's, or inside put: nothing here but append and wake.
        if self._closed or len(queue) >= room:
            self.dropped += 1
            return False
        queue.append(delivery)
        self._loop.call_soon_threadsafe(self._deliver_one, queue)
        return True

    def _deliver_one(self, queue: deque[Callable[[], None]]) -> None:
        delivery = queue.popleft()
        if not self._closed:
            delivery()

    def _bound_port(self) -> int:
        """The free port that was found; Zenoh tells it in its admin space alone."""
        for reply in self._session.get(f"@/{self._session.zid()}/peer", timeout=ADMIN_TIMEOUT_S):
            if reply.ok is not None:
                for locator in json.loads(bytes(reply.ok.payload)).get("locators", ()):
                    return parse_endpoint(locator).port
        self.close()
        raise BusError("Zenoh does not tell which port it listens at; give `communication.listen` one")


def _read(payload: zenoh.ZBytes | None) -> bytes | None:
    """None in place of what is too long: it is not even copied."""
    if payload is None:
        return b""
    return bytes(payload) if len(payload) <= MAX_QUESTION_BYTES else None


def _config(
    listen: BusEndpoint | None, open_keys: tuple[str, ...], connect: BusEndpoint | None
) -> zenoh.Config:
    """Nobody is looked for: no multicast scouting, no gossip, no shared memory."""
    values: dict[str, Any] = {
        "mode": "peer" if connect is None else "client",
        "connect/endpoints": [] if connect is None else [str(connect)],
        "connect/timeout_ms": round(JOIN_TIMEOUT_S * 1000.0),
        "connect/exit_on_failure": True,
        "listen/endpoints": [] if listen is None else [str(listen)],
        "listen/exit_on_failure": True,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/shared_memory/enabled": False,
    }
    if listen is not None:
        values |= {
            "adminspace/enabled": True,
            "access_control": _access(open_keys),
            "transport/link/rx/max_message_size": MAX_FROM_OUTSIDE_BYTES,
        }
    config = zenoh.Config()
    for key, value in values.items():
        config.insert_json5(key, json.dumps(value))
    return config


def _access(open_keys: tuple[str, ...]) -> dict[str, Any]:
    """Who comes in from outside may ask under exactly these keys, and hear the answers.

    All else is denied by default, because a rule that denies is passed by a put on a wildcard key.
    """
    allowed = [
        {"id": "ask", "flows": ["ingress"], "messages": ["query"]},
        {"id": "answer", "flows": ["egress"], "messages": ["reply", "declare_queryable"]},
    ]
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [{**rule, "permission": "allow", "key_exprs": list(open_keys)} for rule in allowed],
        "subjects": [{"id": "anybody"}],
        "policies": [{"rules": [rule["id"] for rule in allowed], "subjects": ["anybody"]}],
    }


def _cure(listen: BusEndpoint | None, connect: BusEndpoint | None, error: zenoh.ZError) -> str:
    if connect is not None:
        return f"no swarm listens at {connect}: tried for {JOIN_TIMEOUT_S:g} s; has its flight ended?"
    if listen is None:
        return f"Zenoh cannot open a session: {error}; `communication: {{bus: memory}}` needs none"
    why = "the port is taken" if "in use" in str(error) else str(error)
    return (
        f"communication.listen: cannot listen at {listen}: {why}; end who has it, give another port "
        "(0 is any free one), or `none`"
    )
