"""Clients of FTP and of the log messages in virtual time: messages in, messages out."""

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pymavlink import DFReader
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import Station

from sim_vehicle.files.filesystem import FileSystem
from sim_vehicle.files.ftp import HEADER, FtpServer
from sim_vehicle.files.ftp_rules import FtpError, FtpRules, Opcode

TICK_S = 0.1


class FileStation(Station):
    """A station of a whole vehicle that reads files by MAVLink FTP."""

    def ftp(self, opcode: int, data: bytes = b"", *, offset: int = 0, size: int | None = None) -> bytes:
        """Return the data of the answer to one request; raise AssertionError with the error of a refusal."""
        self.seq = getattr(self, "seq", 0) + 1
        head = HEADER.pack(self.seq, 0, opcode, len(data) if size is None else size, 0, 0, offset)
        payload = (head + data).ljust(251, b"\0")
        replies = self.send(mavlink.MAVLink_file_transfer_protocol_message(0, self.target, 1, payload))
        (reply,) = [m for m in replies if m.get_type() == "FILE_TRANSFER_PROTOCOL"]
        answer = bytes(reply.payload)
        _, _, result, length, _, _, _ = HEADER.unpack_from(answer)
        body = answer[HEADER.size : HEADER.size + length]
        assert result == Opcode.ACK, FtpError(body[0]).name
        return body

    def file(self, path: bytes) -> bytes:
        """Return the content of a file."""
        (size,) = struct.unpack("<I", self.ftp(Opcode.OPEN_FILE_RO, path))
        content = b""
        while len(content) < size:
            content += self.ftp(Opcode.READ_FILE, offset=len(content), size=239)
        self.ftp(Opcode.TERMINATE_SESSION)
        return content


def read_dataflash(content: bytes, path: Path) -> list[Any]:
    """Return the messages of a DataFlash log, written to `path` for its reader."""
    path.write_bytes(content)
    with DFReader.DFReader_binary(str(path)) as reader:
        messages = []
        while (message := reader.recv_msg()) is not None:
            messages.append(message)
        assert reader.percent > 99
        return messages


def of(messages: list[Any], kind: str) -> list[Any]:
    return [message for message in messages if message.get_type() == kind]


class MessageCodec:
    """The MAVLink encoding between a ground station and the code under test."""

    def __init__(self, *, sysid: int = 255) -> None:
        self._station = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=190)
        self._vehicle = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self._decoder = mavlink.MAVLink(None)

    def to_vehicle(self, message: Any) -> Any:
        (decoded,) = self._decoder.parse_buffer(message.pack(self._station))
        return decoded

    def to_station(self, message: Any) -> Any:
        (decoded,) = self._decoder.parse_buffer(message.pack(self._vehicle))
        return decoded


@dataclass(frozen=True)
class FtpReply:
    """An answer of the server."""

    seq: int
    session: int
    opcode: int
    request: int
    complete: int
    offset: int
    data: bytes

    @property
    def error(self) -> int:
        assert self.opcode == Opcode.NAK, self
        return self.data[0]


class FtpClient:
    """A client that sends any requests; time passes only in `wait`."""

    def __init__(self, files: FileSystem, rules: FtpRules, **pace: float) -> None:
        self.sent: list[Any] = []
        self.server = FtpServer(files, rules, send=self.sent.append, **pace)
        self.now = 0.0
        self.seq = 0
        self.wire = MessageCodec()

    def request(
        self,
        opcode: int,
        data: bytes = b"",
        *,
        session: int = 0,
        offset: int = 0,
        size: int | None = None,
        seq: int | None = None,
        wire: MessageCodec | None = None,
    ) -> list[FtpReply]:
        """Send a request and return the immediate answers."""
        if seq is None:
            self.seq = (self.seq + 1) & 0xFFFF
            seq = self.seq
        length = len(data) if size is None else size
        payload = HEADER.pack(seq, session, opcode, length, 0, 0, offset) + data
        return self.send(payload.ljust(251, b"\0")[:251], wire)

    def send(self, payload: bytes, wire: MessageCodec | None = None) -> list[FtpReply]:
        wire = wire or self.wire
        message = mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, payload)
        self.server.receive(wire.to_vehicle(message), self.now)
        return self.take()

    def one(self, opcode: int, data: bytes = b"", **fields: Any) -> FtpReply:
        (reply,) = self.request(opcode, data, **fields)
        return reply

    def take(self) -> list[FtpReply]:
        replies = []
        for message in self.sent:
            payload = bytes(self.wire.to_station(message).payload)
            seq, session, opcode, size, request, complete, offset = HEADER.unpack_from(payload)
            data = payload[HEADER.size : HEADER.size + size]
            replies.append(FtpReply(seq, session, opcode, request, complete, offset, data))
        self.sent.clear()
        return replies

    def wait(self, seconds: float) -> list[FtpReply]:
        end, replies = self.now + seconds, self.take()
        while self.now < end - 1e-9:
            self.now += TICK_S
            self.server.tick(self.now)
            replies += self.take()
        return replies
