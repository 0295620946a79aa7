"""The bus over Zenoh: one session a process, shared by all its agents."""

from __future__ import annotations

import asyncio
import contextlib
import json
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from queue import SimpleQueue
from types import TracebackType

import zenoh
from zenoh.handlers import Callback

from swarmctl.bus.endpoint import BusEndpoint, parse_endpoint
from swarmctl.bus.transports import process_exit, zenoh_config
from swarmctl.bus.transports.base import (
    MAX_MESSAGE_BYTES,
    MAX_QUESTION_BYTES,
    BusError,
    Failure,
    Receive,
    Serve,
)
from swarmctl.bus.transports.inbox import Delivery, Inbox
from swarmctl.bus.transports.links import LinkSet
from swarmctl.bus.transports.neighbours import MeshNeighbours
from swarmctl.bus.transports.renewal import Renewal
from swarmctl.bus.transports.routes import Subscriptions, report_to_loop
from swarmctl.bus.transports.zenoh_config import Configuration

QUESTIONS = 32
"""that wait for an answer: whoever asks too much displaces nothing that the UAVs tell each other"""
ASKED, HEARD, OWN = range(3)
"""queues: questions, what others put, what this process puts for itself"""
ROOMS = (QUESTIONS, 4096, 65_536)
AGAIN_AFTER_S = 0.5
"""between attempts to open a session that fail at once"""
LOST_AFTER_S = 3.0
"""without any link a patient session is given up for a new one: after a cut Zenoh may be stuck for ten
seconds in closing a TLS link whose send buffer is full, and connects no more until then"""
LOOK_EVERY_S = 0.2
AWAY_S = 1.0
"""between two sessions of a node of a mesh"""
CLOSE_S = 2.0
"""a link to a frozen process with a full queue can keep Zenoh from closing for ever"""
MARGIN_S = 3.0
"""by which Zenoh's time-out of a question is later than ours: it does not tell its own from an answer"""
ADMIN_TIMEOUT_S = 2.0
MAX_ANSWERS = 64
"""to one question that are kept"""

OnLink = Callable[[str, str | None, bool], None]
"""(address, the certificate's common name if it has one, whether it came or went), on the loop's thread"""


