"""A swarm of nodes without sockets or clocks; a function delays or loses each message."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable
from itertools import count

import numpy as np

from swarmctl.bus.node.decoding import frame_decoder
from swarmctl.bus.node.exchange import Instant, NodeOptions, NodeOutput
from swarmctl.bus.node.node import Node
from swarmctl.core.belief import Belief
from swarmctl.core.frames import FrameCodec, StateShared
from swarmctl.core.observation import Observation

UNIX_S = 1_800_000_000.0
ROWS = COLS = 8
Carry = Callable[[int, int, float], float | None]
"""(sender, to, now) -> delay, or None for a lost message"""


def at_once(_sender: int, _to: int, _now_s: float) -> float | None:
    return 0.01


def state(lat_deg: float = 46.0, lon_deg: float = 14.0, phase: str = "flying") -> StateShared:
    return StateShared(0.0, lat_deg, lon_deg, 30.0, 330.0, phase, 0, 0)


class Uav:
    """A node, the belief of its agent, and its position."""

    def __init__(self, swarm: NodeSwarm, uav: int) -> None:
        self.swarm, self.uav = swarm, uav
        self.where = (46.0 + 0.001 * uav, 14.0)
        self.start()

    def start(self) -> None:
        """Start the UAV's program, or restart it; all earlier knowledge is gone."""
        incarnation = next(self.swarm.incarnations)
        rng = np.random.default_rng((self.uav, incarnation))
        swarm = self.swarm
        decode = frame_decoder(swarm.seal, ROWS, COLS)
        self.node = Node(self.uav, swarm.ids, swarm.options, swarm.seal, decode, incarnation, rng)
        self.belief = Belief.prior(ROWS, COLS, 5)
        self.seq = 0

    def observe(self, *cells: tuple[int, int, bool]) -> Observation:
        self.seq += 1
        seen = Observation(self.uav, self.seq, self.swarm.now_s, cells, self.node.incarnation)
        against = frozenset((row, col) for row, col, _ in self.belief.contradicted(cells))
        self.belief = self.belief.merge((seen,))
        self.swarm.take(self, self.node.publish(seen, self.swarm.now, against))
        return seen

    def publish_state(self) -> None:
        message = state(*self.where)
        self.swarm.take(self, self.node.publish(message, self.swarm.now))


class NodeSwarm:
    """Nodes in simulated time; `carry` delays or loses messages; each UAV sends its state every second."""

    def __init__(
        self, ids: Iterable[int], options: NodeOptions | None = None, seal: FrameCodec | None = None
    ) -> None:
        self.ids = tuple(ids)
        self.options = options or NodeOptions(ROWS, COLS)
        self.seal = seal or FrameCodec("test")
        self.incarnations = count(1)
        self.now_s = 0.0
        self.carry: Carry = at_once
        self.said: list[str] = []
        self.on_the_way: list[tuple[float, int, int, int, str, bytes]] = []
        self._order = count()
        self.uavs = {uav: Uav(self, uav) for uav in self.ids}

    @property
    def unix_s(self) -> float:
        return UNIX_S + self.now_s

    @property
    def now(self) -> Instant:
        return Instant(self.now_s, self.unix_s)

    def take(self, uav: Uav, output: NodeOutput) -> None:
        self.said += [text for _, text in output.notices]
        uav.belief = uav.belief.merge(output.news)
        for out in output.messages:
            for to in out.to:
                delay_s = self.carry(uav.uav, to, self.now_s)
                if delay_s is not None:
                    row = (self.now_s + delay_s, next(self._order), uav.uav, to, out.act, out.data)
                    heapq.heappush(self.on_the_way, row)

    def deliver(self, sender: int, to: int, act: str, data: bytes) -> None:
        uav = self.uavs[to]
        self.take(uav, uav.node.receive_bytes(sender, act, data, self.now))

    def run(self, seconds: float) -> None:
        end_s = self.now_s + seconds
        while self.now_s < end_s:
            self.now_s = min(end_s, self.now_s + 0.1)
            while self.on_the_way and self.on_the_way[0][0] <= self.now_s:
                _, _, sender, to, act, data = heapq.heappop(self.on_the_way)
                self.deliver(sender, to, act, data)
            for uav in self.uavs.values():
                if uav.node.next_deadline_s <= self.now_s:
                    self.take(uav, uav.node.tick(self.now))
            if int(self.now_s) != int(self.now_s - 0.1):
                for uav in self.uavs.values():
                    uav.publish_state()

    def agree(self) -> bool:
        """Return true if all UAVs have the same belief."""
        first, *others = (uav.belief for uav in self.uavs.values())
        return all(
            np.array_equal(first.looks, b.looks) and np.array_equal(first.hits, b.hits) for b in others
        )
