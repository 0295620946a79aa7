"""An event loop whose clock is virtual: a wait takes no time, it only moves the clock on.

Everything above it (agents, links, conversations) asks the running loop for the time and for its timers, so
the same code flies in real time and, on this loop, as fast as the machine computes, and equally every time.
"""

from __future__ import annotations

import asyncio
import selectors
from collections.abc import Coroutine
from typing import Any, TypeVar

T = TypeVar("T")


class Stalled(RuntimeError):
    """Every task waits for something that nobody will ever do: on a virtual clock that is a bug."""


class _Selector(selectors.DefaultSelector):
    """Instead of waiting for `timeout` seconds, moves the loop's clock on by them."""

    loop: VirtualTimeLoop

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        ready = super().select(0)
        if ready or timeout == 0:
            return ready
        if timeout is None:
            raise Stalled("nothing is left to wait for on the virtual clock")
        self.loop.advance(timeout)
        return []


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    """`time()` starts at 0 and moves only when every task waits."""

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
    """`asyncio.run` on a virtual clock."""
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(main)
