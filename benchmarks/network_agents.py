"""Agents that observe at random and share observations without planning; the times of their arrival."""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from rich import box
from rich.table import Table

from swarmctl.bus.network import Network, RunClock
from swarmctl.core.belief import Belief
from swarmctl.core.frames import StateShared
from swarmctl.core.inference.sensor import PERFECT, SensorModel
from swarmctl.core.observation import BeliefItem, Observation

SWARM = "bench"
ROWS = COLS = 100
CELLS_SEEN = 9
DRAIN_S = 1.0
"""time after the last observation from which a missing one counts as not delivered"""
ERRING = SensorModel(p_miss=0.1, p_false_alarm=0.02)


@dataclass
class Heard:
    """Times at which observations were merged elsewhere, by the machine's monotonic clock [s]."""

    said_s: dict[tuple[int, int], float] = field(default_factory=dict)
    recipients: dict[tuple[int, int], int] = field(default_factory=dict)
    merged: list[tuple[int, int, float]] = field(default_factory=list)
    """(observer, seq, time)"""

    def add(self, told: Sequence[BeliefItem], now_s: float) -> None:
        for item in told:
            if isinstance(item, Observation):
                self.merged.append((item.observer, item.seq, now_s))

    def figures(self) -> tuple[float, float, float]:
        """Return p50 and p99 to the last recipient [ms], and the delivered share.

        With a range, others get an observation seconds later from whom they ask: the first so many are taken
        for those it was sent to.
        """
        last, came, expected = [], 0, 0
        all_times: dict[tuple[int, int], list[float]] = {}
        for observer, seq, now_s in self.merged:
            all_times.setdefault((observer, seq), []).append(now_s)
        for name, n in self.recipients.items():
            times = sorted(all_times.get(name, ()))[:n]
            came, expected = came + len(times), expected + n
            if n and len(times) == n:
                last.append(times[-1] - self.said_s[name])
        p50, p99 = np.quantile(last, [0.5, 0.99]) * 1e3 if last else (np.nan, np.nan)
        return float(p50), float(p99), came / max(expected, 1)


class Agent:
    """An agent that observes at random, merges observations and shares its state once a second."""

    def __init__(
        self, network: Network, uav: int, heard: Heard, rows: int = ROWS, sensor: SensorModel = PERFECT
    ) -> None:
        self.uav, self.network, self.heard, self.rows = uav, network, heard, rows
        self.belief = Belief.prior(rows, rows, 200, sensor)
        self.seq = 0
        self.seen: list[tuple[tuple[int, int, bool], ...]] = []
        self.incarnation = network.join(uav, self._told)
        self._rng = np.random.default_rng(uav)
        # Side by side on a line, ten metres apart.
        network.moved(uav, 46.0, 14.0 + 1.3e-4 * uav)

    def _told(self, told: tuple[BeliefItem, ...]) -> None:
        self.belief = self.belief.merge(told)
        self.heard.add(told, time.monotonic())

    def look(self, middle: tuple[int, int] | None = None) -> None:
        cells = self.seen.pop() if middle is None and self.seen else self._cells(middle)
        self.seq += 1
        now_s = time.monotonic()
        seen = Observation(self.uav, self.seq, now_s, cells, self.incarnation)
        self.belief = self.belief.merge((seen,))
        self.heard.said_s[self.uav, self.seq] = now_s
        self.heard.recipients[self.uav, self.seq] = self.network.publish(self.uav, seen)

    def _cells(self, middle: tuple[int, int] | None = None) -> tuple[tuple[int, int, bool], ...]:
        """Return the cells of one observation."""
        row, col = middle or self._rng.integers(1, self.rows - 1, 2).tolist()
        wrong = self._rng.random(CELLS_SEEN) < self.belief.sensor.p_false_alarm
        around = [(row + i, col + j) for i in (-1, 0, 1) for j in (-1, 0, 1)]
        return tuple(
            (r, c, bool(w)) for (r, c), w in zip(around, wrong, strict=True) if max(r, c) < self.rows
        )

    def tell_state(self) -> None:
        lon_deg = 14.0 + 1.3e-4 * self.uav
        n_observed = self.belief.n_observed
        self.network.publish(self.uav, StateShared(0.0, 46.0, lon_deg, 30.0, "flying", n_observed, 0))

    async def fly(self, rate_per_s: float, begin_s: float, seconds: float) -> None:
        """Run from `begin_s` of the loop's clock on; a late agent catches up."""
        # What a sensor would show is made up beforehand: it is not what is measured.
        self.seen = [self._cells() for _ in range(round(seconds * rate_per_s))]
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._every(1.0, begin_s - 1.0, seconds + 1.0, self.tell_state))
            tasks.create_task(self._every(1.0 / rate_per_s, begin_s, seconds, self.look))

    async def _every(self, period_s: float, begin_s: float, seconds: float, act: object) -> None:
        assert callable(act)
        loop = asyncio.get_running_loop()
        phase_s = period_s * float(self._rng.random())
        for i in range(round(seconds / period_s)):
            await asyncio.sleep(begin_s + phase_s + i * period_s - loop.time())
            act()


def clock() -> RunClock:
    return RunClock(time.time() - asyncio.get_running_loop().time())


def table(title: str, *columns: str) -> Table:
    made = Table(title=f"{title}\nload of the machine {os.getloadavg()[0]:.1f}", box=box.SIMPLE_HEAD)
    for column in columns:
        made.add_column(column, justify="right")
    return made