class ZenohBus:
    """A context manager: a session that is not closed keeps others waiting until its lease is over.

    Opens what a `Configuration` says. `listen`, `open_keys` and `put_keys` are short for `alone`, `connect`
    for `visitor`. A session that may open later (`is_patient`) does so in the background; until then nothing
    of others is heard, and what is put for them is dropped and counted. So it is for a moment where a node of
    a mesh gives its session up for a new one, see `renewal`. Raises BusError.
    """

    def __init__(
        self,
        configuration: Configuration | None = None,
        *,
        listen: BusEndpoint | None = None,
        open_keys: tuple[str, ...] = (),
        put_keys: tuple[str, ...] = (),
        connect: BusEndpoint | None = None,
        on_failure: Failure = report_to_loop,
        on_link: OnLink | None = None,
    ) -> None:
        if configuration is None:
            configuration = (
                zenoh_config.visitor(connect)
                if connect is not None
                else zenoh_config.standalone(listen, open_keys, put_keys)
            )
        self.too_long = 0
        self.trouble = ""
        """why a patient session, or a mesh's next, is not open yet"""
        self.endpoint: BusEndpoint | None = None
        """where it listens"""
        self._configuration = configuration
        self._on_link = on_link
        self._loop = asyncio.get_running_loop()
        self._routes = Subscriptions()
        self._inlet = Inbox(self._loop, ROOMS, on_failure)
        self._unsent = 0
        self._links = LinkSet()
        """of the present session"""
        self._closed = threading.Event()
        self._session: zenoh.Session | None = None
        self._declaring = threading.Lock()
        self._declarations: list[Callable[[zenoh.Session], object]] = []
        self._replies: SimpleQueue[Delivery | None] = SimpleQueue()
        self._replying: threading.Thread | None = None
        self._keeper: threading.Thread | None = None
        self._is_opening = False
        self._renewal = Renewal()
        self._neighbours: MeshNeighbours | None = None
        if not configuration.is_patient:
            self._open_now()
        if configuration.is_patient or configuration.nodes:
            self._keeper = process_exit.start_thread("zenoh-open", self._keep_open)

    def __enter__(self) -> ZenohBus:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def dropped(self) -> int:
        return self._inlet.dropped + self._unsent

    @property
    def failed(self) -> int:
        return self._inlet.failed

    @property
    def links(self) -> int:
        """How many others this process has a link to."""
        return len(self._links)

    @property
    def connected(self) -> bool:
        """Whether what is put reaches anybody: there is a link, or nobody else is meant to hear."""
        return bool(self._links) or not self._configuration.has_others

    def put(self, key: str, payload: bytes) -> None:
        """Hand over to subscriptions of this process, past Zenoh, and send to the others if there are any.

        Takes a millisecond at most; what Zenoh drops where a link is slower than that it does not tell.
        """
        if len(payload) > MAX_MESSAGE_BYTES:
            self.too_long += 1
            return
        for receive in self._routes.reached_by(key):
            self._inlet.take(OWN, key, partial(receive, key, payload))
        if not self._configuration.has_others or self._closed.is_set():
            return
        session = self._session
        with contextlib.suppress(zenoh.ZError):  # where the session has just been given up for a new one
            if session is not None and self._links:
                session.put(
                    key,
                    payload,
                    congestion_control=zenoh.CongestionControl.DROP,
                    allowed_destination=zenoh.Locality.REMOTE,
                )
                return
        self._unsent += 1

    def subscribe(self, key_expression: str, receive: Receive) -> None:
        def arrived(sample: zenoh.Sample) -> None:
            if sample.kind != zenoh.SampleKind.PUT:
                return
            if len(sample.payload) > MAX_MESSAGE_BYTES:
                self.too_long += 1
                return
            key = str(sample.key_expr)
            self._inlet.take(HEARD, key, partial(receive, key, bytes(sample.payload)))

        self._routes.add(key_expression, receive)
        self._declare(
            lambda session: session.declare_subscriber(
                key_expression, Callback(arrived, indirect=False), allowed_origin=zenoh.Locality.REMOTE
            )
        )

    def serve(self, key: str, serve: Serve) -> None:
        def asked(query: zenoh.Query) -> None:
            def reply(payload: bytes) -> None:
                # On a thread of its own: the asker decides whether an answer waits for room in a queue.
                self._replies.put(partial(_reply, query, key, payload))

            asked_key = str(query.key_expr)
            delivery = partial(serve, asked_key, _read(query.payload), reply)
            if not self._inlet.take(ASKED, asked_key, delivery):
                # zenoh-python types drop() and close() as untyped.
                query.drop()  # type: ignore[no-untyped-call]

        if self._replying is None:
            self._replying = process_exit.start_thread("zenoh-reply", self._reply_all)
        self._declare(lambda session: session.declare_queryable(key, Callback(asked, indirect=False)))

    async def ask(self, key: str, payload: bytes, timeout_s: float) -> tuple[bytes, ...]:
        """As of every transport; none as well where no session is open."""
        answers: list[bytes] = []
        ended = asyncio.Event()

        def arrived(reply: zenoh.Reply) -> None:
            if reply.ok is not None and len(answers) < MAX_ANSWERS:
                answers.append(bytes(reply.ok.payload))

        def over() -> None:
            if not self._closed.is_set():
                self._loop.call_soon_threadsafe(ended.set)

        session = self._session
        if session is None:
            return ()
        try:
            session.get(
                key,
                Callback(arrived, over, indirect=False),
                payload=payload,
                timeout=timeout_s + MARGIN_S,
                congestion_control=zenoh.CongestionControl.DROP,
                # All answers of all who serve the key: else the last hides the others, and who says that it
                # is complete keeps the others from being asked.
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
            )
        except zenoh.ZError:
            return ()
        async with asyncio.timeout(timeout_s):
            await ended.wait()
        return tuple(answers)

    def close(self) -> None:
        """Ends within `CLOSE_S`, also where a frozen peer keeps Zenoh from ending, or nobody could be joined.

        What Zenoh is at then goes on in a thread: end the process with `leaving.leave`.
        """
        if self._closed.is_set():
            return
        self._closed.set()
        self._inlet.close()
        self._replies.put(None)
        threads = [self._replying, None if self._is_opening else self._keeper]
        if self._session is not None:
            threads.append(_closing(self._session))
        until_s = time.monotonic() + CLOSE_S
        for thread in threads:
            if thread is not None:
                thread.join(max(0.0, until_s - time.monotonic()))

    # --- opening

    def _open_now(self) -> None:
        configuration = self._configuration
        try:
            session = zenoh.open(_zenoh(self._configuration))
        except zenoh.ZError as error:
            raise BusError(configuration.cure(str(error))) from error
        self._opened(session)
        if configuration.listen is not None:
            self.endpoint = configuration.listen
            if not configuration.listen.port:
                self.endpoint = replace(configuration.listen, port=self._bound_port(session))
                # The next session listens at the same port.
                found = {**configuration.values, "listen/endpoints": [str(self.endpoint)]}
                self._configuration = replace(configuration, values=found)

    def _keep_open(self) -> None:
        """The life of a bus whose sessions may come and go, on a thread: one after the other."""
        while not self._closed.is_set():
            session = self._session or self._try_to_open()
            if session is None:
                self._closed.wait(AGAIN_AFTER_S)
                continue
            self._wait_until_lost(session)
            if self._closed.is_set():
                return  # and who closes the bus closes its session
            with self._declaring:
                self._session, self._links = None, LinkSet()
            closing = _closing(session)
            if self._configuration.nodes:
                # Others may never find routes to who is back before they have taken leave of it.
                closing.join(CLOSE_S)
                self._closed.wait(AWAY_S)

    def _try_to_open(self) -> zenoh.Session | None:
        self._is_opening = True
        try:
            session = zenoh.open(_zenoh(self._configuration))
        except zenoh.ZError as error:
            self.trouble = self._configuration.cure(str(error))
            return None
        finally:
            self._is_opening = False
        if self._closed.is_set():
            _closing(session)
            return None
        self.trouble = ""
        self._opened(session)
        return session

    def _wait_until_lost(self, session: zenoh.Session) -> None:
        """Until the bus is closed, or its session has to be given up for a new one."""
        while not self._closed.wait(LOOK_EVERY_S):
            now_s = time.monotonic()
            if self._neighbours is not None:
                is_lost = self._is_to_be_renewed(session, self._neighbours, now_s)
            else:
                is_lost = self._links.alone_s(now_s) >= LOST_AFTER_S
            if is_lost:
                return

    def _is_to_be_renewed(self, session: zenoh.Session, neighbours: MeshNeighbours, now_s: float) -> bool:
        with contextlib.suppress(zenoh.ZError):  # where the session is being closed
            self._links.listed((link.src, link.dst) for link in session.info.links())
            return neighbours.look(self._renewal, [str(zid) for zid in session.info.routers_zid()], now_s)
        return False

    def _opened(self, session: zenoh.Session) -> None:
        links = LinkSet()
        self._links = links
        changed = partial(self._link_changed, links)
        session.info.declare_link_events_listener(Callback(changed, indirect=False), history=True)
        if nodes := self._configuration.nodes:
            own_id, hear, is_heard = str(session.zid()), partial(_hear, session), partial(_is_heard, session)
            self._neighbours = MeshNeighbours(nodes, own_id, hear, is_heard)
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
        # Of several threads at once, and perhaps of a session that has been given up.
        has_come = event.kind == zenoh.SampleKind.PUT
        links.changed((event.link.src, event.link.dst), has_come=has_come)
        if self._on_link is not None:
            who = partial(self._on_link, event.link.dst, event.link.auth_identifier, has_come)
            self._inlet.take(OWN, "", who)

    def _bound_port(self, session: zenoh.Session) -> int:
        """The free port that was found; Zenoh tells it in its admin space alone."""
        mode = self._configuration.values["mode"]
        for reply in session.get(f"@/{session.zid()}/{mode}", timeout=ADMIN_TIMEOUT_S):
            if reply.ok is not None:
                for locator in json.loads(bytes(reply.ok.payload)).get("locators", ()):
                    return parse_endpoint(locator).port
        self.close()
        raise BusError("Zenoh does not tell which port it listens at; give `communication.listen` one")

    def _reply_all(self) -> None:
        while (reply := self._replies.get()) is not None:
            if not self._closed.is_set():
                reply()


