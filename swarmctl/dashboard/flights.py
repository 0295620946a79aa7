"""Flights that the set-up has started: processes of their own, shown from their growing records."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Protocol

import msgspec

from swarmctl.config.scenario import Scenario
from swarmctl.dashboard.model import Timeline
from swarmctl.dashboard.orders_panel import Send
from swarmctl.dashboard.server import in_background
from swarmctl.dashboard.sources.recording import RecordSource
from swarmctl.report.record import record_path
from swarmctl.report.record_file import RecordError

LOOK_EVERY_S = 0.2
"""interval in which a flight that has just been started is looked at [s]"""


class FlightProcess(Protocol):
    """A process of `swarmctl fly`."""

    folder: Path
    """run folder"""

    def is_over(self) -> bool:
        """Return True once the process has ended."""

    def output(self) -> list[str]:
        """Return the lines that the process has printed."""


StartProcess = Callable[[Path, Scenario, Sequence[str]], FlightProcess]
"""starts a flight of a configuration; the names are those of the real vehicles, as a person has typed them.
Raises NotStarted."""


class NotStarted(Exception):
    """A flight that has not begun; the text has the reasons."""


class StartedFlight(msgspec.Struct, frozen=True):
    process: FlightProcess
    timeline: Timeline
    send: Send
    reading: asyncio.Task[None]
    """reads the record"""


class Flights:
    """The flights of one set-up, one after the other."""

    def __init__(self, start: StartProcess, send_to: Callable[[str, Path], Send]) -> None:
        """`send_to` returns the sender of commands to a flight, from the names of swarm and record."""
        self._start, self._send_to = start, send_to
        self._started: list[StartedFlight] = []
        self._is_starting = False

    def __getitem__(self, number: int) -> StartedFlight:
        """Return a flight by its number, from 1. Raises IndexError."""
        if not 1 <= number <= len(self._started):
            raise IndexError(f"flight {number}: the set-up has started {len(self._started)}")
        return self._started[number - 1]

    @property
    def newest(self) -> int:
        """Number of the newest flight; 0: none."""
        return len(self._started)

    @property
    def is_flying(self) -> bool:
        return bool(self._started) and not self._started[-1].process.is_over()

    async def start(self, config: Path, scenario: Scenario, real: Sequence[str]) -> int:
        """Start a flight, and return its number once it has begun its record. Raises NotStarted."""
        if self._is_starting or self.is_flying:
            raise NotStarted("a flight of this set-up is in progress [flight-in-progress]")
        self._is_starting = True
        try:
            process = self._start(config, scenario, real)
            while not record_path(process.folder).exists():
                if process.is_over():
                    raise NotStarted("\n".join(process.output()))
                await asyncio.sleep(LOOK_EVERY_S)
            try:
                source = RecordSource(process.folder, "live file")
            except RecordError as error:
                raise NotStarted(str(error)) from error
            reading = in_background(source.run())
            send = self._send_to(scenario.config.name, record_path(process.folder))
            self._started.append(StartedFlight(process, source.timeline, send, reading))
        finally:
            self._is_starting = False
        return self.newest
