"""Reading of `run.mcap`: the format, the configuration, the messages, and the lock of a run in progress.

The reader takes a file from its begin on, also while a flight writes it. It parses only the fields that are
used, so that a dashboard opens the record of an hour in seconds: `mcap.stream_reader.breakup_chunk` takes
1.8 times as long.
"""

from __future__ import annotations

import fcntl
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

import msgspec
import zstandard
from mcap.opcode import Opcode
from mcap.records import Metadata
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC

from swarmctl import __version__
from swarmctl.config.model import Config

FORMAT = 5
"""number that grows with each change of the events, the effects or the configuration"""
_RECORD = struct.Struct("<BQ")
"""opcode and length, before each record of an MCAP file"""
_CHUNK = struct.Struct("<QQQII")
"""first and last time, length when unpacked, checksum, and length of the name of the compression"""
OPCODES = frozenset(Opcode) | frozenset(range(0x80, 0x100))
"""the format's opcodes, and those that it leaves to programs"""
_MESSAGE = struct.Struct("<HIQQ")
"""channel, number, time of logging, time of publishing"""
MAX_CHUNK_BYTES = 1 << 28
"""longest chunk, packed or unpacked [bytes]; a longer chunk is damage"""


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
        self._schemas: dict[int, tuple[str, bytes]] = {}
        """name and definition"""
        self._channels: dict[int, tuple[str, str, bytes]] = {}
        """topic, and name and definition of its schema"""
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
                opcode, length = _opcode_and_length(self._file.read(_RECORD.size))
                end = self.n_read + _RECORD.size + length
                if end > size:
                    return
                if opcode == Opcode.CHUNK:
                    messages = list(self._messages(_unpacked(self._file.read(length))))
                    self.n_read = end
                    yield messages
                self.n_read = end
                self.is_complete = opcode == Opcode.FOOTER
        except RecordError:
            raise
        except Exception as error:  # a damaged record fails in many ways: compression, lengths, names
            raise damaged(self.path, error) from error

    def _messages(self, chunk: bytes) -> Iterator[StoredMessage]:
        at, size = 0, len(chunk)
        while at < size:
            opcode, length = _RECORD.unpack_from(chunk, at)
            at += _RECORD.size
            if at + length > size:
                raise ValueError("a chunk that ends inside a record")
            if opcode == Opcode.MESSAGE:
                channel, number, log_time_ns, _ = _MESSAGE.unpack_from(chunk, at)
                data = chunk[at + _MESSAGE.size : at + length]
                yield StoredMessage(number, *self._channels[channel], log_time_ns, data)
            elif opcode == Opcode.SCHEMA:
                (schema,) = struct.unpack_from("<H", chunk, at)
                name, rest = _sized(chunk, at + 2)
                _, rest = _sized(chunk, rest)  # the encoding
                self._schemas[schema] = name.decode(), _sized(chunk, rest)[0]
            elif opcode == Opcode.CHANNEL:
                channel, schema = struct.unpack_from("<HH", chunk, at)
                self._channels[channel] = _sized(chunk, at + 4)[0].decode(), *self._schemas[schema]
            at += length


def _unpacked(chunk: bytes) -> bytes:
    _, _, size, checksum, name_length = _CHUNK.unpack_from(chunk)
    at = _CHUNK.size + name_length
    compression, content = chunk[_CHUNK.size : at], chunk[at + 8 :]
    if size > MAX_CHUNK_BYTES:
        raise ValueError(f"a chunk of {size} bytes")
    if compression == b"zstd":
        content = zstandard.ZstdDecompressor().decompress(content, max_output_size=size)
    elif compression:
        raise ValueError(f"unknown compression {compression!r}")
    if checksum and zlib.crc32(content) != checksum:
        raise ValueError("a chunk with a wrong checksum")
    return content


def _sized(chunk: bytes, at: int) -> tuple[bytes, int]:
    """Return bytes that follow their length, and the index after them."""
    (length,) = struct.unpack_from("<I", chunk, at)
    return chunk[at + 4 : at + 4 + length], at + 4 + length


def _opcode_and_length(head: bytes) -> tuple[int, int]:
    """Return opcode and length [bytes] of a record of the file. Raises ValueError for other bytes."""
    opcode, length = _RECORD.unpack(head)
    if opcode not in OPCODES:
        raise ValueError(f"{opcode} is no opcode of a record")
    return opcode, length
