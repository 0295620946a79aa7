"""The server of the MAVLink file transfer protocol, a state machine without I/O.

Both autopilots serve one open file at a time. `FtpRules` has the differences between autopilots.
"""

import errno
import struct
import zlib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.files.filesystem import DirectoryEntry, FileError, FileSystem
from sim_vehicle.files.ftp_rules import OPENING_OPCODES, FtpError, FtpRules, Opcode
from sim_vehicle.files.pacing import BYTES_S, MAX_BYTES_AT_ONCE, Pacer

HEADER = struct.Struct("<HBBBBBxI")  # seq, session, opcode, size, request's opcode, burst complete, offset
SIZE = struct.Struct("<I")
MAX_DATA_BYTES = 239  # bytes of data in one message
# Requests at an offset, which their answers repeat.
POSITIONED = frozenset({Opcode.LIST_DIRECTORY, Opcode.READ_FILE, Opcode.WRITE_FILE})
FRAME_BYTES = 277  # assumed size of one message on the link


class _Nak(Exception):
    def __init__(self, error: FtpError, error_number: int | None = None) -> None:
        super().__init__(error.name)
        self.error, self.errno = error, error_number


@dataclass(frozen=True, slots=True)
class _Request:
    peer: tuple[int, int]  # system and component id
    seq: int
    session: int
    opcode: int
    offset: int
    size: int
    data: bytes

    @property
    def path(self) -> str:
        return _path(self.data)


@dataclass
class _OpenFile:
    session: int
    path: str
    content: bytes | None  # None: open for writing
    last_use_s: float


@dataclass
class _Burst:
    request: _Request
    offset: int
    seq: int
    remaining: int  # largest number of messages before the next request of the client


