"""An event loop with a virtual clock: a wait takes no time and only advances the clock.

Agents, links and conversations take time and timers from the running loop. So the same code flies in real
time or on this loop. On this loop a flight runs as fast as the machine computes, and is repeatable.
"""

from __future__ import annotations

import asyncio
import selectors
from collections.abc import Coroutine
from typing import Any, TypeVar

T = TypeVar("T")


class Stalled(RuntimeError):
    """A loop in which every task waits and no timer is left; on a virtual clock this is a bug."""


class _Selector(selectors.DefaultSelector):
    """A selector that advances the loop's clock by `timeout` seconds instead of waiting."""

    loop: VirtualTimeLoop

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        if timeout == 0:
            return []  # callbacks are ready; sockets come next, before the clock advances
        if ready := super().select(0):
            return ready
        if timeout is None:
            raise Stalled("nothing is left to wait for on the virtual clock")
        self.loop.advance(timeout)
        return []


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    """An event loop whose `time()` starts at 0 and advances only when every task waits."""

    def __init__(self) -> None:
        selector = _Selector()
        self._virtual_now_s = 0.0
        super().__init__(selector)
        selector.loop = self

    def time(self) -> float:
        return self._virtual_now_s

    def advance(self, seconds: float) -> None:
        self._virtual_now_s += seconds


def run_virtual(main: Coroutine[Any, Any, T]) -> T:
    """Run a coroutine like `asyncio.run`, on a virtual clock."""
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(main)
