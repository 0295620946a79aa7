"""Network of this process's agents: their nodes, the radio model, and a transport."""

from __future__ import annotations

import asyncio
import heapq
import itertools
import traceback
from collections import Counter, deque
from collections.abc import Callable, Collection, Iterable, Iterator, Sized
from dataclasses import dataclass, field
from functools import partial

import msgspec
import numpy as np

from swarmctl.bus import keys
from swarmctl.bus.backlog import Backlog, QueuedMessage
from swarmctl.bus.node.decoding import frame_decoder
from swarmctl.bus.node.exchange import (
    Instant,
    NetworkCounters,
    NewestT,
    NodeOptions,
    NodeOutput,
    OutgoingMessage,
)
from swarmctl.bus.node.node import Node
from swarmctl.bus.radio import LossReason, Radio
from swarmctl.bus.transports.base import Transport
from swarmctl.bus.transports.inbox import TURN_S
from swarmctl.core.frames import (
    AgentMessage,
    FrameCodec,
    RefusalReason,
    Snapshot,
    SnapshotAsked,
    StateShared,
)
from swarmctl.core.grid import Cell
from swarmctl.core.observation import BeliefItem, Observation
from swarmctl.core.operator_text import excerpt

SLOW_SLICE_S = 0.005
"""time slice for requests and their answers while other messages wait; at least one message is delivered"""
OnNews = Callable[[tuple[BeliefItem, ...]], None]
MAX_LINES = 10
"""largest number of shown lines for each topic and UAV; the counters count all"""


class RunClock(msgspec.Struct, frozen=True):
    """The times of a run, derived from the event loop's clock."""

    unix_s_at_zero: float
    """wall time at time 0 of the loop's clock [s since 1970]"""
    speedup: float = 1.0
    """simulated seconds per second of the loop's clock"""

    def now_s(self) -> float:
        """Return the simulated time [s]."""
        return asyncio.get_running_loop().time() * self.speedup

    def unix_s(self) -> float:
        return self.unix_s_at_zero + asyncio.get_running_loop().time()

    def call_at(self, now_s: float, call: Callable[[], None]) -> asyncio.TimerHandle:
        """Schedule a call at a simulated time."""
        return asyncio.get_running_loop().call_at(now_s / self.speedup, call)


@dataclass(slots=True)
class _Member:
    node: Node
    on_news: OnNews
    timer: asyncio.TimerHandle | None = None
    timer_s: float = float("inf")
    n_lines: Counter[str] = field(default_factory=Counter)
    """number of lines shown, by topic"""
    news: list[BeliefItem] = field(default_factory=list)
    """new observations that the agent has not received yet"""


