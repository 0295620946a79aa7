"""ArduPilot's files under `@SYS`, as in software: most are listed and cannot be opened."""

import errno

from sim_vehicle.files.filesystem import FileError, GeneratedFile

LISTED_BYTES = 100_000  # size of a text in a listing, before it is made
STORAGE_BYTES = 16_384
PORT = "SERIAL0 TX=       0 RX=       0 TXBD=     0 RXBD=     0 connected     (link)"
_TEXTS = {
    "tasks.txt": "TasksV2\n",  # without SCHED_OPTIONS no task is measured
    "uarts.txt": f"UARTV1\n{PORT}\n",  # bytes are not counted
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
    return GeneratedFile(read=lambda _query: text.encode(), size=lambda: LISTED_BYTES)


SYSTEM_FILES = {
    **dict.fromkeys(_EMPTY, GeneratedFile(read=_missing, size=lambda: LISTED_BYTES)),
    **{name: _text_file(text) for name, text in _TEXTS.items()},
    # The parameters are not stored as bytes.
    "storage.bin": GeneratedFile(read=lambda _query: bytes(STORAGE_BYTES), size=lambda: STORAGE_BYTES),
}
