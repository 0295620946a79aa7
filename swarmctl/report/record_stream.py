"""Reading of `run.mcap` from its begin on, also while a flight writes it.

`record_file.read` parses every field of every record. This reader returns the topic, the time and the bytes
of each message, so that a dashboard opens the record of an hour in seconds.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import zstandard
from mcap.opcode import Opcode
from mcap.records import Metadata
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC

from swarmctl import __version__
from swarmctl.config.model import Config
from swarmctl.report.record_file import READABLE, RecordError, damaged, not_found

_RECORD = struct.Struct("<BQ")
"""opcode and length, before each record"""
_CHUNK = struct.Struct("<QQQII")
"""first and last time, length when unpacked, checksum, and length of the name of the compression"""
OPCODES = frozenset(Opcode) | frozenset(range(0x80, 0x100))
"""the format's opcodes, and those that it leaves to programs"""
_MESSAGE = struct.Struct("<HIQQ")
"""channel, number, time of logging, time of publishing"""
MAX_CHUNK_BYTES = 1 << 28
"""longest chunk, packed or unpacked [bytes]; a longer chunk is damage"""


class StreamedMessage(NamedTuple):
    topic: str
    log_time_ns: int
    data: bytes


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
        self._topics: dict[int, str] = {}
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
            if metadata.get("format") in READABLE:
                return Config.model_validate_json(metadata["config"])
        except Exception as error:  # a damaged record fails in many ways
            raise damaged(self.path, error) from error
        text = f"swarmctl {__version__} cannot read this record; use the version that wrote it"
        raise RecordError(f"{self.path}: {text} [other-format]")

    def chunks(self) -> Iterator[list[StreamedMessage]]:
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
                    messages = list(self._messages(self._unpacked(self._file.read(length))))
                    self.n_read = end
                    yield messages
                self.n_read = end
                self.is_complete = opcode == Opcode.FOOTER
        except RecordError:
            raise
        except Exception as error:  # a damaged record fails in many ways: compression, lengths, names
            raise damaged(self.path, error) from error

    @staticmethod
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

    def _messages(self, chunk: bytes) -> Iterator[StreamedMessage]:
        at, size = 0, len(chunk)
        while at < size:
            opcode, length = _RECORD.unpack_from(chunk, at)
            at += _RECORD.size
            if at + length > size:
                raise ValueError("a chunk that ends inside a record")
            if opcode == Opcode.MESSAGE:
                channel, _, log_time_ns, _ = _MESSAGE.unpack_from(chunk, at)
                data = chunk[at + _MESSAGE.size : at + length]
                yield StreamedMessage(self._topics[channel], log_time_ns, data)
            elif opcode == Opcode.CHANNEL:
                channel, _, name_length = struct.unpack_from("<HHI", chunk, at)
                self._topics[channel] = chunk[at + 8 : at + 8 + name_length].decode()
            at += length


def _opcode_and_length(head: bytes) -> tuple[int, int]:
    """Return opcode and length [bytes] of a record of the file. Raises ValueError for other bytes."""
    opcode, length = _RECORD.unpack(head)
    if opcode not in OPCODES:
        raise ValueError(f"{opcode} is no opcode of a record")
    return opcode, length
