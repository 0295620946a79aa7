"""The agents of this process on the swarm's network: nodes, the model of the radio, and a transport."""

from __future__ import annotations

import asyncio
import heapq
import itertools
import time
import traceback
from collections import Counter, deque
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import Protocol, TypeVar

import numpy as np

from swarmctl.bus import keys
from swarmctl.bus.backlog import Backlog, Said
from swarmctl.bus.node.counters import Tally
from swarmctl.bus.node.decoding import reader
from swarmctl.bus.node.exchange import NodeOptions, Out, Took
from swarmctl.bus.node.ledger import Ledger
from swarmctl.bus.node.node import Node
from swarmctl.bus.radio import Lost, Radio
from swarmctl.bus.transports.base import Transport
from swarmctl.bus.transports.inbox import TURN_S
from swarmctl.core.frames import (
    IntentShared,
    Seal,
    Snapshot,
    SnapshotAsked,
    Spoken,
    StateShared,
    Why,
)
from swarmctl.core.grid import Cell
from swarmctl.core.observation import Observation, Told
from swarmctl.core.texts import printable

UNHURRIED_S = 0.005
"""of a turn for what is unhurried where other things are said, and one message at least"""
T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)
OnTold = Callable[[tuple[Told, ...]], None]
MAX_SAID = 10
"""lines of one topic, a UAV; all of it is counted"""


@dataclass(frozen=True, slots=True)
class RunClock:
    """The times of a run, from the running loop's clock."""

    unix_s_at_zero: float
    """the wall time at which the loop's clock showed 0"""
    speedup: float = 1.0
    """simulated seconds in one of the loop's"""

    def now_s(self) -> float:
        """simulated seconds of the loop's clock"""
        return asyncio.get_running_loop().time() * self.speedup

    def unix_s(self) -> float:
        return self.unix_s_at_zero + asyncio.get_running_loop().time()

    def call_at(self, now_s: float, call: Callable[[], None]) -> asyncio.TimerHandle:
        """Call at a simulated time."""
        return asyncio.get_running_loop().call_at(now_s / self.speedup, call)


@dataclass(slots=True)
class _Member:
    node: Node
    on_told: OnTold
    timer: asyncio.TimerHandle | None = None
    timer_s: float = float("inf")
    said: Counter[str] = field(default_factory=Counter)
    """lines, by topic"""
    news: list[Told] = field(default_factory=list)
    """that its agent has not been told yet"""