def _closing(session: zenoh.Session) -> threading.Thread:
    """Close it on a thread of its own, however long that takes."""

    def close() -> None:
        # Raised where it gives up after ten seconds: there is nobody left who could do more.
        with contextlib.suppress(zenoh.ZError):
            session.close()  # type: ignore[no-untyped-call]

    return process_exit.start_thread("zenoh-close", close)


def _hear(session: zenoh.Session, key: str) -> Callable[[], None]:
    """And ignore, as nobody may put there."""
    ignore: Callback[zenoh.Sample] = Callback(lambda _sample: None, indirect=False)
    return partial(session.declare_subscriber(key, ignore).undeclare)


def _is_heard(session: zenoh.Session, key: str) -> bool:
    """Whether anybody else would hear what is put there, as Zenoh's tables have it: nothing is."""
    with session.declare_publisher(key, allowed_destination=zenoh.Locality.REMOTE) as publisher:
        # zenoh-python types the status as a bool.
        return bool(publisher.matching_status.matching)  # type: ignore[attr-defined]


def _reply(query: zenoh.Query, key: str, payload: bytes) -> None:
    try:
        query.reply(key, payload)
    except zenoh.ZError:
        pass  # the session has been closed meanwhile
    finally:
        query.drop()  # type: ignore[no-untyped-call]


def _read(payload: zenoh.ZBytes | None) -> bytes | None:
    """None in place of what is too long: it is not even copied."""
    if payload is None:
        return b""
    return bytes(payload) if len(payload) <= MAX_QUESTION_BYTES else None


def _zenoh(configuration: Configuration) -> zenoh.Config:
    config = zenoh.Config()
    for path, value in configuration.values.items():
        config.insert_json5(path, json.dumps(value))
    return config
