"""PX4's logs and files: ULog and the component metadata."""

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np

from sim_vehicle.definitions import (
    COMPONENT_INFORMATION,
    COMPONENT_INFORMATION_BASIC,
    COMPONENT_METADATA,
    Layout,
)
from sim_vehicle.files import ftp_rules, log_transfer
from sim_vehicle.files.component_metadata import Component, ComponentMetadata
from sim_vehicle.files.filesystem import FileSystem, GeneratedFile, constant
from sim_vehicle.files.logs.recorder import FlightRecorder, StoredLog
from sim_vehicle.files.logs.ulog import UlogLog
from sim_vehicle.personalities.base import StorageRules
from sim_vehicle.personalities.px4 import parameters
from sim_vehicle.vehicle.interface import Vehicle

_LOGS = "fs/microsd/log"


def files(vehicle: Vehicle, recorder: FlightRecorder) -> FileSystem:
    """Return PX4's tree: the metadata files, and logs by date on the writable SD card (`/fs/microsd`)."""

    def sources() -> Mapping[str, GeneratedFile]:
        fixed = {path: constant(content) for path, content in _metadata_of(vehicle).files.items()}
        return {**fixed, **{f"{_LOGS}/{log_name(log)}": recorder.file_of(log) for log in recorder.logs}}

    return FileSystem(sources, writable=("fs/microsd",))


def log_name(log: StoredLog) -> str:
    """Return the path of a log on the SD card, `YYYY-MM-DD/hh_mm_ss.ulg` of its start (UTC)."""
    date, time = str(np.datetime64(max(int(log.begun_utc_s), 0), "s")).split("T")
    return f"{date}/{time.replace(':', '_')}.ulg"


STORAGE = StorageRules(UlogLog, files, ftp_rules.PX4, log_transfer.PX4)


def _metadata_of(vehicle: Vehicle) -> ComponentMetadata:
    identity = vehicle.personality.identity
    return _metadata(identity.plane, identity.flight_sw_version, identity.capabilities)


@cache
def _metadata(plane: bool, flight_sw_version: int, capabilities: int) -> ComponentMetadata:
    """Return the metadata shared by all vehicles of one kind, created on the first call."""
    version = ".".join(str(flight_sw_version >> shift & 0xFF) for shift in (24, 16, 8))
    values = parameters.PLANE if plane else parameters.COPTER
    return ComponentMetadata(Component("PX4", "sim_vehicle", version, capabilities), values)


def _message(layout: Layout) -> Callable[[Vehicle, float], Sequence[Any]]:
    def messages(vehicle: Vehicle, _parameter: float) -> Sequence[Any]:
        boot_ms = round((vehicle.now - vehicle.readiness.boot_s) * 1000)
        return [_metadata_of(vehicle).message(layout, boot_ms)]

    return messages


ONE_SHOT_MESSAGES = {
    layout.message_id: _message(layout)
    for layout in (COMPONENT_METADATA, COMPONENT_INFORMATION, COMPONENT_INFORMATION_BASIC)
}
