"""The file trees of both autopilots over MAVLink FTP."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.files.component_metadata import ComponentMetadata
from sim_vehicle.files.filesystem import FileSystem, GeneratedFile, constant
from sim_vehicle.files.logs.recorder import FlightRecorder, StoredLog
from sim_vehicle.files.packed_files import (
    Parameter,
    UploadedMission,
    pack_mission,
    pack_parameters,
    unpack_mission,
    unpack_parameters,
)

ARDUPILOT_LOGS = "APM/LOGS"
PX4_LOGS = "fs/microsd/log"
MISSION_FILES = {
    "mission": mavlink.MAV_MISSION_TYPE_MISSION,
    "fence": mavlink.MAV_MISSION_TYPE_FENCE,
    "rally": mavlink.MAV_MISSION_TYPE_RALLY,
}


def ardupilot_files(
    *,
    parameters: Callable[[], Sequence[Parameter]],
    set_parameter: Callable[[str, float], None],
    banner: Callable[[], None],
    items: Callable[[int], Iterable[Any]],
    set_items: Callable[[int, UploadedMission], bool],
    recorder: FlightRecorder,
    system: Mapping[str, GeneratedFile],
) -> FileSystem:
    """Return ArduPilot's tree: `@PARAM`, `@MISSION`, `@SYS` and the logs; `/APM` is writable.

    parameters: returns the parameters, in the order of their index.
    set_parameter: called for each parameter of an upload.
    banner: sends the texts that announce a parameter download.
    items: returns the stored MISSION_ITEM_INT of a mission type.
    set_items: stores an uploaded mission of a type; returns False if the items are unusable.
    recorder: the recorder of the logs.
    system: files under `@SYS`, by name.
    """

    def pack(query: str) -> bytes:
        banner()
        return pack_parameters(parameters(), query)

    def unpack(content: bytes) -> bool:
        values = unpack_parameters(content)
        for name, value in (values or {}).items():
            set_parameter(name, value)
        return values is not None

    fixed = {"@PARAM/param.pck": GeneratedFile(pack, lambda: len(pack_parameters(parameters())), unpack)}
    for name, kind in MISSION_FILES.items():
        fixed[f"@MISSION/{name}.dat"] = _mission_file(kind, items, set_items)
    for name, file in system.items():
        fixed[f"@SYS/{name}"] = file

    def sources() -> Mapping[str, GeneratedFile]:
        logs = {f"{ARDUPILOT_LOGS}/{log.number:08d}.BIN": _log_file(log, recorder) for log in recorder.logs}
        if recorder.logs:
            logs[f"{ARDUPILOT_LOGS}/LASTLOG.TXT"] = constant(b"%d\r\n" % recorder.logs[-1].number)
        return {**fixed, **logs}

    return FileSystem(sources, writable=("APM",))


def px4_files(*, metadata: Callable[[], ComponentMetadata], recorder: FlightRecorder) -> FileSystem:
    """Return PX4's tree: the metadata files, and logs by date on the writable SD card (`/fs/microsd`)."""

    def sources() -> Mapping[str, GeneratedFile]:
        fixed = {path: constant(content) for path, content in metadata().files.items()}
        logs = {f"{PX4_LOGS}/{px4_log_name(log)}": _log_file(log, recorder) for log in recorder.logs}
        return {**fixed, **logs}

    return FileSystem(sources, writable=("fs/microsd",))


def px4_log_name(log: StoredLog) -> str:
    """Return the path of a log under PX4_LOGS, `YYYY-MM-DD/hh_mm_ss.ulg` of its start (UTC)."""
    date, time = str(np.datetime64(max(int(log.begun_utc_s), 0), "s")).split("T")
    return f"{date}/{time.replace(':', '_')}.ulg"


def _mission_file(
    kind: int, items: Callable[[int], Iterable[Any]], set_items: Callable[[int, UploadedMission], bool]
) -> GeneratedFile:
    def write(content: bytes) -> bool:
        upload = unpack_mission(kind, content)
        return upload is not None and set_items(kind, upload)

    return GeneratedFile(
        read=lambda _query: pack_mission(kind, items(kind)),
        size=lambda: len(pack_mission(kind, items(kind))),
        write=write,
    )


def _log_file(log: StoredLog, recorder: FlightRecorder) -> GeneratedFile:
    return GeneratedFile(
        read=lambda _query: bytes(log.content),
        size=lambda: len(log.content),
        remove=lambda: recorder.remove(log),
    )
