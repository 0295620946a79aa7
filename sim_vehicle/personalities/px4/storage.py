"""PX4's logs and files: ULog and the component metadata."""

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

from sim_vehicle.definitions import (
    COMPONENT_INFORMATION,
    COMPONENT_INFORMATION_BASIC,
    COMPONENT_METADATA,
    Layout,
)
from sim_vehicle.files import ftp_rules, log_transfer
from sim_vehicle.files.component_metadata import Component, ComponentMetadata
from sim_vehicle.files.logs.recorder import LogLimits
from sim_vehicle.files.logs.ulog import UlogLog
from sim_vehicle.files.vehicle_files import px4_files
from sim_vehicle.personalities.px4 import parameters
from sim_vehicle.vehicle.interface import Vehicle
from sim_vehicle.vehicle.storage import Storage


def storage(vehicle: Vehicle, limits: LogLimits) -> Storage:
    """Return the storage of one vehicle."""
    return Storage(
        vehicle,
        new_log=UlogLog,
        files=lambda recorder: px4_files(metadata=lambda: _metadata_of(vehicle), recorder=recorder),
        ftp_rules=ftp_rules.PX4,
        log_rules=log_transfer.PX4,
        limits=limits,
    )


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
