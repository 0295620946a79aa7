"""ArduPilot's logs and files: DataFlash, packed parameters and missions, and `@SYS` as in software."""

import errno
from collections.abc import Iterator, Mapping
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.files import ftp_rules, log_transfer
from sim_vehicle.files.filesystem import FileError, FileSystem, GeneratedFile, constant
from sim_vehicle.files.logs.dataflash import DataFlashLog
from sim_vehicle.files.logs.recorder import FlightRecorder
from sim_vehicle.files.packed_files import (
    Parameter,
    UploadedMission,
    pack_mission,
    pack_parameters,
    unpack_mission,
    unpack_parameters,
)
from sim_vehicle.personalities.ardupilot.stores import Store
from sim_vehicle.personalities.ardupilot.transfer import ArduPilotTransfer
from sim_vehicle.personalities.base import StorageRules
from sim_vehicle.vehicle.interface import Vehicle
from sim_vehicle.vehicle.mission import Item
from sim_vehicle.vehicle.mission_messages import FENCE, MISSION, RALLY, item_from_message, item_message

_LOGS = "APM/LOGS"
_MISSION_FILES = {"mission": MISSION, "fence": FENCE, "rally": RALLY}
_NO_PEER = (0, 0)  # target of the items in a file

# Files under @SYS; most are listed and cannot be opened.
_LISTED_BYTES = 100_000  # size of a text in a listing, before it is made
_STORAGE_BYTES = 16_384
_PORT = "SERIAL0 TX=       0 RX=       0 TXBD=     0 RXBD=     0 connected     (link)"
_TEXTS = {
    "tasks.txt": "TasksV2\n",  # without SCHED_OPTIONS no task is measured
    "uarts.txt": f"UARTV1\n{_PORT}\n",  # bytes are not counted
}
# Texts of hardware that software does not have, and the crash that has not happened.
_EMPTY = (
    "threads.txt",
    "dma.txt",
    "memory.txt",
    "timers.txt",
    "can_log.txt",
    "can0_stats.txt",
    "can1_stats.txt",
    "crash_dump.bin",
)


def _missing(_query: str) -> bytes:
    raise FileError(errno.ENOENT)


def _text_file(text: str) -> GeneratedFile:
    return GeneratedFile(read=lambda _query: text.encode(), size=lambda: _LISTED_BYTES)


_SYSTEM_FILES = {
    **dict.fromkeys(_EMPTY, GeneratedFile(read=_missing, size=lambda: _LISTED_BYTES)),
    **{name: _text_file(text) for name, text in _TEXTS.items()},
    # The parameters are not stored as bytes.
    "storage.bin": GeneratedFile(read=lambda _query: bytes(_STORAGE_BYTES), size=lambda: _STORAGE_BYTES),
}


def files(vehicle: Vehicle, recorder: FlightRecorder) -> FileSystem:
    """Return ArduPilot's tree: `@PARAM`, `@MISSION`, `@SYS` and the logs; `/APM` is writable."""
    fixed = {"@PARAM/param.pck": _parameter_file(vehicle)}
    fixed |= {f"@MISSION/{name}.dat": _mission_file(vehicle, kind) for name, kind in _MISSION_FILES.items()}
    fixed |= {f"@SYS/{name}": file for name, file in _SYSTEM_FILES.items()}

    def sources() -> Mapping[str, GeneratedFile]:
        logs = {f"{_LOGS}/{log.number:08d}.BIN": recorder.file_of(log) for log in recorder.logs}
        if recorder.logs:
            logs[f"{_LOGS}/LASTLOG.TXT"] = constant(b"%d\r\n" % recorder.logs[-1].number)
        return {**fixed, **logs}

    return FileSystem(sources, writable=("APM",))


STORAGE = StorageRules(DataFlashLog, files, ftp_rules.ARDUPILOT, log_transfer.ARDUPILOT)


def _parameter_file(vehicle: Vehicle) -> GeneratedFile:
    params = vehicle.params

    def packed(query: str = "") -> bytes:
        defaults = params.defaults
        rows = [Parameter(name, value, defaults[name], params.bits(name)) for name, value in params.items()]
        return pack_parameters(rows, query)

    def read(query: str) -> bytes:
        for text in vehicle.personality.identity.banner:  # announces a download
            vehicle.send_text(mavlink.MAV_SEVERITY_INFO, text)
        return packed(query)

    def write(content: bytes) -> bool:
        values = unpack_parameters(content)
        for name, value in (values or {}).items():
            if name in params:
                vehicle.set_parameter(name, value)
        return values is not None

    return GeneratedFile(read, lambda: len(packed()), write)


def _mission_file(vehicle: Vehicle, kind: int) -> GeneratedFile:
    transfer: ArduPilotTransfer = vehicle.transfer
    store = transfer.stores[kind]

    def packed() -> bytes:
        return pack_mission(kind, _items(store, kind))

    def write(content: bytes) -> bool:
        upload = unpack_mission(kind, content)
        if upload is None or vehicle.injected_faults.effect.mission_refusal is not None:
            return False
        accepted = _write(store, upload, may_update=kind == MISSION)
        transfer.count_stored(kind)
        return accepted

    return GeneratedFile(lambda _query: packed(), lambda: len(packed()), write)


def _items(store: Store, kind: int) -> Iterator[Any]:
    for seq in range(store.count):
        item = store.read(seq)
        if isinstance(item, Item):
            yield item_message(_NO_PEER, seq, item, kind, as_int=True, autocontinue=store.autocontinue)


def _write(store: Store, upload: UploadedMission, *, may_update: bool) -> bool:
    """Write an uploaded file to a store; return False on an error.

    A mission is written item by item, so an error can leave a mixture of old and new items.
    """
    last = upload.start + len(upload.items) - 1
    if last >= store.max_items or not (upload.clear or may_update):
        return False
    if upload.clear:
        store.begin(len(upload.items))
    else:
        store.begin_update()
    for index, message in enumerate(upload.items, start=upload.start):
        item = item_from_message(message)
        if item is None or store.put(index, item, last) != mavlink.MAV_MISSION_ACCEPTED:
            store.abandon()
            return False
    return bool(store.complete() == mavlink.MAV_MISSION_ACCEPTED)
