"""Bus over Zenoh: one session per process, shared by all its agents."""

from __future__ import annotations

import asyncio
import contextlib
import json
import threading
import time
from collections.abc import Callable
from functools import partial
from queue import SimpleQueue
from types import TracebackType

import zenoh
from zenoh.handlers import Callback

from swarmctl.bus.endpoint import BusEndpoint, parse_endpoint
from swarmctl.bus.transports import process_exit, zenoh_config
from swarmctl.bus.transports.base import (
    MAX_MESSAGE_BYTES,
    MAX_QUERY_BYTES,
    BusError,
    Failure,
    Receive,
    Serve,
)
from swarmctl.bus.transports.inbox import Delivery, Inbox
from swarmctl.bus.transports.renewal import LinkSet, MeshNeighbours, Renewal
from swarmctl.bus.transports.subscriptions import Subscriptions, report_to_loop
from swarmctl.bus.transports.zenoh_config import Configuration
from swarmctl.core.records import replace

MAX_PENDING_QUERIES = 512
"""largest number of queued queries, for commands to 254 vehicles at once; a flood of queries does not
displace messages between UAVs"""
QUERY_QUEUE, MESSAGE_QUEUE, OWN_QUEUE = range(3)
"""queues for queries, messages of other processes, and messages of this process to itself"""
QUEUE_SIZES = (MAX_PENDING_QUERIES, 4096, 65_536)
RETRY_S = 0.5
"""pause after a failed attempt to open a session"""
CHECK_EVERY_S = 0.2
"""period of the checks whether a session has to be replaced"""
RENEWAL_PAUSE_S = 1.0
"""pause between two sessions of a mesh node"""
CLOSE_S = 2.0
"""time limit of closing: a link to a frozen process with a full queue can block Zenoh for ever"""
TIMEOUT_MARGIN_S = 3.0
"""time by which Zenoh's time-out is longer than the caller's: Zenoh does not report that a query timed out"""
ADMIN_TIMEOUT_S = 2.0
MAX_ANSWERS = 64
"""largest number of kept answers to one query"""

OnLink = Callable[[str, str | None, bool], None]
"""(address, common name of the certificate if any, True for a new link and False for an ended link), called
on the loop's thread"""


