"""The two user interfaces of a flight: a live table for a terminal, and plain lines for a file or pipe."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Iterator
from typing import Protocol

from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from swarmctl.agent.phases import Phase
from swarmctl.report.live_rows import SwarmView, live_table, plain_line
from swarmctl.report.ui import Ui

LINE_EVERY_S = 30.0
"""flight time between two lines about a vehicle [s]"""
DRAW_EVERY_S = 0.1
"""shortest wall time between two pictures of the table [s]: on the virtual clock refreshes come faster"""
MESSAGE_FOR_S = 20.0
"""flight time after which a message below the table disappears [s]"""


class Terminal(Ui, Protocol):
    def shown(self) -> contextlib.AbstractContextManager[None]:
        """Show the user interface while the context is open."""


class LiveTable:
    """A table that changes in place. The last message is below; if `verbose`, a log is above the table."""

    def __init__(self, console: Console, *, verbose: bool) -> None:
        self._live = Live(console=console, auto_refresh=False)
        self._verbose = verbose
        self._message = ""
        self._message_s = 0.0
        self._view: SwarmView | None = None
        self._drawn_s = -math.inf

    @contextlib.contextmanager
    def shown(self) -> Iterator[None]:
        with self._live:
            yield
            self._message = ""
            self._draw()

    def say(self, text: str) -> None:
        self._message = text
        self._message_s = self._view.flown_s if self._view is not None else 0.0
        self.log(text)
        self._draw()

    def log(self, text: str) -> None:
        if self._verbose:
            self._live.console.print(Text(text, style="bright_black"))

    def refresh(self, view: SwarmView) -> None:
        self._view = view
        if view.flown_s - self._message_s > MESSAGE_FOR_S:
            self._message = ""
        if time.monotonic() - self._drawn_s >= DRAW_EVERY_S:
            self._draw()

    def _draw(self) -> None:
        self._drawn_s = time.monotonic()
        message = Text(self._message, style="bright_black")
        size = self._live.console.size
        body = (
            Group(live_table(self._view, size.width, size.height), message)
            if self._view is not None
            else message
        )
        self._live.update(body, refresh=True)


class PlainLines:
    """Lines for logs and pipes: one at each change of a phase, and one per vehicle every LINE_EVERY_S.

    If `verbose`, only `UiObserver` writes the changes of phases.
    """

    def __init__(self, console: Console, *, verbose: bool) -> None:
        self._console = console
        self._verbose = verbose
        self._phases: dict[str, Phase] = {}
        self._next_s = LINE_EVERY_S

    @contextlib.contextmanager
    def shown(self) -> Iterator[None]:
        yield

    def say(self, text: str) -> None:
        self._console.print(text, highlight=False, markup=False, soft_wrap=True)

    def log(self, text: str) -> None:
        if self._verbose:
            self.say(text)

    def refresh(self, view: SwarmView) -> None:
        due = view.flown_s >= self._next_s
        if due:
            self._next_s = view.flown_s + LINE_EVERY_S
            speed = "" if view.speed is None else f" at {view.speed:.1f} times real time"
            self.say(f"{view.flown_s:.0f} s of flight{speed}:")
        for row in view.rows:
            if due or (self._phases.get(row.name, row.phase) is not row.phase and not self._verbose):
                self.say("  " * due + plain_line(row))
            self._phases[row.name] = row.phase
