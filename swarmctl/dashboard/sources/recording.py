"""The source for `run.mcap`: a recorded run, or the record of a flight in progress.

The record is read in short slices between which the page is served. So the first part is shown at once, and
each part can be shown as soon as it is read.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from pathlib import Path

from swarmctl.config.scenario import build
from swarmctl.dashboard.model import Timeline
from swarmctl.dashboard.picture import SourceKind
from swarmctl.dashboard.sources.record_facts import RecordFacts
from swarmctl.report.record import record_path
from swarmctl.report.record_file import RecordError, RecordStream, damaged

SLICE_S = 0.03
"""longest time of reading without serving the page [s]"""
LOOK_EVERY_S = 0.2
"""interval in which a record that grows is looked at [s]"""
CUT = "the record has no end: the process that wrote it died, or still writes it [record-open]"
QUIET_AFTER_S = 5.0
"""time without growth after which the operator is told [s]; a flight writes each second"""


class RecordSource:
    """A record, read into a timeline. `close` ends the reading."""

    def __init__(self, run: Path, kind: SourceKind, *, clock: Callable[[], float] = time.monotonic) -> None:
        """Open a run folder or its `run.mcap`. Raises RecordError."""
        self._stream = RecordStream(record_path(run))
        self._clock = clock
        try:
            scenario = build(self._stream.configuration())
        except RecordError:
            self._stream.close()
            raise
        self.timeline = Timeline(scenario, kind)
        self._facts: RecordFacts | None = None
        self._messages = self._stream.chunks()
        self._grew_s = clock()

    @property
    def is_read(self) -> bool:
        """True if everything that the file has, or will have, is read."""
        return self._stream.is_complete

    def close(self) -> None:
        self._stream.close()

    def read(self, for_s: float = SLICE_S) -> bool:
        """Read on for some time; return whether the file may have more now. Raises RecordError.

        A live timeline moves on with the clock, also while the file does not grow.
        """
        began_s, timeline = self._clock(), self.timeline
        has_more = True
        while has_more and self._clock() - began_s < for_s:
            has_more = self._read_chunk()
        timeline.total_s = self._total_s()
        if timeline.kind == "live file":
            self._note_growth(has_more)
        return has_more

    def _read_chunk(self) -> bool:
        messages = next(self._messages, None)
        if messages is None:
            self._messages = self._stream.chunks()  # a file that grows may have more later
            return False
        if messages:
            self._grew_s = self._clock()
        for message in messages:
            if self._facts is None:
                self._facts = RecordFacts(self.timeline, message.log_time_ns)
            try:
                self._facts.fold(message)
            except ValueError as error:
                raise damaged(self._stream.path, error) from error
        return True

    def _total_s(self) -> float:
        """Return the length of the record, estimated from the part that is read."""
        timeline, size = self.timeline, self._stream.size
        if timeline.is_live or self.is_read or not self._stream.n_read:
            return timeline.end_s
        return timeline.end_s * size / self._stream.n_read

    def _note_growth(self, has_more: bool) -> None:
        timeline, quiet_s = self.timeline, self._clock() - self._grew_s
        if self.is_read:
            timeline.is_live, timeline.text = False, "the flight has ended, and its record is complete"
            timeline.now_s = timeline.end_s
        elif not has_more:
            timeline.now_s = max(timeline.now_s, timeline.end_s + quiet_s)
            is_quiet = quiet_s > QUIET_AFTER_S
            timeline.text = (
                f"the record has not grown for {quiet_s:.0f} s; the flight may have ended, or its process "
                "may have died; what is shown is that old [record-quiet]"
                if is_quiet
                else ""
            )

    async def run(self) -> None:
        """Read until the record is complete or damaged, or the task is cancelled."""
        while True:
            try:
                has_more = self.read()
            except RecordError as error:
                self._end_at_damage(error)
                return
            if has_more:
                await asyncio.sleep(0)
            elif self.timeline.kind == "recording" or self.is_read:
                if not self.is_read:
                    self.timeline.text = CUT
                return
            else:
                await asyncio.sleep(LOOK_EVERY_S)

    def _end_at_damage(self, error: RecordError) -> None:
        timeline = self.timeline
        timeline.is_live, timeline.now_s, timeline.total_s = False, timeline.end_s, timeline.end_s
        timeline.text = f"{error}; the part before, up to {timeline.end_s:.0f} s, is shown"


WAIT_S = 60.0
"""longest wait for the record of a flight that has just begun [s]"""


async def open_live(run: Path) -> RecordSource:
    """Open the record of a flight; wait until the flight has begun it. Raises RecordError."""
    loop = asyncio.get_running_loop()
    until_s = loop.time() + WAIT_S
    while not record_path(run).exists() and loop.time() < until_s:  # noqa: ASYNC110, another process writes it
        await asyncio.sleep(LOOK_EVERY_S)
    return RecordSource(run, "live file")
