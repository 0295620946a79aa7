"""A run whose program died in flight: what its files prove about each vehicle, for a program that goes on.

The record gives the agents' states, because an agent is a fold of its events. The evidence, which is written
before each message, gives the last mode that the program commanded.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import msgspec

from swarmctl.agent.state import AgentState, initial_state
from swarmctl.config.model import Config
from swarmctl.config.scenario import Scenario
from swarmctl.core import events as ev
from swarmctl.core.mission import FlightPlan
from swarmctl.core.observation import Observation
from swarmctl.report import record, record_file
from swarmctl.report.evidence import chain
from swarmctl.report.evidence.commands import CHANGED_PART, command_of
from swarmctl.report.evidence.log import FILE_NAME
from swarmctl.report.summary import FlightStatistics

MAX_AGE_S = 3600.0
"""age of a record above which no vehicle of the run is in the air any more [s]"""
CONTINUED = "continued_by.txt"
"""file with the name of the run that goes on with this one"""
MAX_LAG_S = 5.0
"""longest time by which the record may end before the last command; a longer one means that it failed"""


class UnfinishedRunError(Exception):
    """A run that no program can go on with; the text gives the reason."""


@dataclass(slots=True)
class RecordedVehicle:
    """A vehicle of the run, by the run's files."""

    state: AgentState
    """the agent's state after the last recorded event"""
    plans: dict[int, FlightPlan] = field(default_factory=dict)
    """all plans that the agent has given to the vehicle, by number"""
    observations: list[tuple[float, Observation]] = field(default_factory=list)
    """the vehicle's own observations with their unix times [s]"""
    firmware: str = ""
    uid2: str = ""
    """hex digits; like `firmware` empty if the record has no identity"""
    last_unix_s: float = 0.0
    """wall time of the last recorded telemetry"""
    mode_params: tuple[float, ...] = ()
    """parameters of the last MAV_CMD_DO_SET_MODE of this program; empty if there was none"""


class UnfinishedRun(msgspec.Struct, frozen=True):
    """A run whose program died in flight, with its files."""

    folder: Path
    vehicles: dict[int, RecordedVehicle]
    """by system id"""
    statistics: FlightStatistics
    stored: record_file.StoredRecord
    """the record's messages, which the record of the next run repeats"""
    evidence: chain.Continued
    """the evidence of the run, for the evidence of the next run"""
    file: BinaryIO
    """the locked record: no other program can take over this run meanwhile"""

    def note_continuation(self, run: str) -> None:
        """Write the name of the run that goes on with this one, so that no later program does."""
        with contextlib.suppress(OSError):
            (self.folder / CONTINUED).write_text(f"{run}\n", encoding="utf-8")


def unfinished_content(run: Path) -> tuple[record.RecordContent, BinaryIO]:
    """Return the content and the locked file of an unfinished run's record.

    Raises UnfinishedRunError, and RecordError for a missing or unreadable record.
    """
    with contextlib.ExitStack() as opened:
        file = opened.enter_context(_locked(run))
        # After the lock: until then another program may have written more.
        content = record.read(record.record_path(run))
        if not content.stored.is_cut:
            raise UnfinishedRunError(
                f"{run}: the run has ended in order, so there is nothing to go on with; start a new flight "
                "without --resume, and command vehicles that are still in the air by another ground station "
                "[run-ended]"
            )
        with contextlib.suppress(OSError):
            later = (_folder(run) / CONTINUED).read_text(encoding="utf-8").strip()
            raise UnfinishedRunError(
                f"{run}: {later} has gone on with this run; give that run [run-continued]"
            )
        opened.pop_all()
        return content, file


def _folder(run: Path) -> Path:
    """Return the folder of a run, given as its folder or as its record."""
    return record.record_path(run).parent


def _locked(run: Path) -> BinaryIO:
    """Open and lock the record of a run. Raises UnfinishedRunError and RecordError."""
    path = record.record_path(run)
    try:
        file = path.open("r+b")  # network file systems lock only files that are open for writing
    except FileNotFoundError:
        raise record_file.not_found(path) from None
    except OSError as error:
        raise UnfinishedRunError(
            f"{path}: cannot be opened for writing: {error.strerror or error}"
        ) from error
    try:
        is_locked = record_file.lock(file)
    except OSError as error:
        file.close()
        raise UnfinishedRunError(
            f"{path}: cannot be locked: {error.strerror or error}; so another program may still fly these "
            "vehicles; make sure that none does, and give a copy of the folder on a local disk [no-locks]"
        ) from error
    if not is_locked:
        file.close()
        raise UnfinishedRunError(
            f"{run}: another program still writes the record of this run; end that program first, because "
            "two programs must not command the same vehicles [still-running]"
        )
    return file


