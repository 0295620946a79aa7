"""The record of a run, and its replay through `swarmctl.agent.step.step`.

`run.mcap` holds every event, effect and bus message as JSON, with schemas. Foxglove and any other reader of
MCAP can open the file. Equal runs on the virtual clock write equal bytes.
"""

from __future__ import annotations

import inspect
import json
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from io import SEEK_END, BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import msgspec
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel, Message, Metadata
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC, Writer

from swarmctl import __version__
from swarmctl.agent.state import AgentState, begin
from swarmctl.agent.step import step
from swarmctl.config.model import Config
from swarmctl.config.scenario import Scenario, build
from swarmctl.core import events as ev
from swarmctl.core.frames import AgentMessage
from swarmctl.core.grid import Cell
from swarmctl.core.observation import Observation
from swarmctl.report import foxglove

FORMAT = 3
READABLE = frozenset({"2", "3"})
"""readable formats; format 2 has a channel for each vehicle and each kind of event and effect"""
CHUNK_BYTES = 1 << 16
"""size of a chunk; a crash loses the last chunk, and data in the buffer of the file"""

_RECORD = struct.Struct("<BQ")
"""opcode and length, before each record of an MCAP file"""

EVENTS, EFFECTS, MESSAGES = "/events", "/effects", "/messages"
"""topics of the agents' events, effects and messages"""


class EventRecord(msgspec.Struct, frozen=True):
    now_s: float
    event: ev.Event
    vehicle: str = ""


class EffectRecord(msgspec.Struct, frozen=True):
    now_s: float
    effect: ev.Effect
    vehicle: str = ""


class BusRecord(msgspec.Struct, frozen=True):
    now_s: float
    recipients: int
    message: AgentMessage
    vehicle: str = ""


class Recorder:
    """The recorder of one `run.mcap`, an `Observer` of runners. Only `close` writes the index of the file.

    A replay reads the agents' events and effects. Positions, routes, hostiles and texts are also recorded in
    Foxglove's own schemas.
    """

    def __init__(self, path: Path, scenario: Scenario, epoch_ns: int) -> None:
        self.trouble = ""
        """reason for an early end of the record, such as a full disk; the flight continues"""
        self._path = path
        self._file = path.open("wb")
        self._writer = Writer(self._file, chunk_size=CHUNK_BYTES)
        self._writer.start(profile="", library=f"swarmctl {__version__}")
        # A replay builds its agents from the configuration.
        config = scenario.config.model_dump_json()
        self._writer.add_metadata(
            "swarmctl", {"format": str(FORMAT), "version": __version__, "config": config}
        )
        self._scenario = scenario
        self._names = {task.uav: task.name for task in scenario.tasks}
        self._colours = {task.uav: foxglove.colour_of(i) for i, task in enumerate(scenario.tasks)}
        self._epoch_ns = epoch_ns
        self._sequence = 0
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._found: set[Cell] = set()

    def close(self) -> None:
        try:
            if not self.trouble:
                self._writer.finish()  # type: ignore[no-untyped-call]
            self._file.close()
        except OSError as error:
            self._end(error)

    def folded(
        self, before: AgentState, event: ev.Event, after: AgentState, effects: list[ev.Effect], now: float
    ) -> None:
        uav, name = after.task.uav, after.task.name
        if self._sequence == 0:
            self._show_area(now)
        self._write(EVENTS, EventRecord(now, event, name), now)
        for effect in effects:
            self._write(EFFECTS, EffectRecord(now, effect, name), now)
            if isinstance(effect, ev.SwapMission):
                shown = foxglove.route(name, effect.plan, self._colours[uav])
                self._show(foxglove.route_topic(name), "foxglove.GeoJSON", shown, now)
        if isinstance(event, ev.TelemetryReceived) and event.state.has_position:
            fix = foxglove.location_fix(self._log_time(now), name, event.state, self._colours[uav])
            self._show(foxglove.location_topic(name), "foxglove.LocationFix", fix, now)
        if isinstance(event, ev.Observed):
            self._show_found({(row, col) for row, col, occupied in event.cells if occupied}, now)

    def sent(self, uav: int, message: AgentMessage, recipients: int, now: float) -> None:
        self._write(MESSAGES, BusRecord(now, recipients, message, self._names[uav]), now)

    def noted(self, uav: int, text: str, now: float, *, to_operator: bool) -> None:
        level = foxglove.LogLevel.INFO if to_operator else foxglove.LogLevel.DEBUG
        entry = foxglove.log(self._log_time(now), self._names[uav], text, level)
        self._show(foxglove.LOG, "foxglove.Log", entry, now)

    def _show_area(self, now: float) -> None:
        """Write the area and the true hostiles."""
        grid = self._scenario.grid
        goals = [goal for spec in self._scenario.swarm for goal in spec.goals]
        area = foxglove.area(grid, self._scenario.config.area.no_fly, goals)
        self._show(foxglove.AREA, "foxglove.GeoJSON", area, now)
        hostiles = foxglove.hostiles(grid, self._scenario.hostiles, "hostile (truth)")
        self._show(foxglove.HOSTILES, "foxglove.GeoJSON", hostiles, now)

    def _show_found(self, cells: set[Cell], now: float) -> None:
        if not cells <= self._found:
            self._found |= cells
            shown = foxglove.hostiles(self._scenario.grid, self._found, "seen occupied")
            self._show(foxglove.FOUND, "foxglove.GeoJSON", shown, now)

    def _write(self, topic: str, record: msgspec.Struct, now: float) -> None:
        self._add(topic, type(record).__name__, type(record), msgspec.json.encode(record), now)

    def _show(self, topic: str, schema: str, content: dict[str, Any], now: float) -> None:
        self._add(topic, schema, foxglove.SCHEMAS[schema], json.dumps(content).encode(), now)

    def _add(
        self,
        topic: str,
        schema: str,
        definition: dict[str, Any] | type[msgspec.Struct],
        data: bytes,
        now: float,
    ) -> None:
        if self.trouble:
            return
        try:
            if topic not in self._channels:
                schema_id = self._schema(schema, definition)
                self._channels[topic] = self._writer.register_channel(topic, "json", schema_id)
            time_ns = self._log_time(now)
            self._writer.add_message(self._channels[topic], time_ns, data, time_ns, self._sequence)
            self._sequence += 1
        except OSError as error:
            self._end(error)

    def _end(self, error: OSError) -> None:
        self.trouble = f"{self._path}: the record ends early: {error.strerror or error}"

    def _schema(self, name: str, definition: dict[str, Any] | type[msgspec.Struct]) -> int:
        if name not in self._schemas:
            content = definition if isinstance(definition, dict) else object_schema(definition)
            self._schemas[name] = self._writer.register_schema(
                name, "jsonschema", json.dumps(content).encode()
            )
        return self._schemas[name]

    def _log_time(self, now: float) -> int:
        return self._epoch_ns + round(now * 1e9)


