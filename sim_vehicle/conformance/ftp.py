"""A client of the MAVLink file transfer protocol."""

import struct
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance.outcomes import CheckFailed
from sim_vehicle.conformance.traffic import REPLY_S
from sim_vehicle.conformance.vehicle import VehicleUnderTest

# Operations and errors of the protocol.
TERMINATE, RESET, LIST, OPEN_READ, READ, CALC_CRC, BURST = 1, 2, 3, 4, 5, 14, 15
ACK, NAK = 128, 129
FAIL, FAIL_ERRNO, EOF, UNKNOWN_COMMAND, NOT_FOUND = 1, 2, 6, 7, 10
HEADER = struct.Struct("<HBBBBBxI")  # seq, session, opcode, size, request opcode, burst complete, offset
CHUNK = 239  # bytes of data in a full payload
MAX_BURSTS = 2000
MAX_BYTES = 4_000_000  # `read` stops after these bytes


@dataclass(frozen=True, slots=True)
class Reply:
    """One FILE_TRANSFER_PROTOCOL payload from the vehicle."""

    seq: int
    session: int
    opcode: int
    request: int  # opcode of the request
    complete: bool  # True in the last packet of a burst
    offset: int  # of the data in the file [bytes]
    data: bytes

    @property
    def ok(self) -> bool:
        return self.opcode == ACK

    @property
    def error(self) -> int:
        """Return the error code of a NAK; FAIL for a NAK without a code."""
        return self.data[0] if self.data else FAIL


class FtpClient:
    """A client of MAVLink FTP with its own sequence numbers."""

    def __init__(self, vehicle: VehicleUnderTest) -> None:
        self.vehicle = vehicle
        self.seq = 0

    def message(
        self, opcode: int, data: bytes = b"", *, session: int = 0, offset: int = 0, size: int | None = None
    ) -> Any:
        """Return a request with the present sequence number; `size` replaces the data's length."""
        length = len(data) if size is None else size
        payload = HEADER.pack(self.seq, session, opcode, length, 0, 0, offset) + data
        return mavlink.MAVLink_file_transfer_protocol_message(
            0, *self.vehicle.target, payload.ljust(251, b"\0")
        )

    def next_message(self, opcode: int, data: bytes = b"", **fields: int) -> Any:
        """Return a request with the next sequence number."""
        self.seq = (self.seq + 1) % 65_536
        return self.message(opcode, data, **fields)

    def reply(self, mark: int | None = None) -> tuple[Reply, int] | None:
        """Return the next reply after a mark, and the mark after the reply; None after `REPLY_S`."""
        index = self.vehicle.seek(("FILE_TRANSFER_PROTOCOL",), within_s=REPLY_S, mark=mark)
        if index is None:
            return None
        return _reply(bytes(self.vehicle.received[index].message.payload)), index + 1

    def ask(self, opcode: int, data: bytes = b"", **fields: int) -> Reply:
        """Send a request and return the answer; an unanswered request is repeated with the same number."""
        request = self.next_message(opcode, data, **fields)
        return _reply(bytes(self.vehicle.ask(request, "FILE_TRANSFER_PROTOCOL").payload))

    def open(self, path: str) -> tuple[int, int]:
        """Open a file for reading; return session and size [bytes], or raise CheckFailed."""
        answer = self.ask(OPEN_READ, path.encode())
        if not answer.ok:
            raise CheckFailed(f"opening {path}: expected ACK, saw error {answer.error}")
        size = int.from_bytes(answer.data[:4], "little")
        return answer.session, size

    def read(self, path: str, limit: int = MAX_BYTES) -> bytes:
        """Return the content of a file, up to about `limit` bytes, by single reads."""
        session, _ = self.open(path)
        found = bytearray()
        while len(found) < limit:
            answer = self.ask(READ, session=session, offset=len(found), size=CHUNK)
            if not answer.ok:
                if answer.error == EOF:
                    break
                raise CheckFailed(f"reading {path} at {len(found)}: error {answer.error}")
            found += answer.data
        self.ask(TERMINATE, session=session)
        return bytes(found)

    def burst(self, path: str) -> bytes:
        """Return the content of a file, by burst reads; each burst begins at the first lost packet."""
        session, size = self.open(path)
        content = bytearray()
        for _ in range(MAX_BURSTS):
            if len(content) >= size:
                break
            self.vehicle.send(self.next_message(BURST, session=session, offset=len(content), size=CHUNK))
            mark = self.vehicle.mark()
            while (found := self.reply(mark)) is not None:
                answer, mark = found
                if answer.ok and answer.offset == len(content):
                    content += answer.data
                if answer.complete or not answer.ok:
                    break
        self.ask(TERMINATE, session=session)
        return bytes(content)

    def list(self, path: str) -> list[str]:
        """Return the entries of a directory: file `Fname\\tsize`, directory `Dname`, skipped entry `S`."""
        entries: list[str] = []
        while True:
            answer = self.ask(LIST, path.encode(), offset=len(entries))
            if not answer.ok:
                if answer.error == EOF or entries:
                    return entries
                raise CheckFailed(f"listing {path}: error {answer.error}")
            found = [part.decode("ascii", "replace") for part in answer.data.split(b"\0") if part]
            if not found:
                return entries
            entries += found


def _reply(payload: bytes) -> Reply:
    seq, session, opcode, size, request, complete, offset = HEADER.unpack_from(payload)
    return Reply(seq, session, opcode, request, bool(complete), offset, payload[12 : 12 + size])
