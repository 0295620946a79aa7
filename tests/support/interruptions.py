"""Silent vehicles, and Ctrl-C."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from swarmctl.flight import task_tree
from swarmctl.links.transports.base import Address


def silent(since_s: float, until_s: float = float("inf")) -> Any:
    """Cut the link of uav2 between two times; afterwards it sends from another address."""

    def address_of(sysid: int, now: float) -> Address | None:
        if sysid != 2 or now < since_s:
            return ("simulated", sysid)
        return None if now < until_s else ("new", 1)

    return address_of


def interrupting(*times_s: float) -> Any:
    """Press Ctrl-C at these times."""
    due = list(times_s)

    def address_of(sysid: int, now: float) -> Address | None:
        if due and now >= due[0]:
            due.pop(0)
            signal.raise_signal(signal.SIGINT)
        return ("simulated", sysid)

    return address_of


def interrupts(monkeypatch: pytest.MonkeyPatch) -> list[Callable[[], None]]:
    """Return a list to which each following flight appends its Ctrl-C, as a function.

    One process has one handler of signals, and a test may have several flights.
    """
    pressed: list[Callable[[], None]] = []

    @contextlib.contextmanager
    def signals(interrupted: Callable[[], None]) -> Iterator[None]:
        pressed.append(interrupted)
        yield

    monkeypatch.setattr(task_tree, "_signals", signals)
    return pressed