def object_schema(struct: type[msgspec.Struct]) -> dict[str, Any]:
    """Return the JSON schema with `type: object` at its top, as Foxglove requires."""
    (reference,), components = msgspec.json.schema_components((struct,), ref_template="#/$defs/{name}")
    top: dict[str, Any] = components.pop(reference["$ref"].rsplit("/", 1)[-1])
    return {name: _dedented(part) for name, part in {**top, "$defs": components}.items()}


def _dedented(schema: Any) -> Any:
    """Return a schema with dedented descriptions; Python dedents docstrings only from 3.13 on."""
    if isinstance(schema, dict):
        return {name: _dedented(part) for name, part in schema.items()}
    if isinstance(schema, list):
        return [_dedented(part) for part in schema]
    return inspect.cleandoc(schema) if isinstance(schema, str) else schema


class RecordError(Exception):
    """A record that cannot be read; the text holds the file and the fault."""


@dataclass(frozen=True, slots=True)
class ReplayResult:
    """The result of a replay."""

    events: int
    effects: int
    difference: str
    """the first difference; empty without a difference"""
    is_cut: bool = False
    """True if the record has no end, because the process died; the complete part was replayed"""


def replay(path: Path, prepare: Callable[[Config], None] = lambda _: None) -> ReplayResult:
    """Replay the recorded events of every agent and compare the effects. Raises RecordError.

    `prepare` gets the recorded configuration before the replay builds the scenario.
    """
    content = _read(path)
    prepare(content.config)
    scenario = build(content.config)
    states = {task.name: begin(task, scenario.prior) for task in scenario.tasks}
    expected: dict[str, list[ev.Effect]] = {name: [] for name in states}
    events = effects = 0
    for name, record in content.rows:
        if isinstance(record, EffectRecord):
            effects += 1
            due = expected[name]
            if not due or due[0] != record.effect:
                found = due[0] if due else "nothing"
                text = f"{name} at {record.now_s:.3f} s: recorded {record.effect}, now {found}"
                return ReplayResult(events, effects, text, content.is_cut)
            due.pop(0)
            continue
        if expected[name]:
            text = f"{name} before {record.now_s:.3f} s: nothing recorded, now {expected[name][0]}"
            return ReplayResult(events, effects, text, content.is_cut)
        events += 1
        states[name], expected[name] = step(states[name], record.event, record.now_s)
    for name, due in expected.items():
        if due and not content.is_cut:
            return ReplayResult(events, effects, f"{name} at the end: nothing recorded, now {due[0]}")
    return ReplayResult(events, effects, "", content.is_cut)


