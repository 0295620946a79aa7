"""Contents of a run folder's `run.mcap`, by a reader independent of the program."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mcap.reader import make_reader


def messages(folder: Path, topic: str) -> Iterator[dict[str, Any]]:
    """Yield the messages of a topic as JSON, with their time as `log_time_ns`, in the order of the record."""
    with (folder / "run.mcap").open("rb") as file:
        for _, _, message in make_reader(file).iter_messages(topics=[topic]):
            yield {**json.loads(message.data), "log_time_ns": message.log_time}


def events(folder: Path, kind: str, vehicle: str | None = None) -> Iterator[dict[str, Any]]:
    """Yield the records of one kind of event, of one vehicle or of all."""
    yield from _of(folder, "/events", "event", kind, vehicle)


def effects(folder: Path, kind: str, vehicle: str | None = None) -> Iterator[dict[str, Any]]:
    """Yield the records of one kind of effect, of one vehicle or of all."""
    yield from _of(folder, "/effects", "effect", kind, vehicle)


def _of(folder: Path, topic: str, key: str, kind: str, vehicle: str | None) -> Iterator[dict[str, Any]]:
    for record in messages(folder, topic):
        if record[key]["type"] == kind and vehicle in (None, record["vehicle"]):
            yield record
