"""ArduPilot's logs and files: DataFlash, packed parameters and missions, and `@SYS` as in software."""

import errno
from collections.abc import Iterator
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.files import ftp_rules, log_transfer
from sim_vehicle.files.filesystem import FileError, GeneratedFile
from sim_vehicle.files.logs.dataflash import DataFlashLog
from sim_vehicle.files.logs.recorder import LogLimits
from sim_vehicle.files.packed_files import Parameter, UploadedMission
from sim_vehicle.files.vehicle_files import ardupilot_files
from sim_vehicle.personalities.ardupilot.stores import Store
from sim_vehicle.personalities.ardupilot.transfer import ArduPilotTransfer
from sim_vehicle.vehicle.interface import Vehicle
from sim_vehicle.vehicle.mission import Item
from sim_vehicle.vehicle.mission_messages import MISSION, item_from_message, item_message
from sim_vehicle.vehicle.storage import Storage

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


def storage(vehicle: Vehicle, limits: LogLimits) -> Storage:
    """Return the storage of one vehicle."""
    transfer = vehicle.transfer
    assert isinstance(transfer, ArduPilotTransfer)
    stores, params = transfer.stores, vehicle.params

    def parameters() -> list[Parameter]:
        defaults = params.defaults
        return [Parameter(name, value, defaults[name], params.bits(name)) for name, value in params.items()]

    def set_parameter(name: str, value: float) -> None:
        if name in params:
            vehicle.set_parameter(name, value)

    def set_items(kind: int, upload: UploadedMission) -> bool:
        if vehicle.injected_faults.mission_refusal is not None:
            return False
        accepted = _write(stores[kind], upload, may_update=kind == MISSION)
        transfer.count_stored(kind)
        return accepted

    return Storage(
        vehicle,
        new_log=DataFlashLog,
        files=lambda recorder: ardupilot_files(
            parameters=parameters,
            set_parameter=set_parameter,
            banner=lambda: _banner(vehicle),
            items=lambda kind: _items(stores[kind], kind),
            set_items=set_items,
            recorder=recorder,
            system=_SYSTEM_FILES,
        ),
        ftp_rules=ftp_rules.ARDUPILOT,
        log_rules=log_transfer.ARDUPILOT,
        limits=limits,
    )


def _banner(vehicle: Vehicle) -> None:
    for text in vehicle.personality.identity.banner:
        vehicle.send_text(mavlink.MAV_SEVERITY_INFO, text)


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
