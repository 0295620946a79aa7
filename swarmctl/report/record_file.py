"""Reading of `run.mcap`: the format, the configuration, the messages, and the lock of a run in progress.

The reader takes a file from its begin on, also while a flight writes it, chunk by chunk.
"""

from __future__ import annotations

import fcntl
import struct
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple

import msgspec
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC

from swarmctl import __version__
from swarmctl.config.model import Config

FORMAT = 6
"""number that grows with each change of the events, the effects or the configuration"""
_RECORD = struct.Struct("<BQ")
"""opcode and length, before each record of an MCAP file"""
FIRST_FREE_OPCODE = 0x80
"""first of the opcodes that the format leaves to programs"""
MAX_CHUNK_BYTES = 1 << 28
"""longest unpacked chunk [bytes]; a longer one is damage"""


class RecordError(Exception):
    """A record that cannot be read; the text holds the file and the fault."""


class StoredMessage(NamedTuple):
    """One message of a record, as stored."""

    number: int
    topic: str
    schema: str
    definition: bytes
    log_time_ns: int
    data: bytes


class StoredRecord(msgspec.Struct, frozen=True):
    """The complete part of a record."""

    config: Config
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


def is_in_progress(path: Path) -> bool:
    """Return whether a process writes a record; True on a file system without locks. Raises RecordError."""
    try:
        with path.open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except FileNotFoundError:
        raise not_found(path) from None
    except OSError:  # BlockingIOError: the recorder has the lock
        return True
    return False


def read(path: Path) -> StoredRecord:
    """Return the complete part of a record. Raises RecordError."""
    stream = RecordStream(path)
    try:
        config = stream.configuration()
        messages = [message for chunk in stream.chunks() for message in chunk]
    finally:
        stream.close()
    messages.sort(key=lambda message: message.number)
    return StoredRecord(config, messages, not stream.is_complete)


def not_found(path: Path) -> RecordError:
    """Return the error for a missing run, or for a file that its folder lacks."""
    return RecordError(f"{path}: not found; give the folder of a run [no-run]")


def damaged(path: Path, error: Exception) -> RecordError:
    reason = str(error) or f"ends early or is damaged ({type(error).__name__})"
    return RecordError(f"{path}: cannot be read as a record: {reason} [damaged]")


def other_format(path: Path, found: str) -> RecordError:
    text = f"the record has format {found or '?'}, and swarmctl {__version__} reads format {FORMAT}"
    return RecordError(f"{path}: {text}; use the version that wrote it [other-format]")


class RecordStream:
    """The messages of one record, in the order of writing. Each call goes on where the last one ended.

    Raises RecordError for a file that is no record, or that is damaged; a file that ends early is no damage.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.is_complete = False
        """True after the end of a finished record"""
        self.n_read = 0
        """bytes read so far"""
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        try:
            self._file = path.open("rb")
        except FileNotFoundError:
            raise not_found(path) from None
        except OSError as error:
            raise damaged(path, error) from error

    @property
    def size(self) -> int:
        """Length of the file now [bytes]."""
        return self.path.stat().st_size

    def close(self) -> None:
        self._file.close()

    def configuration(self) -> Config:
        """Return the configuration of the run, which precedes every message. Raises RecordError."""
        try:
            self._file.seek(0)
            records = StreamReader(self._file).records
            metadata = next(r.metadata for r in records if isinstance(r, Metadata) and r.name == "swarmctl")
        except Exception as error:  # a damaged record fails in many ways
            raise damaged(self.path, error) from error
        if (found := metadata.get("format", "")) != str(FORMAT):
            raise other_format(self.path, found)
        try:
            return Config.model_validate_json(metadata["config"])
        except (KeyError, ValueError) as error:
            raise damaged(self.path, error) from error

    def chunks(self) -> Iterator[list[StoredMessage]]:
        """Yield the messages of each complete chunk that the file has now, after those of earlier calls."""
        try:
            self.n_read = max(self.n_read, len(MCAP0_MAGIC))
            size = self.size
            while not self.is_complete and self.n_read + _RECORD.size <= size:
                self._file.seek(self.n_read)
                opcode, length = _RECORD.unpack(self._file.read(_RECORD.size))
                if opcode < FIRST_FREE_OPCODE:
                    Opcode(opcode)  # raises ValueError for other bytes than a record's
                end = self.n_read + _RECORD.size + length
                if end > size:
                    return
                if opcode == Opcode.CHUNK:
                    messages = list(self._messages(self._file.read(length)))
                    self.n_read = end
                    yield messages
                self.n_read = end
                self.is_complete = opcode == Opcode.FOOTER
        except Exception as error:  # a damaged record fails in many ways: compression, lengths, names
            raise damaged(self.path, error) from error

    def _messages(self, content: bytes) -> Iterator[StoredMessage]:
        chunk = Chunk.read(ReadDataStream(BytesIO(content)))
        if chunk.uncompressed_size > MAX_CHUNK_BYTES:
            raise ValueError(f"a chunk of {chunk.uncompressed_size} bytes")
        for record in breakup_chunk(chunk, validate_crc=True):
            match record:
                case Message():
                    channel = self._channels[record.channel_id]
                    schema = self._schemas[channel.schema_id]
                    yield StoredMessage(
                        record.sequence, channel.topic, schema.name, schema.data, record.log_time, record.data
                    )
                case Schema():
                    self._schemas[record.id] = record
                case Channel():
                    self._channels[record.id] = record