class FtpServer:
    """The FTP server of one vehicle.

    files: the served files.
    rules: the behaviour of the autopilot.
    send: called with each outgoing message.
    bytes_s, max_bytes_at_once: mean rate of bursts [bytes/s], largest part sent at once [bytes].
    """

    def __init__(
        self,
        files: FileSystem,
        rules: FtpRules,
        *,
        send: Callable[[Any], None],
        bytes_s: float = BYTES_S,
        max_bytes_at_once: float = MAX_BYTES_AT_ONCE,
    ) -> None:
        self._files, self._rules, self._send = files, rules, send
        self._pacer = Pacer(bytes_s, max_bytes_at_once)
        self._open: _OpenFile | None = None
        self._burst: _Burst | None = None
        self._last: tuple[_Request, bytes] | None = None  # the latest answered request and its answer
        # opcode -> function of the request and the time [s] that returns the data of the answer
        self._operations: dict[int, Callable[[_Request, float], bytes | None]] = {
            Opcode.NONE: lambda _request, _now: None,
            Opcode.TERMINATE_SESSION: self._terminate,
            Opcode.RESET_SESSIONS: self._reset_sessions,
            Opcode.LIST_DIRECTORY: self._list,
            Opcode.OPEN_FILE_RO: self._open_to_read,
            Opcode.READ_FILE: self._read,
            Opcode.CREATE_FILE: self._open_to_write,
            Opcode.OPEN_FILE_WO: self._open_to_write,
            Opcode.WRITE_FILE: self._write,
            Opcode.REMOVE_FILE: lambda request, _now: files.remove(request.path),
            Opcode.CREATE_DIRECTORY: lambda request, _now: files.make_directory(request.path),
            Opcode.REMOVE_DIRECTORY: lambda request, _now: files.remove_directory(request.path),
            Opcode.RENAME: self._rename,
            Opcode.CALC_FILE_CRC32: lambda request, _now: SIZE.pack(checksum(files.read(request.path))),
        }
        if rules.truncates:
            self._operations[Opcode.TRUNCATE_FILE] = lambda request, _now: files.truncate(
                request.path, request.offset
            )

    @property
    def busy(self) -> bool:
        """Return True during a burst; each call of `tick` continues the burst."""
        return self._burst is not None

    def receive(self, message: Any, now: float) -> None:
        """Process one FILE_TRANSFER_PROTOCOL at `now` [s]; a repeated request gets the same answer."""
        payload = bytes(message.payload)
        seq, session, opcode, size, _, _, offset = HEADER.unpack_from(payload)
        if opcode in (Opcode.ACK, Opcode.NAK):
            return
        peer = (message.get_srcSystem(), message.get_srcComponent())
        data = payload[HEADER.size : HEADER.size + size]
        request = _Request(peer, seq, session, opcode, offset, size, data)
        if self._last is not None and request == self._last[0]:
            self._transmit(peer, self._last[1])
            return
        try:
            self._answer(request, now)
        except _Nak as nak:
            self._reply_nak(request, nak)
        except FileError as error:
            self._reply_nak(request, _nak_of_errno(error.number))

    def tick(self, now: float) -> None:
        """Send the messages of a burst due by `now` [s]; PX4 also closes an idle file."""
        while self._burst is not None and self._pacer.take(FRAME_BYTES, now):
            self._continue_burst(self._burst, now)
        opened = self._open
        idle = opened is not None and now - opened.last_use_s > self._rules.idle_s
        if idle and not self._rules.client_names_session:
            self._abandon()

    def reset(self) -> None:
        """Forget the open file and the burst after a reboot; bytes written to other files remain."""
        if self._open is not None:
            self._files.discard_upload(self._open.path)
        self._open = self._burst = self._last = None

    # -- answering ---------------------------------------------------------------------------------------

    def _answer(self, request: _Request, now: float) -> None:
        if request.size > MAX_DATA_BYTES:
            raise _Nak(FtpError.INVALID_DATA_SIZE)
        self._check_session(request, now)
        if request.opcode == Opcode.BURST_READ_FILE:
            self._content()
            self._burst = _Burst(request, request.offset, request.seq + 1, self._rules.burst_messages)
            self.tick(now)
            return
        operation = self._operations.get(request.opcode)
        if operation is None:
            raise _Nak(self._rules.unknown_command)
        data = operation(request, now) or b""
        if self._open is not None and self._open.session == request.session:
            self._open.last_use_s = now
        self._reply(request, Opcode.ACK, data, request.offset if request.opcode in POSITIONED else 0)

    def _reply(self, request: _Request, opcode: Opcode, data: bytes, offset: int) -> None:
        opens = opcode is Opcode.ACK and request.opcode in OPENING_OPCODES
        session = 0 if opens and not self._rules.client_names_session else request.session
        seq = (request.seq + 1) & 0xFFFF
        head = HEADER.pack(seq, session, opcode, len(data), request.opcode, 0, offset)
        self._last = (request, head + data)
        self._transmit(request.peer, head + data)

    def _reply_nak(self, request: _Request, nak: _Nak) -> None:
        self._reply(request, Opcode.NAK, _nak_data(nak), request.offset)

    def _transmit(self, peer: tuple[int, int], payload: bytes) -> None:
        padded = payload.ljust(HEADER.size + MAX_DATA_BYTES, b"\0")
        self._send(mavlink.MAVLink_file_transfer_protocol_message(0, *peer, padded))

    # -- sessions ----------------------------------------------------------------------------------------

    def _check_session(self, request: _Request, now: float) -> None:
        """Raise _Nak if the rules refuse a request outside of the open session; close an idle session."""
        opened, opcode = self._open, request.opcode
        if not self._rules.client_names_session:
            if opcode == Opcode.READ_FILE and request.session != 0:
                raise _Nak(self._rules.another_session)
            return
        ends = opcode in (Opcode.TERMINATE_SESSION, Opcode.RESET_SESSIONS)
        if opened is None or request.session == opened.session or ends:
            return
        if now - opened.last_use_s < self._rules.idle_s:
            raise _Nak(self._rules.another_session)
        self._abandon()

    def _terminate(self, request: _Request, _now: float) -> None:
        opened = self._open
        if self._rules.terminate_needs_open and (opened is None or request.session != 0):
            raise _Nak(self._rules.nothing_open)
        if opened is not None and request.session == opened.session:
            self._close()

    def _reset_sessions(self, request: _Request, _now: float) -> None:
        if self._open is not None and (
            not self._rules.client_names_session or request.session == self._open.session
        ):
            self._close()

    def _close(self) -> None:
        opened, self._open, self._burst = self._open, None, None
        if opened is not None and opened.content is None:
            self._files.close(opened.path)

    def _abandon(self) -> None:
        """Close an idle file and ignore errors."""
        with suppress(FileError):
            self._close()

    def _new_session(self, request: _Request, now: float) -> int:
        """Return the session of the next opened file; raise _Nak if a file is open and not idle."""
        opened = self._open
        if opened is not None and now - opened.last_use_s > self._rules.idle_s:
            self._abandon()
        if self._open is not None:
            raise _Nak(self._rules.second_open)
        return request.session if self._rules.client_names_session else 0

    # -- files -------------------------------------------------------------------------------------------

    def _open_to_read(self, request: _Request, now: float) -> bytes | None:
        session = self._new_session(request, now)
        content = self._files.read(request.path)
        self._open = _OpenFile(session, request.path, content, now)
        return SIZE.pack(len(content))

    def _open_to_write(self, request: _Request, now: float) -> bytes | None:
        session = self._new_session(request, now)
        path = self._files.open_to_write(request.path, truncate=request.opcode == Opcode.CREATE_FILE)
        self._open = _OpenFile(session, path, None, now)
        return SIZE.pack(len(self._files.read(path))) if self._rules.reports_sizes else None

    def _content(self) -> bytes:
        if self._open is None:
            raise _Nak(self._rules.nothing_open)
        if self._open.content is None:
            raise _Nak(FtpError.FAIL)
        return self._open.content

    def _read(self, request: _Request, _now: float) -> bytes | None:
        size = request.size if self._rules.obeys_read_size else MAX_DATA_BYTES
        data = self._content()[request.offset : request.offset + size]
        if not data:
            raise _Nak(FtpError.END_OF_FILE)
        return data

    def _continue_burst(self, burst: _Burst, now: float) -> None:
        opened = self._open
        if opened is None or opened.content is None:
            self._burst = None
            return
        request, rules = burst.request, self._rules
        opened.last_use_s = now
        size = (request.size or MAX_DATA_BYTES) if rules.obeys_read_size else MAX_DATA_BYTES
        data = opened.content[burst.offset : burst.offset + size]
        burst.remaining -= 1
        if data:
            opcode, complete = Opcode.ACK, burst.remaining == 0
        else:
            opcode, complete, data = Opcode.NAK, rules.obeys_read_size, bytes([FtpError.END_OF_FILE])
        session = request.session if rules.client_names_session else 0
        seq = burst.seq & 0xFFFF
        head = HEADER.pack(seq, session, opcode, len(data), request.opcode, complete, burst.offset)
        burst.seq += 1
        burst.offset += len(data)
        if opcode is Opcode.NAK or complete:
            self._burst = None
        self._transmit(request.peer, head + data)

    def _write(self, request: _Request, _now: float) -> bytes | None:
        opened = self._open
        if opened is None:
            raise _Nak(self._rules.nothing_open)
        if opened.content is not None:
            raise _Nak(FtpError.FAIL)
        self._files.write(opened.path, request.offset, request.data)
        return SIZE.pack(len(request.data)) if self._rules.reports_sizes else None

    def _rename(self, request: _Request, _now: float) -> None:
        old, separator, new = request.data.partition(b"\0")
        if not separator:
            raise _Nak(FtpError.INVALID_DATA_SIZE)
        self._files.rename(_path(old), _path(new))

    def _list(self, request: _Request, _now: float) -> bytes | None:
        lines = [b"S\0", b"S\0"] if self._rules.lists_dots else []
        lines += [_line(entry) for entry in self._files.entries(request.path)]
        lines = [line for line in lines if len(line) <= MAX_DATA_BYTES]
        listed = b""
        for line in lines[request.offset :]:
            if len(listed) + len(line) > MAX_DATA_BYTES:
                break
            listed += line
        if not listed:
            raise _Nak(FtpError.END_OF_FILE)
        return listed


def checksum(content: bytes) -> int:
    """Return the protocol's CRC-32: initial value 0, without a final inversion."""
    return zlib.crc32(content, 0xFFFFFFFF) ^ 0xFFFFFFFF


def _path(data: bytes) -> str:
    name = data.partition(b"\0")[0]
    if not name:
        raise _Nak(FtpError.INVALID_DATA_SIZE)
    return name.decode("utf-8", "surrogateescape")


def _line(entry: DirectoryEntry) -> bytes:
    name = entry.name.encode("utf-8", "surrogateescape")
    return b"D%s\0" % name if entry.size is None else b"F%s\t%d\0" % (name, entry.size)


def _nak_of_errno(number: int) -> _Nak:
    if number == errno.ENOENT:
        return _Nak(FtpError.FILE_NOT_FOUND)
    if number == errno.EEXIST:
        return _Nak(FtpError.FILE_EXISTS)
    return _Nak(FtpError.FAIL_ERRNO, number)


def _nak_data(nak: _Nak) -> bytes:
    return bytes([nak.error] if nak.errno is None else [nak.error, nak.errno])