def rebuild(
    run: Path, content: record.RecordContent, file: BinaryIO, scenario: Scenario, epoch_ns: int
) -> UnfinishedRun:
    """Return the unfinished run, folded from its record. Raises UnfinishedRunError.

    epoch_ns: wall time at time 0 of this program's clock [ns since 1970]
    """
    if strangers := {entry.vehicle for entry in content.entries} - {task.name for task in scenario.tasks}:
        raise UnfinishedRunError(
            f"{run}: the record is of other vehicles too: {', '.join(sorted(strangers))}; give the run of "
            "this vehicle's own agent, or use `swarmctl fly` [other-vehicles]"
        )
    vehicles = {task.uav: RecordedVehicle(initial_state(task, scenario.prior)) for task in scenario.tasks}
    statistics = FlightStatistics()

    def on_folded(
        before: AgentState,
        event: ev.Event,
        after: AgentState,
        effects: list[ev.Effect],
        entry: record.RecordEntry,
    ) -> None:
        vehicle, unix_s = vehicles[after.task.uav], entry.log_time_ns / 1e9
        vehicle.state = after
        statistics.folded(before, event, after, effects, (entry.log_time_ns - epoch_ns) / 1e9)
        match event:
            case ev.Ready(firmware, uid2):
                vehicle.firmware, vehicle.uid2 = firmware, uid2
            case ev.TelemetryReceived():
                vehicle.last_unix_s = unix_s
        for effect in effects:
            match effect:
                case ev.SwapMission(mission):
                    vehicle.plans[mission.plan_id] = mission.plan
                case ev.Publish(Observation() as seen):
                    vehicle.observations.append((unix_s, seen))

    result = record.fold(content, scenario, on_folded)
    if result.difference:
        raise UnfinishedRunError(
            f"{run}: this program decides otherwise than the recorded one: {result.difference}; go on with "
            "the version that flew the run [other-decisions]"
        )
    folder = _folder(run)
    checked = _evidence(folder, max((entry.log_time_ns for entry in content.entries), default=0) / 1e9)
    commands = _own_commands(checked)
    for vehicle in vehicles.values():
        vehicle.mode_params = _commanded_mode(commands, vehicle.state.task.name)
    evidence = chain.Continued(folder.name, len(checked.entries), checked.last_hash)
    return UnfinishedRun(folder, vehicles, statistics, content.stored, evidence, file)


def load(
    run: Path, scenario_of: Callable[[Config], Scenario], epoch_ns: int
) -> tuple[Scenario, UnfinishedRun]:
    """Return the scenario and the content of an unfinished run. Raises UnfinishedRunError and RecordError.

    `scenario_of` gets the recorded configuration.
    """
    content, file = unfinished_content(run)
    try:
        scenario = scenario_of(content.stored.config)
        return scenario, rebuild(run, content, file, scenario, epoch_ns)
    except BaseException:
        file.close()
        raise


def last_run(runs: Path, name: str = "") -> Path | None:
    """Return the newest run folder of this name (empty: any) in the folder of runs; None if there is none."""
    folders = (path.parent for path in runs.glob("*/run.mcap"))
    found = [folder for folder in folders if not name or _is_named(folder.name, name)]
    return max(found, key=lambda folder: (folder / "run.mcap").stat().st_mtime_ns, default=None)


def is_unfinished(run: Path, now_unix_s: float) -> bool:
    """Return whether a run may still have a vehicle in the air: its record is recent and has no end.

    Also True for a recent record that cannot be read.
    """
    if now_unix_s - record.record_path(run).stat().st_mtime > MAX_AGE_S:
        return False
    try:
        return record_file.read(record.record_path(run)).is_cut
    except record_file.RecordError:
        return True


def differing_sections(recorded: Config, given: Config) -> list[str]:
    """Return the sections in which two configurations differ; the receivers of --forward do not count."""
    old, new = (_comparable(config) for config in (recorded, given))
    return [section for section in old if old[section] != new[section]]


def _comparable(config: Config) -> dict[str, Any]:
    content = config.model_dump(mode="json")
    content["links"].pop("forward", None)
    return content


def _is_named(folder: str, name: str) -> bool:
    """Return whether a folder's name is a time stamp, this name, and perhaps a number."""
    rest = folder[len("yyyymmdd-hhmmss-") :]
    return rest == name or (rest.startswith(f"{name}-") and rest[len(name) + 1 :].isdigit())


def _evidence(folder: Path, recorded_unix_s: float) -> chain.CheckedChain:
    path = folder / FILE_NAME
    try:
        with path.open("rb") as file:
            checked = chain.check(file)
    except OSError as error:
        raise UnfinishedRunError(
            f"{path}: cannot be read: {error.strerror or error}; without the evidence of its commands no "
            "vehicle can be taken over [no-evidence]"
        ) from error
    if checked.other_format:
        raise UnfinishedRunError(f"{path}: {checked.other_format}")
    if checked.fault and not checked.is_torn:
        raise UnfinishedRunError(
            f"{path}:{len(checked.entries) + 1}: the evidence was changed: {checked.fault}; no vehicle can "
            "be taken over by it [evidence-changed]"
        )
    # The record has each decision before its command.
    lag_s = max((entry.unix_s for entry in _own_commands(checked)), default=0.0) - recorded_unix_s
    if lag_s > MAX_LAG_S:
        raise UnfinishedRunError(
            f"{folder}: the record ends {lag_s:.0f} s before the evidence, as on a full disk; the agents' "
            "last decisions are unknown, so no vehicle can be taken over [record-incomplete]"
        )
    return checked


def _own_commands(checked: chain.CheckedChain) -> list[chain.Entry]:
    """Return this program's commands that change what a vehicle does."""
    return [
        entry
        for entry in checked.entries
        if entry.kind == "command" and "by" not in entry.what and command_of(entry.what) in CHANGED_PART
    ]


def _commanded_mode(commands: list[chain.Entry], vehicle: str) -> tuple[float, ...]:
    """Return the parameters of this program's last command to set a mode; empty if there was none."""
    modes = [c.what for c in commands if c.vehicle == vehicle and command_of(c.what) == "DO_SET_MODE"]
    return (modes[-1]["param1"], modes[-1]["param2"], modes[-1]["param3"]) if modes else ()