class ZenohBus:
    """Bus over Zenoh, a context manager: an unclosed session delays other processes until its lease ends.

    Opens the session of a `Configuration`, by default of `standalone`. A patient session opens in the
    background. Until then other processes are not reached: messages to them are dropped and counted. The same
    is true while a session is replaced (`renewal`). Raises BusError.
    """

    def __init__(
        self,
        configuration: Configuration | None = None,
        *,
        on_failure: Failure = report_to_loop,
        on_link: OnLink | None = None,
    ) -> None:
        configuration = configuration or zenoh_config.standalone()
        self.trouble = ""
        """error of the last attempt to open a patient or renewed session; empty after a success"""
        self.endpoint: BusEndpoint | None = None
        """endpoint at which the session listens"""
        self._configuration = configuration
        self._on_link = on_link
        self._loop = asyncio.get_running_loop()
        self._routes = Subscriptions()
        self._inbox = Inbox(self._loop, QUEUE_SIZES, on_failure, self._loop.time)
        self._dropped = 0
        self._links = LinkSet()
        """links of the current session"""
        self._closed = threading.Event()
        self._session: zenoh.Session | None = None
        self._declaring = threading.Lock()
        self._declarations: list[Callable[[zenoh.Session], object]] = []
        self._replies: SimpleQueue[Delivery | None] = SimpleQueue()
        self._reply_thread: threading.Thread | None = None
        self._session_thread: threading.Thread | None = None
        self._is_opening = False
        self._renewal = Renewal()
        self._neighbours: MeshNeighbours | None = None
        if not configuration.is_patient:
            self._open_now()
        if configuration.is_patient or configuration.nodes:
            self._session_thread = process_exit.start_thread("zenoh-open", self._run_sessions)

    def __enter__(self) -> ZenohBus:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def dropped(self) -> int:
        """Number of messages without a link or too long, and of messages and queries for a full queue.

        Zenoh's own drops on a slow link are unknown, and do not count.
        """
        return self._inbox.dropped + self._dropped

    @property
    def failed(self) -> int:
        """Number of deliveries that ended with an exception of the receiver."""
        return self._inbox.failed

    @property
    def links(self) -> int:
        """Number of links to other processes."""
        return len(self._links)

    @property
    def connected(self) -> bool:
        """True if the session has a link, or if no other process receives messages of this process."""
        return bool(self._links) or not self._configuration.has_others

    def put(self, key: str, payload: bytes) -> None:
        """Deliver to subscriptions of this process without Zenoh, and send to other processes.

        Takes at most 1 ms. Zenoh drops messages on slow links without a report.
        """
        if len(payload) > MAX_MESSAGE_BYTES:
            self._dropped += 1
            return
        for receive in self._routes.reached_by(key):
            self._inbox.enqueue(OWN_QUEUE, key, partial(receive, key, payload))
        if not self._configuration.has_others or self._closed.is_set():
            return
        session = self._session
        with contextlib.suppress(zenoh.ZError):  # the session may have been closed for a renewal
            if session is not None and self._links:
                session.put(
                    key,
                    payload,
                    congestion_control=zenoh.CongestionControl.DROP,
                    allowed_destination=zenoh.Locality.REMOTE,
                )
                return
        self._dropped += 1

    def subscribe(self, key_expression: str, receive: Receive) -> None:
        def arrived(sample: zenoh.Sample) -> None:
            if sample.kind != zenoh.SampleKind.PUT:
                return
            if len(sample.payload) > MAX_MESSAGE_BYTES:
                self._dropped += 1
                return
            key = str(sample.key_expr)
            self._inbox.enqueue(MESSAGE_QUEUE, key, partial(receive, key, bytes(sample.payload)))

        self._routes.add(key_expression, receive)
        self._declare(
            lambda session: session.declare_subscriber(
                key_expression, Callback(arrived, indirect=False), allowed_origin=zenoh.Locality.REMOTE
            )
        )

    def serve(self, key: str, serve: Serve) -> None:
        def asked(query: zenoh.Query) -> None:
            def reply(payload: bytes) -> None:
                # Another thread sends the answer: with some settings of the other side an answer may block.
                self._replies.put(partial(_reply, query, key, payload))

            asked_key = str(query.key_expr)
            delivery = partial(serve, asked_key, _query_payload(query.payload), reply)
            if not self._inbox.enqueue(QUERY_QUEUE, asked_key, delivery):
                # zenoh-python types drop() and close() as untyped.
                query.drop()  # type: ignore[no-untyped-call]

        if self._reply_thread is None:
            self._reply_thread = process_exit.start_thread("zenoh-reply", self._reply_all)
        self._declare(lambda session: session.declare_queryable(key, Callback(asked, indirect=False)))

    async def ask(self, key: str, payload: bytes, timeout_s: float) -> tuple[bytes, ...]:
        """Return all answers (`Transport.ask`); none while no session is open."""
        answers: list[bytes] = []
        ended = asyncio.Event()

        def arrived(reply: zenoh.Reply) -> None:
            if reply.ok is not None and len(answers) < MAX_ANSWERS:
                answers.append(bytes(reply.ok.payload))

        def finished() -> None:
            if not self._closed.is_set():
                self._loop.call_soon_threadsafe(ended.set)

        session = self._session
        if session is None:
            return ()
        try:
            session.get(
                key,
                Callback(arrived, finished, indirect=False),
                payload=payload,
                timeout=timeout_s + TIMEOUT_MARGIN_S,
                congestion_control=zenoh.CongestionControl.DROP,
                # Return the answers of all processes that serve the key. By default Zenoh keeps one answer,
                # and asks no other process if one claims to be complete.
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
            )
        except zenoh.ZError:
            return ()
        async with asyncio.timeout(timeout_s):
            await ended.wait()
        return tuple(answers)

    def close(self) -> None:
        """Close within `CLOSE_S`, even if a frozen peer blocks Zenoh, or if no session is open.

        Zenoh may continue in a thread, so end the process with `process_exit.exit_process`.
        """
        if self._closed.is_set():
            return
        self._closed.set()
        self._inbox.close()
        self._replies.put(None)
        threads = [self._reply_thread, None if self._is_opening else self._session_thread]
        if self._session is not None:
            threads.append(_start_closing(self._session))
        until_s = time.monotonic() + CLOSE_S
        for thread in threads:
            if thread is not None:
                thread.join(max(0.0, until_s - time.monotonic()))

    # --- opening

    def _open_now(self) -> None:
        configuration = self._configuration
        try:
            session = zenoh.open(_zenoh_config(self._configuration))
        except zenoh.ZError as error:
            raise BusError(configuration.explain(str(error))) from error
        self._set_up(session)
        if configuration.listen is not None:
            self.endpoint = configuration.listen
            if not configuration.listen.port:
                self.endpoint = replace(configuration.listen, port=self._bound_port(session))
                # A renewed session listens at the same port.
                found = {**configuration.values, "listen/endpoints": [str(self.endpoint)]}
                self._configuration = replace(configuration, values=found)

    def _run_sessions(self) -> None:
        """Open a session, and a new session after each loss, until the bus is closed; runs on a thread."""
        while not self._closed.is_set():
            session = self._session or self._try_to_open()
            if session is None:
                self._closed.wait(RETRY_S)
                continue
            self._wait_for_loss(session)
            if self._closed.is_set():
                return  # `close` closes the session
            with self._declaring:
                self._session, self._links = None, LinkSet()
            closing = _start_closing(session)
            if self._configuration.nodes:
                # A node that returns before other nodes have removed it may never get routes.
                closing.join(CLOSE_S)
                self._closed.wait(RENEWAL_PAUSE_S)

    def _try_to_open(self) -> zenoh.Session | None:
        self._is_opening = True
        try:
            session = zenoh.open(_zenoh_config(self._configuration))
        except zenoh.ZError as error:
            self.trouble = self._configuration.explain(str(error))
            return None
        finally:
            self._is_opening = False
        if self._closed.is_set():
            _start_closing(session)
            return None
        self.trouble = ""
        self._set_up(session)
        return session

    def _wait_for_loss(self, session: zenoh.Session) -> None:
        """Return when the bus is closed, or when its session has to be replaced."""
        while not self._closed.wait(CHECK_EVERY_S):
            now_s = time.monotonic()
            if self._neighbours is not None:
                is_lost = self._has_to_renew(session, self._neighbours, now_s)
            else:
                is_lost = self._links.are_lost(now_s)
            if is_lost:
                return

    def _has_to_renew(self, session: zenoh.Session, neighbours: MeshNeighbours, now_s: float) -> bool:
        with contextlib.suppress(zenoh.ZError):  # the session may be closing
            self._links.remove_unlisted((link.src, link.dst) for link in session.info.links())
            linked = [str(zid) for zid in session.info.routers_zid()]
            return neighbours.has_to_renew(self._renewal, linked, now_s)
        return False

    def _set_up(self, session: zenoh.Session) -> None:
        links = LinkSet()
        self._links = links
        changed = partial(self._link_changed, links)
        session.info.declare_link_events_listener(Callback(changed, indirect=False), history=True)
        if nodes := self._configuration.nodes:
            own_id, subscribe, has_subscriber = (
                str(session.zid()),
                partial(_subscribe_only, session),
                partial(_has_subscriber, session),
            )
            self._neighbours = MeshNeighbours(nodes, own_id, subscribe, has_subscriber)
        with self._declaring:
            self._session = session
            for declare in self._declarations:
                declare(session)

    def _declare(self, declare: Callable[[zenoh.Session], object]) -> None:
        with self._declaring:
            self._declarations.append(declare)
            if self._session is not None:
                declare(self._session)

    def _link_changed(self, links: LinkSet, event: zenoh.LinkEvent) -> None:
        # Several threads may call this function at once, also for a session that has been replaced.
        has_started = event.kind == zenoh.SampleKind.PUT
        is_new = links.record((event.link.src, event.link.dst), has_started=has_started)
        if is_new and self._on_link is not None:
            report = partial(self._on_link, event.link.dst, event.link.auth_identifier, has_started)
            self._inbox.enqueue(OWN_QUEUE, "", report)

    def _bound_port(self, session: zenoh.Session) -> int:
        """Return the free port that Zenoh has chosen, from its admin space."""
        mode = self._configuration.values["mode"]
        for reply in session.get(f"@/{session.zid()}/{mode}", timeout=ADMIN_TIMEOUT_S):
            if reply.ok is not None:
                for locator in json.loads(bytes(reply.ok.payload)).get("locators", ()):
                    return parse_endpoint(locator).port
        self.close()
        raise BusError(
            "Zenoh does not report its port within "
            f"{ADMIN_TIMEOUT_S:g} s; give `communication.listen` a port other than 0"
        )

    def _reply_all(self) -> None:
        while (reply := self._replies.get()) is not None:
            if not self._closed.is_set():
                reply()