class Network:
    """The network of this process's agents, on one transport; `close` ends the timers.

    `uavs` are the system ids of the whole swarm. The sender applies the radio model, except for the distance:
    the receiver checks the distance.
    """

    def __init__(
        self,
        transport: Transport,
        swarm: str,
        uavs: Collection[int],
        options: NodeOptions,
        *,
        clock: RunClock,
        radio: Radio | None = None,
        codec: FrameCodec | None = None,
        seed: int = 0,
        say: Callable[[int, str], None] = lambda _uav, _text: None,
    ) -> None:
        self._transport = transport
        self._swarm = swarm
        self._uavs = frozenset(uavs)
        self._options = options
        self._clock = clock
        self._radio = None if radio is None or radio.is_transparent else radio
        self._codec = codec or FrameCodec(swarm)
        self._decode = frame_decoder(self._codec, options.rows, options.cols)
        self._seed = seed
        self._say = say
        self._start_s = clock.now_s()
        self._members: dict[int, _Member] = {}
        self._queue = Backlog()
        """messages between UAVs of this process"""
        self._slow_queue = Backlog()
        """requests for missed observations and their answers: long, and less urgent"""
        self._members_with_news: deque[_Member] = deque()
        self._is_delivery_scheduled = False
        self._arrivals: list[tuple[float, int, Callable[[], None]]] = []
        """(time of arrival, number in the order of sending, delivery)"""
        self._send_numbers = itertools.count()
        self._closed = False

    def join(self, uav: int, on_news: OnNews) -> int:
        """Add a UAV and return its incarnation; `on_news` gets the new observations of other UAVs."""
        # The incarnation, in milliseconds of the wall clock, grows with each start of the program.
        incarnation = round(self._clock.unix_s() * 1000.0)
        rng = np.random.default_rng(np.random.SeedSequence(self._seed, spawn_key=(4, uav)))
        distance_loss = None if self._radio is None else self._radio.distance_loss
        node = Node(
            uav,
            self._uavs,
            self._options,
            self._codec,
            self._decode,
            incarnation,
            rng,
            distance_loss,
        )
        if (before := self._members.get(uav)) is not None and before.timer is not None:
            before.timer.cancel()
        self._members[uav] = _Member(node, on_news)
        self._transport.subscribe(keys.inbox(self._swarm, uav), partial(self._received, uav))
        self._arm(self._members[uav])
        return incarnation

    def publish(
        self,
        uav: int,
        message: AgentMessage,
        against: frozenset[Cell] = frozenset(),
        group: tuple[int, ...] = (),
    ) -> int:
        """Send a message to all UAVs in communication range; return the number of receivers.

        `against`: cells in which the agent's observation contradicts earlier reports of other UAVs.
        `group`: the receivers of a MemberShared.
        """
        member = self._members[uav]
        output = member.node.publish(message, self._now(), against, group)
        first = output.messages[0]
        # The station hears from every vehicle, also from those that have nobody in range.
        if isinstance(message, StateShared):
            key = keys.to_station(self._swarm, uav)
        else:
            key = keys.copy_to_station(self._swarm, first.act, uav)
        self._transport.put(key, first.data)
        self._perform(member, output)
        return len(first.to)

    def restore(self, uav: int, observations: Iterable[tuple[float, Observation]]) -> None:
        """Give a UAV its own observations of earlier incarnations, each with its unix time [s]."""
        self._members[uav].node.restore(observations)

    def moved(self, uav: int, lat_deg: float, lon_deg: float) -> None:
        """Update a UAV's position between two state messages."""
        self._members[uav].node.moved((lat_deg, lon_deg))

    def set_range(self, uav: int, k: int | None) -> None:
        """Let a UAV send to the `k` nearest UAVs from now on; None: to all."""
        self._members[uav].node.k = k

    def take_new(self, uav: int, kind: type[NewestT]) -> tuple[tuple[int, float, NewestT], ...]:
        """Return (sender, age, message) of each UAV with a new message of this kind, as received by `uav`.

        The age is in simulated seconds, and 0 or more even if the clocks differ.
        """
        unix_s, speedup = self._clock.unix_s(), self._clock.speedup
        taken = self._members[uav].node.take_new(kind)
        return tuple(
            (other, max(unix_s - sent_s, 0.0) * speedup, message) for other, (sent_s, message) in taken
        )

    @property
    def counters(self) -> dict[int, NetworkCounters]:
        """Counters of the UAVs of this process, by system id."""
        return {uav: member.node.counters for uav, member in self._members.items()}

    def close(self) -> None:
        self._closed = True
        for member in self._members.values():
            if member.timer is not None:
                member.timer.cancel()

    def _now(self) -> Instant:
        """Return the simulated time since the network was opened, and the wall clock."""
        return Instant(self._clock.now_s() - self._start_s, self._clock.unix_s())

    def _received(self, uav: int, key: str, payload: bytes) -> None:
        if self._closed:
            return
        member = self._members[uav]
        if key == keys.sensor_report(self._swarm, uav):
            return  # a report of the vehicle's payload, handled by `external_observations`
        origin = keys.sender_of(key)
        if origin is None:
            why = RefusalReason.WILDCARD if keys.is_wild(key) else RefusalReason.SOURCE
            member.node.count_refusal(why, None)
            return
        sender, act = origin
        try:
            self._perform(member, member.node.receive_bytes(sender, act, payload, self._now()))
        except Exception:  # noqa: BLE001 - no message from outside may end a flight
            self._report_bug(member, sender)
        if self._members_with_news:
            self._schedule_delivery()

    def _report_bug(self, member: _Member, sender: int | None) -> None:
        """Report the exception that is being handled."""
        member.node.count_refusal(RefusalReason.MALFORMED, sender)
        text = f"a bug in this program; please report it; a message is lost: {traceback.format_exc(limit=-2)}"
        self._show(member, [("bug", text)])

    def _perform(self, member: _Member, output: NodeOutput) -> None:
        """Send the messages, show the notices, queue the news and set the timer."""
        for out in output.messages:
            self._send(member.node, out)
        if output.notices:
            self._show(member, output.notices)
        if output.news:
            if not member.news:
                self._members_with_news.append(member)
            member.news += output.news
        if member.node.next_deadline_s != member.timer_s:
            self._arm(member)

    def _send(self, node: Node, out: OutgoingMessage) -> None:
        if self._radio is None:
            self._dispatch(node.uav, out.act, out.data, out.to)
            return
        for to in out.to:
            now_s = self._now().run_s
            arrives_s = self._radio.send(node.uav, to, len(out.data), now_s)
            if isinstance(arrives_s, LossReason):
                node.counters.lost[arrives_s] += 1
            elif arrives_s <= now_s:
                self._dispatch(node.uav, out.act, out.data, (to,))
            else:
                dispatch = partial(self._dispatch, node.uav, out.act, out.data, (to,))
                self._schedule_arrival(arrives_s, dispatch)

    def _schedule_arrival(self, arrives_s: float, dispatch: Callable[[], None]) -> None:
        """Schedule a delivery; equal times keep the order of sending, unlike the loop's own timers."""
        heapq.heappush(self._arrivals, (arrives_s, next(self._send_numbers), dispatch))
        if self._arrivals[0][0] == arrives_s:
            self._clock.call_at(self._start_s + arrives_s, partial(self._arrive, arrives_s))

    def _arrive(self, now_s: float) -> None:
        now_s = max(now_s, self._now().run_s)  # a loop may call a little early
        while self._arrivals and self._arrivals[0][0] <= now_s:
            heapq.heappop(self._arrivals)[2]()
        if self._arrivals and not self._closed:
            next_s = self._arrivals[0][0]
            self._clock.call_at(self._start_s + next_s, partial(self._arrive, next_s))

    def _dispatch(self, sender: int, act: str, data: bytes, to: tuple[int, ...]) -> None:
        """Queue a message for receivers in this process; put it on the transport for other receivers."""
        if self._closed:
            return
        local = to if len(self._members) == len(self._uavs) else tuple(u for u in to if u in self._members)
        if local:
            decoded = self._decode(data)
            takes_long = isinstance(decoded.frame.content, SnapshotAsked | Snapshot)
            backlog = self._slow_queue if takes_long else self._queue
            for dropped in backlog.append(QueuedMessage(decoded, local)):
                self._count_lost(dropped)
            self._schedule_delivery()
        if len(local) < len(to):
            for uav in to:
                if uav not in self._members:
                    self._transport.put(keys.uav_message(self._swarm, uav, act, sender), data)

    def _count_lost(self, queued: QueuedMessage) -> None:
        """Count a message dropped from a full queue as lost for each receiver."""
        for member in map(self._members.__getitem__, queued.to):
            lost = member.node.counters.lost
            if not lost[LossReason.OVERLOAD]:
                text = (
                    "this machine is too slow for the swarm's messages; some are dropped (`lost` in the "
                    "summary counts them), and missing observations are requested again [bus-overload]"
                )
                self._show(member, [(LossReason.OVERLOAD, text)])
            lost[LossReason.OVERLOAD] += 1

    def _schedule_delivery(self) -> None:
        if not self._is_delivery_scheduled:
            self._is_delivery_scheduled = True
            asyncio.get_running_loop().call_soon(self._deliver)

    def _deliver(self) -> None:
        """Deliver messages to nodes, then news to agents, then a few of the slow messages.

        An agent receives all its news in one call, so the cost per message falls with the load. Each queue
        has its own time slice, so an overloaded queue cannot block the other queues.
        """
        self._is_delivery_scheduled = False
        if self._closed:
            return
        now = self._now()
        slow_slice_s = SLOW_SLICE_S if self._queue else TURN_S
        for _ in _within(TURN_S, self._queue):
            self._deliver_message(self._queue.popleft(), now)
        for _ in _within(TURN_S, self._members_with_news):
            self._deliver_news(self._members_with_news.popleft())
        for _ in _within(slow_slice_s, self._slow_queue):
            self._deliver_message(self._slow_queue.popleft(), now)
        if self._queue or self._members_with_news or self._slow_queue:
            self._schedule_delivery()

    def _deliver_message(self, queued: QueuedMessage, now: Instant) -> None:
        decoded, to = queued
        for uav in to:
            member = self._members[uav]
            try:
                self._perform(member, member.node.receive(decoded, now))
            except Exception:  # noqa: BLE001 - a bug with one message does not affect the others
                self._report_bug(member, decoded.frame.sender)

    def _deliver_news(self, member: _Member) -> None:
        news, member.news = member.news, []
        try:
            member.on_news(tuple(news))
        except Exception:  # noqa: BLE001 - a bug in one agent does not affect the others
            self._report_bug(member, None)

    def _show(self, member: _Member, notices: list[tuple[str, str]]) -> None:
        for topic, text in notices:
            member.n_lines[topic] += 1
            if member.n_lines[topic] <= MAX_LINES:
                self._say(member.node.uav, excerpt(text))

    def _arm(self, member: _Member) -> None:
        if self._closed:
            return
        deadline_s = member.node.next_deadline_s
        if member.timer is not None:
            member.timer.cancel()
        member.timer, member.timer_s = None, deadline_s
        if deadline_s < float("inf"):
            member.timer = self._clock.call_at(self._start_s + deadline_s, partial(self._tick, member))

    def _tick(self, member: _Member) -> None:
        member.timer, member.timer_s = None, float("inf")
        # A loop may call a little early.
        now = self._now()
        now = now._replace(run_s=max(now.run_s, member.node.next_deadline_s))
        self._perform(member, member.node.tick(now))
        if self._members_with_news:
            self._schedule_delivery()


def _within(seconds: float, waiting: Sized) -> Iterator[None]:
    """Yield while items wait, for `seconds` by the loop's clock, and at least once for an item.

    On a virtual clock this handles all items: the order of a run must not depend on the machine's speed.
    """
    loop = asyncio.get_running_loop()
    until_s = loop.time() + seconds
    while waiting:
        yield
        if loop.time() > until_s:
            return