class Network:
    """The swarm as far as it is in this process, on one transport; `close` ends its timers.

    `uavs` are the system ids of the whole swarm. What the radio model does to a message it does where the
    message is sent, but for distance, which is judged where it is heard.
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
        seal: Seal | None = None,
        seed: int = 0,
        say: Callable[[int, str], None] = lambda _uav, _text: None,
    ) -> None:
        self._transport = transport
        self._swarm = swarm
        self._uavs = frozenset(uavs)
        self._options = options
        self._clock = clock
        self._radio = None if radio is None or radio.is_transparent else radio
        self._seal = seal or Seal(swarm)
        self._read = reader(self._seal, options.rows, options.cols)
        self._ledger = Ledger(uavs, options)
        self._seed = seed
        self._say = say
        self._start_s = clock.now_s()
        self._members: dict[int, _Member] = {}
        self._hearers = lru_cache(maxsize=1024)(self._ledger.hearers)
        # Of what comes by radio, and of what is to be passed on, there is more to say than that it is news.
        self._is_plain = self._radio is None and not options.relay
        self._said = Backlog()
        """by UAVs of this process, on its way to others of it"""
        self._unhurried = Backlog()
        """the same of questions for what was missed, and of the answers: long, and no longer new"""
        self._untold: deque[_Member] = deque()
        """with news"""
        self._is_handing_over = False
        self._flying: list[tuple[float, int, Callable[[], None]]] = []
        """when it arrives, which it was of all that was sent, and what is to be done then"""
        self._sent = itertools.count()
        self._closed = False

    def join(self, uav: int, on_told: OnTold) -> int:
        """Deliver to `on_told` what others saw and was not known to `uav`; returns its incarnation."""
        # Milliseconds of the wall clock: greater each time the program is started.
        incarnation = round(self._clock.unix_s() * 1000.0)
        rng = np.random.default_rng(np.random.SeedSequence(self._seed, spawn_key=(4, uav)))
        hears = None if self._radio is None else self._radio.hears
        node = Node(
            uav, self._uavs, self._options, self._seal, incarnation, rng, hears, self._read, self._ledger
        )
        if (before := self._members.get(uav)) is not None and before.timer is not None:
            before.timer.cancel()
        self._members[uav] = _Member(node, on_told)
        self._transport.subscribe(keys.inbox(self._swarm, uav), partial(self._received, uav))
        self._arm(self._members[uav])
        return incarnation

    def publish(self, uav: int, message: Spoken, against: frozenset[Cell] = frozenset()) -> int:
        """Send to everyone in the UAV's range; returns how many that were.

        `against` are the cells that it saw otherwise than others had told.
        """
        took = self._members[uav].node.say(message, self._now_s(), self._clock.unix_s(), against)
        if isinstance(message, StateShared):
            self._transport.put(keys.to_station(self._swarm, uav), took.out[0].data)
        self._perform(self._members[uav], took)
        return len(took.out[0].to)

    def moved(self, uav: int, lat_deg: float, lon_deg: float) -> None:
        """Where a UAV is, oftener than it tells others."""
        self._members[uav].node.moved((lat_deg, lon_deg))

    def states(self, uav: int) -> dict[int, StateShared]:
        """The newest that it has heard of each of the others."""
        return self._members[uav].node.states()

    def intents(self, uav: int) -> dict[int, tuple[IntentShared, float]]:
        """The newest that it has heard of where each of the others will be, and how old that is [s of the
        vehicles' time]; never below 0, however clocks differ."""
        unix_s, pace = self._clock.unix_s(), self._clock.speedup
        told = self._members[uav].node.intents().items()
        return {other: (intent, max(unix_s - said_s, 0.0) * pace) for other, (intent, said_s) in told}

    def tally(self, uav: int) -> Tally:
        return self._members[uav].node.tally

    def tallies(self) -> dict[int, Tally]:
        """Of the UAVs of this process, by system id."""
        return {uav: member.node.tally for uav, member in self._members.items()}

    def close(self) -> None:
        self._closed = True
        for member in self._members.values():
            if member.timer is not None:
                member.timer.cancel()

    def _now_s(self) -> float:
        """simulated, since the network was opened [s]"""
        return self._clock.now_s() - self._start_s

    def _received(self, uav: int, key: str, payload: bytes) -> None:
        if self._closed:
            return
        member = self._members[uav]
        if key == keys.looks(self._swarm, uav):
            return  # its own sensor's, who has an inlet of its own
        origin = keys.origin_of(key)
        if origin is None:
            member.node.refuse(Why.WILDCARD if keys.is_wild(key) else Why.SOURCE, None)
            return
        sender, act = origin
        try:
            now_s, unix_s = self._now_s(), self._clock.unix_s()
            self._perform(member, member.node.receive(sender, act, payload, now_s, unix_s))
        except Exception:  # noqa: BLE001 - nothing that comes from outside may end a flight
            self._bug(member, sender)

    def _bug(self, member: _Member, sender: int | None) -> None:
        """While it is being handled."""
        member.node.refuse(Why.MALFORMED, sender)
        said = f"a bug in handling a message: {traceback.format_exc(limit=-2)}"
        self._tell(member, [("bug", said)])

    def _perform(self, member: _Member, took: Took) -> None:
        self._see_to(member, took)
        if took.news:
            member.on_told(tuple(took.news))

    def _see_to(self, member: _Member, took: Took) -> None:
        """All but what is the agent's."""
        for out in took.out:
            self._send(member.node, out)
        if took.said:
            self._tell(member, took.said)
        if member.node.next_deadline_s != member.timer_s:
            self._arm(member)

    def _send(self, node: Node, out: Out) -> None:
        if self._radio is None:
            self._carry(node.uav, out.act, out.data, out.to)
            return
        for to in out.to:
            now_s = self._now_s()
            arrives_s = self._radio.send(node.uav, to, len(out.data), now_s)
            if isinstance(arrives_s, Lost):
                node.tally.lost[arrives_s] += 1
            elif arrives_s <= now_s:
                self._carry(node.uav, out.act, out.data, (to,))
            else:
                carry = partial(self._carry, node.uav, out.act, out.data, (to,))
                self._on_its_way(arrives_s, carry)

    def _on_its_way(self, arrives_s: float, carry: Callable[[], None]) -> None:
        """What arrives at one moment arrives in the order in which it was sent; a loop's timers need not."""
        heapq.heappush(self._flying, (arrives_s, next(self._sent), carry))
        if self._flying[0][0] == arrives_s:
            self._clock.call_at(self._start_s + arrives_s, partial(self._arrive, arrives_s))

    def _arrive(self, now_s: float) -> None:
        now_s = max(now_s, self._now_s())  # a loop may call a little early
        while self._flying and self._flying[0][0] <= now_s:
            heapq.heappop(self._flying)[2]()
        if self._flying and not self._closed:
            next_s = self._flying[0][0]
            self._clock.call_at(self._start_s + next_s, partial(self._arrive, next_s))

    def _carry(self, sender: int, act: str, data: bytes, to: tuple[int, ...]) -> None:
        """UAVs of this process are handed it in the loop's next turn; for the others it is put."""
        if self._closed:
            return
        here = to if len(self._members) == len(self._uavs) else tuple(u for u in to if u in self._members)
        if here:
            reading = self._read(data)
            takes_long = isinstance(reading.frame.content, SnapshotAsked | Snapshot)
            backlog = self._unhurried if takes_long else self._said
            for unheard in backlog.append(Said(sender, act, reading, here)):
                self._is_lost(unheard)
            self._hand_over_soon()
        if len(here) < len(to):
            for uav in to:
                if uav not in self._members:
                    self._transport.put(keys.told(self._swarm, uav, act, sender), data)

    def _is_lost(self, said: Said) -> None:
        """There was no more room for it."""
        for member in map(self._members.__getitem__, said.to):
            lost = member.node.tally.lost
            if not lost[Lost.OVERLOAD]:
                text = "more is said than this machine can hear; some is lost (said once, all is counted)"
                self._tell(member, [(Lost.OVERLOAD, text)])
            lost[Lost.OVERLOAD] += 1

    def _hand_over_soon(self) -> None:
        if not self._is_handing_over:
            self._is_handing_over = True
            asyncio.get_running_loop().call_soon(self._hand_over)

    def _hand_over(self) -> None:
        """To the nodes what was said just now, to the agents their news, and a little of what is unhurried.

        The more is said in the meantime, the less each of it takes: an agent is told of all of it at once.
        Each has a turn of its own: where more is said than can be heard, nothing is left of another's.
        """
        self._is_handing_over = False
        if self._closed:
            return
        now_s, unix_s = self._now_s(), self._clock.unix_s()
        rest_s = UNHURRIED_S if self._said else TURN_S
        for said in _within(TURN_S, self._said):
            self._hear(said, now_s, unix_s)
        for member in _within(TURN_S, self._untold):
            self._tell_news(member)
        for said in _within(rest_s, self._unhurried):
            self._hear(said, now_s, unix_s)
        if self._said or self._untold or self._unhurried:
            self._hand_over_soon()

    def _hear(self, said: Said, now_s: float, unix_s: float) -> None:
        """To all of this process to whom it goes."""
        sender, act, reading, _ = said
        for uav in self._take_at_once(said, now_s, unix_s):
            member = self._members[uav]
            try:
                took = member.node.hear(sender, act, reading, now_s, unix_s)
                self._see_to(member, took)
                self._is_new_to(member, took.news)
            except Exception:  # noqa: BLE001 - a bug in one message is none in the others
                self._bug(member, sender)

    def _take_at_once(self, said: Said, now_s: float, unix_s: float) -> Collection[int]:
        """By all to whom there is nothing else to say; returns the others."""
        sender, act, reading, to = said
        if not self._is_plain:
            return to
        takes = self._ledger.take(sender, act, reading, self._hearers(to), now_s, unix_s)
        taken = self._ledger.uavs(takes)
        if isinstance(seen := reading.frame.content, Observation):
            news = (seen,)
            for uav in taken:
                self._is_new_to(self._members[uav], news)
        if len(taken) == len(to):
            return ()
        done = set(taken)
        return [uav for uav in to if uav not in done]

    def _is_new_to(self, member: _Member, news: Sequence[Told]) -> None:
        if news and not member.news:
            self._untold.append(member)
        member.news += news

    def _tell_news(self, member: _Member) -> None:
        news, member.news = member.news, []
        try:
            member.on_told(tuple(news))
        except Exception:  # noqa: BLE001 - a bug in one agent is none in the others
            self._bug(member, None)

    def _tell(self, member: _Member, said: list[tuple[str, str]]) -> None:
        for topic, text in said:
            member.said[topic] += 1
            if member.said[topic] <= MAX_SAID:
                # It may quote the sender, and is shown on a terminal.
                self._say(member.node.uav, printable(text[:400]))

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
        # A loop may call a little early: by then it is that late.
        now_s = max(self._now_s(), member.node.next_deadline_s)
        self._perform(member, member.node.tick(now_s, self._clock.unix_s()))


class _Waiting(Protocol[T_co]):
    def __len__(self) -> int: ...
    def popleft(self) -> T_co: ...


def _within(seconds: float, waiting: _Waiting[T]) -> Iterator[T]:
    """What waits, one after the other, until so much time has passed."""
    until_s = time.perf_counter() + seconds
    while waiting:
        yield waiting.popleft()
        if time.perf_counter() > until_s:
            return
