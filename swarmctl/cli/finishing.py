"""From the end of a flight to the last of its files: what it was flown for is not lost by Ctrl-C."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
from collections.abc import Callable, Coroutine, Iterator
from types import FrameType
from typing import Any, TypeVar

from swarmctl.cli.console import INTERRUPTED

T = TypeVar("T")
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
LATE = b"the flight is over and its files are being written; Ctrl-C again leaves without them\n"
STDERR = 2


class _Loop(asyncio.SelectorEventLoop):
    """Where a flight lets go of a signal, asyncio would put a handler that ends the process at once."""

    def __init__(self, late: Callable[[int, FrameType | None], None]) -> None:
        super().__init__()
        self._late = late

    def remove_signal_handler(self, sig: int) -> bool:
        removed = super().remove_signal_handler(sig)
        signal.signal(sig, self._late)
        return removed


@contextlib.contextmanager
def unbroken() -> Iterator[Callable[[Coroutine[Any, Any, T]], T]]:
    """Gives what runs a flight. Once that has let go of its signals, the first is answered with words alone
    until this ends; the second ends the process."""
    before = {number: signal.getsignal(number) for number in SIGNALS}
    has_come = False

    def late(_number: int, _frame: FrameType | None) -> None:
        nonlocal has_come
        if has_come:
            os._exit(INTERRUPTED)
        has_come = True
        with contextlib.suppress(OSError):
            os.write(STDERR, LATE)  # a stream may be in the middle of another line's writing

    def run(flight: Coroutine[Any, Any, T]) -> T:
        with asyncio.Runner(loop_factory=lambda: _Loop(late)) as runner:
            return runner.run(flight)

    try:
        yield run
    finally:
        for number, handler in before.items():
            with contextlib.suppress(ValueError):  # not the main thread
                signal.signal(number, handler)
