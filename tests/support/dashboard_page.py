"""A page that applies the changes it is sent, as the JavaScript does, and the reading of whole records."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

from swarmctl.dashboard.model import Timeline
from swarmctl.dashboard.sources.record_facts import RecordFacts
from swarmctl.dashboard.sources.recording import RecordSource
from swarmctl.report.record_file import RecordStream, StoredMessage


class Page:
    """The map of a browser after some changes."""

    def __init__(self) -> None:
        self.shown: dict[str, Any] = {"vehicles": {}}

    def apply(self, changes: dict[str, Any]) -> None:
        for key, value in json.loads(json.dumps(changes)).items():
            if key == "vehicles":
                for name, fields in value.items():
                    self._apply(self.shown["vehicles"].setdefault(name, {}), fields)
            else:
                self._apply(self.shown, {key: value})

    @staticmethod
    def _apply(shown: dict[str, Any], fields: dict[str, Any]) -> None:
        for key, value in fields.items():
            if key == "belief" and "codes" in value:
                shown[key] = list(base64.b64decode(value["codes"]))
            elif key == "belief":
                pairs = value["cells"]
                for index, code in zip(pairs[::2], pairs[1::2], strict=True):
                    shown[key][index] = code
            elif isinstance(value, dict) and "from" in value:
                items = value.get("items", value.get("points"))
                shown[key] = [*shown.get(key, [])[: value["from"]], *items]
            else:
                shown[key] = value


def whole(run: Path) -> Timeline:
    """Return the timeline of a whole record."""
    source = RecordSource(run, "recording")
    try:
        while source.read(1.0):
            pass
    finally:
        source.close()
    return source.timeline


def messages_of(run: Path) -> list[StoredMessage]:
    stream = RecordStream(run / "run.mcap")
    messages = [message for chunk in stream.chunks() for message in chunk]
    stream.close()
    return messages


def folded(timeline: Timeline, messages: list[StoredMessage], until_s: float) -> Timeline:
    """Return a new timeline of the messages up to a time."""
    new = Timeline(timeline.scenario, "recording")
    facts = RecordFacts(new, messages[0].log_time_ns)
    for message in messages:
        if (message.log_time_ns - messages[0].log_time_ns) / 1e9 <= until_s:
            facts.fold(message)
    new.now_s = until_s
    return new
