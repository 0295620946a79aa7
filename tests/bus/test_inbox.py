"""Deliveries from other threads to the loop: no flood of them blocks the loop."""

from __future__ import annotations

import asyncio

import pytest

from swarmctl.bus.transports.inbox import TURN_S, Inbox
from swarmctl.flight.virtual_clock import run_virtual

pytestmark = pytest.mark.virtual


class Work:
    """Deliveries with a fixed duration on a manual clock."""

    def __init__(self, each_s: float) -> None:
        self.now_s = 0.0
        self.done: list[int] = []
        self._each_s = each_s

    def clock(self) -> float:
        return self.now_s

    def __call__(self, queue: int) -> None:
        self.now_s += self._each_s
        self.done.append(queue)


def silent(_key: str, _error: Exception) -> None:
    pass


async def turn() -> None:
    await asyncio.sleep(0)


@pytest.mark.parametrize(("each_s", "at_once"), [(0.001, 20), (0.0001, 200), (5.0, 2)])
def test_a_flood_of_deliveries_does_not_block_the_loop(each_s: float, at_once: int) -> None:
    async def scene() -> None:
        work = Work(each_s)
        inlet = Inbox(asyncio.get_running_loop(), (5000, 5000), silent, work.clock)
        for _ in range(1000):
            for queue in (0, 1):
                inlet.enqueue(queue, "", lambda queue=queue: work(queue))
        await turn()
        assert len(work.done) == pytest.approx(at_once, abs=2)
        assert work.now_s <= TURN_S + 2 * each_s
        before = len(work.done)
        await turn()
        assert len(work.done) > before

    run_virtual(scene())


def test_a_flooded_queue_does_not_starve_another() -> None:
    async def scene() -> None:
        work = Work(1.0)
        inlet = Inbox(asyncio.get_running_loop(), (5000, 5000, 5000), silent, work.clock)
        for _ in range(1000):
            inlet.enqueue(0, "", lambda: work(0))
            inlet.enqueue(1, "", lambda: work(1))
        inlet.enqueue(2, "", lambda: work(2))
        await turn()
        assert work.done == [0, 1, 2]

    run_virtual(scene())
