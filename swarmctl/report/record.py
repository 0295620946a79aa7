"""The record of a run, and its replay through `swarmctl.agent.step.step`.

`run.mcap` holds every event and effect as JSON, with schemas. Foxglove and any other reader of
MCAP can open the file. Equal runs on the virtual clock write equal bytes.
"""

from __future__ import annotations

import contextlib
import inspect
import json
import math
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any

import msgspec
from mcap.writer import Writer

from swarmctl import __version__
from swarmctl.agent.state import AgentState, initial_state
from swarmctl.agent.step import step
from swarmctl.config.model import Config
from swarmctl.config.scenario import Scenario, build
from swarmctl.core import events as ev
from swarmctl.core.grid import Cell
from swarmctl.core.observation import Observation
from swarmctl.core.vehicle import VehicleState
from swarmctl.report import foxglove, record_file
from swarmctl.report.record_file import FORMAT, StoredRecord
from swarmctl.report.ui import Observer

FLUSH_PERIOD_S = 1.0
"""longest time without a flush, by the run's clock [s]: a process that is killed loses this time at most"""

EVENTS, EFFECTS = "/events", "/effects"
"""topics of the agents' events and effects"""


class EventRecord(msgspec.Struct, frozen=True):
    now_s: float
    event: ev.Event
    vehicle: str = ""


class EffectRecord(msgspec.Struct, frozen=True):
    now_s: float
    effect: ev.Effect
    vehicle: str = ""


class Recorder(Observer):
    """The recorder of one `run.mcap`. Only `close` writes the index of the file.

    A replay reads the agents' events and effects. Positions, routes, hostiles and texts are also recorded in
    Foxglove's own schemas. An effect on a vehicle or on the swarm is in the file before it is performed; a
    set-point at most FLUSH_PERIOD_S later.
    """

    def __init__(
        self, path: Path, scenario: Scenario, epoch_ns: int, earlier: StoredRecord | None = None
    ) -> None:
        """Create the file, with a copy of `earlier`, the record of the run that this run continues.

        The file gets its name after the copy: a run with half a record could not be continued.
        """
        self.trouble = ""
        """reason for an early end of the record, such as a full disk; the flight continues"""
        self._path = path
        draft = path.with_name(f".{path.name}")
        self._file = draft.open("wb")
        with contextlib.suppress(OSError):  # without locks the flight begins, but no program can continue it
            record_file.lock(self._file)
        self._writer = Writer(self._file)
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
        self._flushed_s = -math.inf
        if earlier is not None:
            self._copy(earlier)
        self._flush(-math.inf)
        draft.rename(path)

    def _copy(self, earlier: StoredRecord) -> None:
        for message in earlier.messages:
            self._add(message.topic, message.schema, message.definition, message.data, message.log_time_ns)

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
                shown = foxglove.route(name, effect.mission.plan, self._colours[uav])
                self._show(foxglove.route_topic(name), "foxglove.GeoJSON", shown, now)
        if isinstance(event, ev.TelemetryReceived):
            self._show_location(before.vehicle, event.state, uav, now)
        if isinstance(event, ev.Observed):
            self._show_found({(row, col) for row, col, occupied in event.cells if occupied}, now)
        if any(map(_acts, effects)) or not 0.0 <= now - self._flushed_s < FLUSH_PERIOD_S:
            self._flush(now)

    def _flush(self, now: float) -> None:
        """Write everything recorded so far to the file."""
        self._flushed_s = now
        if self.trouble:
            return
        try:
            self._writer.flush()  # type: ignore[no-untyped-call]
        except OSError as error:
            self._end(error)

    def noted(self, uav: int, text: str, now: float, *, to_operator: bool) -> None:
        level = foxglove.LogLevel.INFO if to_operator else foxglove.LogLevel.DEBUG
        entry = foxglove.log(self._log_time(now), self._names[uav], text, level)
        self._show(foxglove.LOG, "foxglove.Log", entry, now)

    def _show_area(self, now: float) -> None:
        """Write the area and the true hostiles, if something simulates them."""
        grid = self._scenario.grid
        goals = [goal for spec in self._scenario.swarm for goal in spec.goals]
        area = foxglove.area(grid, self._scenario.config.area.no_fly, goals)
        self._show(foxglove.AREA, "foxglove.GeoJSON", area, now)
        if (true_hostiles := self._scenario.true_hostiles) is not None:
            hostiles = foxglove.hostiles(grid, true_hostiles, "hostile (truth)")
            self._show(foxglove.HOSTILES, "foxglove.GeoJSON", hostiles, now)

    def _show_location(self, before: VehicleState, state: VehicleState, uav: int, now: float) -> None:
        """Write a vehicle's position once a second of its clock: a map needs no more, and events have all."""
        if state.has_position and int(state.time_boot_s) != int(before.time_boot_s):
            name = self._names[uav]
            fix = foxglove.location_fix(self._log_time(now), name, state, self._colours[uav])
            self._show(foxglove.location_topic(name), "foxglove.LocationFix", fix, now)

    def _show_found(self, cells: set[Cell], now: float) -> None:
        if not cells <= self._found:
            self._found |= cells
            shown = foxglove.hostiles(self._scenario.grid, self._found, "seen occupied")
            self._show(foxglove.FOUND, "foxglove.GeoJSON", shown, now)

    def _write(self, topic: str, record: msgspec.Struct, now: float) -> None:
        data = msgspec.json.encode(record)
        self._add(topic, type(record).__name__, type(record), data, self._log_time(now))

    def _show(self, topic: str, schema: str, content: dict[str, Any], now: float) -> None:
        data = msgspec.json.encode(content)
        self._add(topic, schema, foxglove.SCHEMAS[schema], data, self._log_time(now))

    def _add(
        self,
        topic: str,
        schema: str,
        definition: bytes | dict[str, Any] | type[msgspec.Struct],
        data: bytes,
        time_ns: int,
    ) -> None:
        if self.trouble:
            return
        try:
            if topic not in self._channels:
                schema_id = self._schema(schema, definition)
                self._channels[topic] = self._writer.register_channel(topic, "json", schema_id)
            self._writer.add_message(self._channels[topic], time_ns, data, time_ns, self._sequence)
            self._sequence += 1
        except OSError as error:
            self._end(error)

    def _end(self, error: OSError) -> None:
        self.trouble = f"{self._path}: the record ends early: {error.strerror or error}"

    def _schema(self, name: str, definition: bytes | dict[str, Any] | type[msgspec.Struct]) -> int:
        if name not in self._schemas:
            if not isinstance(definition, bytes):
                content = definition if isinstance(definition, dict) else object_schema(definition)
                definition = json.dumps(content).encode()
            self._schemas[name] = self._writer.register_schema(name, "jsonschema", definition)
        return self._schemas[name]

    def _log_time(self, now: float) -> int:
        return self._epoch_ns + round(now * 1e9)


