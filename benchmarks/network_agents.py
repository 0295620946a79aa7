"""Agents that make random observations and share them without planning, and the times of delivery."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Coroutine, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np

from swarmctl.bus.network import Network, RunClock
from swarmctl.core.belief import Belief
from swarmctl.core.frames import StateShared
from swarmctl.core.grid import Cell
from swarmctl.core.inference.sensor import PERFECT, SensorModel
from swarmctl.core.observation import BeliefItem, Observation
from swarmctl.flight.virtual_clock import VirtualTimeLoop

T = TypeVar("T")
SWARM = "bench"
ROWS = COLS = 100
CELLS_PER_OBSERVATION = 9
DRAIN_S = 1.0
"""time after the last observation; an observation that is missing then counts as not delivered"""
IMPERFECT = SensorModel(p_miss=0.1, p_false_alarm=0.02)


@dataclass
class DeliveryLog:
    """Times at which agents published and merged observations, by the loop's clock [s]."""

    published_s: dict[tuple[int, int], float] = field(default_factory=dict)
    """(observer, seq) -> time"""
    n_recipients: dict[tuple[int, int], int] = field(default_factory=dict)
    """(observer, seq) -> agents to which the observer sent it"""
    merged: list[tuple[int, int, float]] = field(default_factory=list)
    """(observer, seq, time)"""

    def add_merged(self, items: Sequence[BeliefItem], now_s: float) -> None:
        for item in items:
            if isinstance(item, Observation):
                self.merged.append((item.observer, item.seq, now_s))

    def statistics(self) -> tuple[float, float, float]:
        """Return p50 and p99 of the time to the last recipient [ms], and the delivered share.

        Agents out of range request the observation, and receive it seconds later. So only the first
        deliveries count, as many as the observation had recipients.
        """
        latencies_s, n_delivered, n_expected = [], 0, 0
        merge_times_s: dict[tuple[int, int], list[float]] = {}
        for observer, seq, now_s in self.merged:
            merge_times_s.setdefault((observer, seq), []).append(now_s)
        for observation, n in self.n_recipients.items():
            times_s = sorted(merge_times_s.get(observation, ()))[:n]
            n_delivered, n_expected = n_delivered + len(times_s), n_expected + n
            if n and len(times_s) == n:
                latencies_s.append(times_s[-1] - self.published_s[observation])
        p50, p99 = np.quantile(latencies_s, [0.5, 0.99]) * 1e3 if latencies_s else (np.nan, np.nan)
        return float(p50), float(p99), n_delivered / max(n_expected, 1)


class Agent:
    """An agent that makes random observations, merges received ones and shares its state once a second."""

    def __init__(
        self, network: Network, uav: int, log: DeliveryLog, rows: int = ROWS, sensor: SensorModel = PERFECT
    ) -> None:
        self.uav, self.network, self.log, self.rows = uav, network, log, rows
        self.belief = Belief.prior(rows, rows, 200, sensor)
        self.seq = 0
        self.prepared: list[tuple[tuple[int, int, bool], ...]] = []
        """cells of the next observations, drawn before the measurement"""
        self.incarnation = network.join(uav, self._merge)
        self._rng = np.random.default_rng(uav)
        # The agents stand on a line, ten metres apart.
        network.moved(uav, 46.0, 14.0 + 1.3e-4 * uav)

    def _merge(self, items: tuple[BeliefItem, ...]) -> None:
        self.belief = self.belief.merge(items)
        self.log.add_merged(items, asyncio.get_running_loop().time())

    def observe(self, middle: Cell | None = None) -> None:
        """Merge and publish one observation around `middle`, or around a random cell."""
        cells = self.prepared.pop() if middle is None and self.prepared else self._draw_cells(middle)
        self.seq += 1
        now_s = asyncio.get_running_loop().time()
        observation = Observation(self.uav, self.seq, now_s, cells, self.incarnation)
        self.belief = self.belief.merge((observation,))
        self.log.published_s[self.uav, self.seq] = now_s
        self.log.n_recipients[self.uav, self.seq] = self.network.publish(self.uav, observation)

    def _draw_cells(self, middle: Cell | None = None) -> tuple[tuple[int, int, bool], ...]:
        """Return the cells of one observation of an empty area; false alarms are random."""
        row, col = middle or self._rng.integers(1, self.rows - 1, 2).tolist()
        false_alarms = self._rng.random(CELLS_PER_OBSERVATION) < self.belief.sensor.p_false_alarm
        cells = [(row + i, col + j) for i in (-1, 0, 1) for j in (-1, 0, 1)]
        return tuple(
            (r, c, bool(occupied))
            for (r, c), occupied in zip(cells, false_alarms, strict=True)
            if max(r, c) < self.rows
        )

    def publish_state(self) -> None:
        lon_deg = 14.0 + 1.3e-4 * self.uav
        n_observed = self.belief.n_observed
        self.network.publish(self.uav, StateShared(0.0, 46.0, lon_deg, 30.0, 330.0, "flying", n_observed, 0))

    async def fly(self, rate_per_s: float, begin_s: float, duration_s: float) -> None:
        """Observe and share from `begin_s` of the loop's clock on; an agent that is late catches up."""
        # The sensor's results are drawn first, because the benchmark does not measure their cost.
        self.prepared = [self._draw_cells() for _ in range(round(duration_s * rate_per_s))]
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._repeat(1.0, begin_s - 1.0, duration_s + 1.0, self.publish_state))
            tasks.create_task(self._repeat(1.0 / rate_per_s, begin_s, duration_s, self.observe))

    async def _repeat(self, period_s: float, begin_s: float, duration_s: float, action: object) -> None:
        assert callable(action)
        loop = asyncio.get_running_loop()
        phase_s = period_s * float(self._rng.random())
        for i in range(round(duration_s / period_s)):
            await asyncio.sleep(begin_s + phase_s + i * period_s - loop.time())
            action()


class IdleCoreLoop(VirtualTimeLoop):
    """A loop on a core of its own: time passes as this process uses CPU, and waits take no time.

    So other processes of the machine do not change the latencies, except through the shared caches.
    """

    def time(self) -> float:
        return super().time() + time.process_time()


def run_on_idle_core(main: Coroutine[Any, Any, T]) -> T:
    with asyncio.Runner(loop_factory=IdleCoreLoop) as runner:
        return runner.run(main)


def make_clock() -> RunClock:
    """Return a clock whose zero is that of the running loop."""
    return RunClock(time.time() - asyncio.get_running_loop().time())