def _start_closing(session: zenoh.Session) -> threading.Thread:
    """Close a session on a new thread, without a time limit; return the thread."""

    def close() -> None:
        # Zenoh raises after 10 s without success; no further action is possible.
        with contextlib.suppress(zenoh.ZError):
            session.close()  # type: ignore[no-untyped-call]

    return process_exit.start_thread("zenoh-close", close)


def _subscribe_only(session: zenoh.Session, key: str) -> Callable[[], None]:
    """Subscribe to a key and ignore its messages; return a function that ends the subscription."""
    ignore: Callback[zenoh.Sample] = Callback(lambda _sample: None, indirect=False)
    return partial(session.declare_subscriber(key, ignore).undeclare)


def _has_subscriber(session: zenoh.Session, key: str) -> bool:
    """Return whether another process subscribes to a key, by Zenoh's tables; no message is put."""
    with session.declare_publisher(key, allowed_destination=zenoh.Locality.REMOTE) as publisher:
        # zenoh-python declares the status as a bool.
        return bool(publisher.matching_status.matching)  # type: ignore[attr-defined]


def _reply(query: zenoh.Query, key: str, payload: bytes) -> None:
    try:
        query.reply(key, payload)
    except zenoh.ZError:
        pass  # the session has been closed
    finally:
        query.drop()  # type: ignore[no-untyped-call]


def _query_payload(payload: zenoh.ZBytes | None) -> bytes | None:
    """Return a query's payload; None above the size limit, without a copy."""
    if payload is None:
        return b""
    return bytes(payload) if len(payload) <= MAX_QUERY_BYTES else None


def _zenoh_config(configuration: Configuration) -> zenoh.Config:
    config = zenoh.Config()
    for path, value in configuration.values.items():
        config.insert_json5(path, json.dumps(value))
    return config
