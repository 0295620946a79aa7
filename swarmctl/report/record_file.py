"""Reading of `run.mcap`: the format, the metadata, the messages, and the lock of a run in progress."""

from __future__ import annotations

import fcntl
import struct
from dataclasses import dataclass
from io import SEEK_END, BytesIO
from pathlib import Path
from typing import BinaryIO

from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Channel, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC

from swarmctl import __version__

FORMAT = 3
READABLE = frozenset({"2", "3"})
"""readable formats; format 2 has a channel for each vehicle and each kind of event and effect"""
_RECORD = struct.Struct("<BQ")
"""opcode and length, before each record of an MCAP file"""


class RecordError(Exception):
    """A record that cannot be read; the text holds the file and the fault."""


@dataclass(frozen=True, slots=True)
class StoredMessage:
    """One message of a record, as stored."""

    number: int
    topic: str
    schema: str
    definition: bytes
    log_time_ns: int
    data: bytes


@dataclass(frozen=True, slots=True)
class StoredRecord:
    """The complete part of a record."""

    metadata: dict[str, str]
    messages: list[StoredMessage]
    """in the order of their numbers"""
    is_cut: bool
    """True if the record has no end, because the process died"""


def lock(file: BinaryIO) -> bool:
    """Lock a record until the file is closed or the process ends; return False if another process has it.

    Raises OSError on a file system without locks.
    """
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def read(path: Path) -> StoredRecord:
    """Return the complete part of a record. Raises RecordError."""
    try:
        with path.open("rb") as file:
            end, is_cut = _complete_part(file)
            file.seek(0)
            metadata, messages = _parsed(BytesIO(file.read(end)))
    except FileNotFoundError:
        raise not_found(path) from None
    except Exception as error:  # a damaged record fails in many ways: compression, unknown channels
        raise damaged(path, error) from error
    if metadata.get("format") not in READABLE:
        text = f"swarmctl {__version__} cannot read this record; use the version that wrote it"
        raise RecordError(f"{path}: {text} [other-format]")
    return StoredRecord(metadata, sorted(messages, key=lambda message: message.number), is_cut)


def not_found(path: Path) -> RecordError:
    return RecordError(f"{path}: not found; give the folder of a run, which holds run.mcap [no-record]")


def damaged(path: Path, error: Exception) -> RecordError:
    reason = str(error) or f"ends early or is damaged ({type(error).__name__})"
    return RecordError(f"{path}: cannot be read as a record: {reason} [damaged]")


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


def _parsed(file: BinaryIO) -> tuple[dict[str, str], list[StoredMessage]]:
    """Return this program's metadata and the messages."""
    metadata: dict[str, str] = {}
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    messages: list[StoredMessage] = []
    records = StreamReader(file).records
    while True:
        try:
            part = next(records)
        except (StopIteration, EndOfFile):
            return metadata, messages
        match part:
            case Metadata(name="swarmctl"):
                metadata = part.metadata
            case Schema():
                schemas[part.id] = part
            case Channel():
                channels[part.id] = part
            case Message():
                channel = channels[part.channel_id]
                schema = schemas[channel.schema_id]
                messages.append(
                    StoredMessage(
                        part.sequence, channel.topic, schema.name, schema.data, part.log_time, part.data
                    )
                )
