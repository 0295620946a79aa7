"""The source for the record of a flight in progress."""

from __future__ import annotations

import asyncio
from pathlib import Path

from swarmctl.dashboard.sources.recording import LOOK_EVERY_S, RecordSource
from swarmctl.report.record import record_path

WAIT_S = 60.0
"""longest wait for the record of a flight that has just begun [s]"""


async def open_live(run: Path, wait_s: float = WAIT_S) -> RecordSource:
    """Open the record of a flight; wait until the flight has begun it. Raises RecordError."""
    loop = asyncio.get_running_loop()
    until_s = loop.time() + wait_s
    while not record_path(run).exists() and loop.time() < until_s:  # noqa: ASYNC110, another process writes it
        await asyncio.sleep(LOOK_EVERY_S)
    return RecordSource(run, "live file")