def _acts(effect: ev.Effect) -> bool:
    """Return whether an effect changes what a vehicle does, or what the swarm or an operator knows."""
    match effect:
        case ev.Publish(message):
            return isinstance(message, Observation)
        case ev.NotifyOperator() | ev.SendSetPoint():  # set-points come several times a second
            return False
    return True


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


class ReplayResult(msgspec.Struct, frozen=True):
    """The result of a replay."""

    events: int
    effects: int
    difference: str
    """the first difference; empty without a difference"""
    is_cut: bool
    """True if the record has no end, because the process died; the complete part was replayed"""


def replay(path: Path, prepare: Callable[[Config], None] = lambda _: None) -> ReplayResult:
    """Replay the recorded events of every agent and compare the effects. Raises RecordError.

    `prepare` gets the recorded configuration before the replay builds the scenario.
    """
    content = read(path)
    prepare(content.stored.config)
    return fold(content, build(content.stored.config), lambda *_: None)


OnFolded = Callable[[AgentState, ev.Event, AgentState, list[ev.Effect], "RecordEntry"], None]
"""(state before, event, state after, effects, entry of the event)"""


def fold(content: RecordContent, scenario: Scenario, on_folded: OnFolded) -> ReplayResult:
    """Fold the recorded events of every agent, compare the effects, and call `on_folded` after each event."""
    states = {task.name: initial_state(task, scenario.prior) for task in scenario.tasks}
    expected: dict[str, list[ev.Effect]] = {name: [] for name in states}
    events, effects, is_cut = 0, 0, content.stored.is_cut
    for entry in content.entries:
        name, record = entry.vehicle, entry.record
        if isinstance(record, EffectRecord):
            effects += 1
            due = expected[name]
            if not due or due[0] != record.effect:
                found = due[0] if due else "nothing"
                text = f"{name} at {record.now_s:.3f} s: recorded {record.effect}, now {found}"
                return ReplayResult(events, effects, text, is_cut)
            due.pop(0)
            continue
        if expected[name]:
            text = f"{name} before {record.now_s:.3f} s: nothing recorded, now {expected[name][0]}"
            return ReplayResult(events, effects, text, is_cut)
        events += 1
        before = states[name]
        states[name], folded = step(before, record.event, record.now_s)
        expected[name] = list(folded)
        on_folded(before, record.event, states[name], folded, entry)
    for name, due in expected.items():
        if due and not is_cut:
            return ReplayResult(events, effects, f"{name} at the end: nothing recorded, now {due[0]}", is_cut)
    return ReplayResult(events, effects, "", is_cut)


def recorded_observations(run: Path) -> tuple[Config, list[Observation]]:
    """Return the configuration of a recorded run and its vehicles' observations. Raises RecordError."""
    stored = record_file.read(record_path(run))
    entries = _entries(record_path(run), stored, {EFFECTS})
    effects = (entry.record.effect for entry in entries if isinstance(entry.record, EffectRecord))
    messages = (effect.message for effect in effects if isinstance(effect, ev.Publish))
    return stored.config, [m for m in messages if isinstance(m, Observation)]


def record_path(run: Path) -> Path:
    """Return the record of a run, given as its folder or as the file."""
    return run / "run.mcap" if run.is_dir() else run


class RecordEntry(msgspec.Struct, frozen=True):
    """An event or effect of one vehicle's agent."""

    vehicle: str
    record: EventRecord | EffectRecord
    log_time_ns: int
    """wall time [ns since 1970]"""


class RecordContent(msgspec.Struct, frozen=True):
    """A record with its events and effects."""

    stored: StoredRecord
    entries: list[RecordEntry]


def read(path: Path) -> RecordContent:
    """Return the complete part of a record. Raises RecordError."""
    stored = record_file.read(path)
    return RecordContent(stored, list(_entries(path, stored, _DECODERS.keys())))


_DECODERS: dict[str, msgspec.json.Decoder[EventRecord] | msgspec.json.Decoder[EffectRecord]] = {
    EVENTS: msgspec.json.Decoder(EventRecord),
    EFFECTS: msgspec.json.Decoder(EffectRecord),
}


def _entries(path: Path, stored: StoredRecord, topics: Collection[str]) -> Iterator[RecordEntry]:
    """Yield the entries of some topics. Raises RecordError."""
    try:
        for message in stored.messages:
            if message.topic in topics:
                record = _DECODERS[message.topic].decode(message.data)
                yield RecordEntry(record.vehicle, record, message.log_time_ns)
    except ValueError as error:  # JSON, or an unknown kind of event
        raise record_file.damaged(path, error) from error
