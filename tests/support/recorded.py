"""Contents of a run folder's `run.mcap` and tlogs, by readers independent of the program."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from mcap.writer import Writer
from pymavlink import mavutil

from swarmctl.config.scenario import Scenario


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


def rewrite(
    record: Path, copy: Path, change: Callable[[str, dict[str, Any]], bool], *, format_: str | None = None
) -> None:
    """Copy a record. `change` gets each topic and content, may change the content, and returns whether to
    keep it."""
    with record.open("rb") as source, copy.open("wb") as target:
        reader, writer = make_reader(source), Writer(target)
        writer.start()
        for metadata in reader.iter_metadata():
            entries = dict(metadata.metadata)
            writer.add_metadata(metadata.name, entries | ({"format": format_} if format_ else {}))
        schema = writer.register_schema("any", "jsonschema", b'{"type": "object"}')
        channels: dict[str, int] = {}
        for _, channel, message in reader.iter_messages():
            topic, content = channel.topic, json.loads(message.data)
            if not change(topic, content):
                continue
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, "json", schema)
            data = json.dumps(content).encode()
            writer.add_message(
                channels[topic], message.log_time, data, message.publish_time, message.sequence
            )
        writer.finish()


def of_another_format(record: Path, copy: Path) -> None:
    """Copy a record as one of an earlier format."""
    rewrite(record, copy, lambda _topic, _content: True, format_="4")


def on_the_wire(folder: Path, name: str) -> Iterator[Any]:
    """Yield the messages of a vehicle's tlog, those of the ground station too."""
    log = mavutil.mavlink_connection(str(folder / f"{name}.tlog"))
    try:
        while (message := log.recv_match()) is not None:
            yield message
    finally:
        log.close()


def first_heartbeats(folder: Path, scenario: Scenario) -> list[Any]:
    """Return the first heartbeat of each vehicle in its tlog."""
    return [
        next(
            message
            for message in on_the_wire(folder, spec.name)
            if (message.get_srcSystem(), message.get_type()) == (spec.sysid, "HEARTBEAT")
        )
        for spec in scenario.specs
    ]