def recorded_observations(run: Path) -> tuple[Config, list[Observation]]:
    """Return the configuration of a recorded run and its vehicles' observations. Raises RecordError."""
    content = _read(record_path(run))
    effects = (record.effect for _, record in content.rows if isinstance(record, EffectRecord))
    messages = (effect.message for effect in effects if isinstance(effect, ev.Publish))
    return content.config, [m for m in messages if isinstance(m, Observation)]


def record_path(run: Path) -> Path:
    """Return the record of a run, given as its folder or as the file."""
    return run / "run.mcap" if run.is_dir() else run


@dataclass(frozen=True, slots=True)
class _Content:
    config: Config
    rows: list[tuple[str, EventRecord | EffectRecord]]
    is_cut: bool
    """True if the record has no end, because the process died"""


def _read(path: Path) -> _Content:
    """Return the complete part of a record. Raises RecordError."""
    try:
        with path.open("rb") as file:
            end, is_cut = _complete_part(file)
            file.seek(0)
            metadata, rows = _parsed(BytesIO(file.read(end)))
        if metadata.get("format") in READABLE:
            return _Content(Config.model_validate_json(metadata["config"]), list(_records(rows)), is_cut)
    except FileNotFoundError:
        raise RecordError(
            f"{path}: not found; give the folder of a run, which holds run.mcap [no-record]"
        ) from None
    except Exception as error:  # a damaged record fails in many ways: JSON, compression, unknown channels
        reason = str(error) or f"ends early or is damaged ({type(error).__name__})"
        raise RecordError(f"{path}: cannot be read as a record: {reason} [damaged]") from error
    text = f"swarmctl {__version__} cannot read this record; use the version that wrote it"
    raise RecordError(f"{path}: {text} [other-format]")


def _complete_part(file: BinaryIO) -> tuple[int, bool]:
    """Return the length of the part with complete records [bytes], and whether the file is cut.

    An MCAP file is a magic number and records of opcode (1 byte), length (8 bytes) and content; the last
    record is the footer.
    """
    size, position = file.seek(0, SEEK_END), len(MCAP0_MAGIC)
    while position + _RECORD.size <= size:
        file.seek(position)
        opcode, length = _RECORD.unpack(file.read(_RECORD.size))
        if position + _RECORD.size + length > size:
            break
        position += _RECORD.size + length
        if opcode == Opcode.FOOTER:
            return size, False
    return min(position, size), True


def _parsed(file: BinaryIO) -> tuple[dict[str, str], list[tuple[int, str, bytes]]]:
    """Return this program's metadata, and number, topic and content of each message."""
    metadata: dict[str, str] = {}
    topics: dict[int, str] = {}
    rows: list[tuple[int, str, bytes]] = []
    records = StreamReader(file).records
    while True:
        try:
            part = next(records)
        except (StopIteration, EndOfFile):
            return metadata, rows
        match part:
            case Metadata(name="swarmctl"):
                metadata = part.metadata
            case Channel():
                topics[part.id] = part.topic
            case Message():
                rows.append((part.sequence, topics[part.channel_id], part.data))


def _records(rows: list[tuple[int, str, bytes]]) -> Iterator[tuple[str, EventRecord | EffectRecord]]:
    events = msgspec.json.Decoder(EventRecord)
    effects = msgspec.json.Decoder(EffectRecord)
    for _, topic, data in sorted(rows):
        _, first, *rest = topic.split("/")
        kind = rest[0] if rest else ""
        if topic == EVENTS or kind == "event":
            event = events.decode(data)
            yield event.vehicle or first, event
        elif topic == EFFECTS or kind == "effect":
            effect = effects.decode(data)
            yield effect.vehicle or first, effect
