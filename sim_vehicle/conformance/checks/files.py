"""The file transfer protocol."""

import zlib
from collections.abc import Iterator
from contextlib import contextmanager

from sim_vehicle.conformance import ftp, parameters
from sim_vehicle.conformance.ftp import Ftp
from sim_vehicle.conformance.peer import Peer
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.words import CheckFailed, Skip, equal, holds

CLAIMS = ("FTP",)
PACKED = "@PARAM/param.pck"
PACKED_MAGIC = (0x671B, 0x671C)
CANDIDATES = (PACKED, "/etc/extras/component_general.json.xz", "@SYS/uarts.txt")


@contextmanager
def _client(peer: Peer) -> Iterator[Ftp]:
    client = Ftp(peer)
    client.reset()
    try:
        yield client
    finally:
        with peer.tidying():
            client.reset()


def _some_file(client: Ftp) -> tuple[str, bytes]:
    """A file the vehicle has, with its bytes."""
    for path in CANDIDATES:
        answer = client.ask(ftp.OPEN_READ, path.encode())
        if answer.ok:
            client.ask(ftp.TERMINATE, session=answer.session)
            return path, client.read(path)
    for entry in client.list("/"):
        if entry.startswith("F") and not entry.endswith("\t0"):
            path = "/" + entry[1:].partition("\t")[0]
            return path, client.read(path)
    raise Skip("no file is known that could be read")


@check("ftp.reset", claims=CLAIMS)
def reset(peer: Peer) -> str:
    """ResetSessions is acknowledged."""
    holds(Ftp(peer).ask(ftp.RESET).ok, "expected ACK")
    return "ACK"


@check("ftp.sequence_number", claims=CLAIMS)
def sequence_number(peer: Peer) -> str:
    """An answer carries the request's number plus one, and the request's operation."""
    client = Ftp(peer)
    client.seq = 700
    answer = client.ask(ftp.RESET)
    equal((answer.seq, answer.request), (702, ftp.RESET), "seq, request opcode")
    return "plus 1"


@check("ftp.addressed_to_us", claims=CLAIMS)
def addressed(peer: Peer) -> str:
    """The answer is addressed to the station that asked."""
    Ftp(peer).ask(ftp.RESET)
    message = peer.last["FILE_TRANSFER_PROTOCOL"].message
    equal(message.target_system, 255, "target_system")
    return str(message.target_system)


@check("ftp.lists_a_directory", claims=CLAIMS)
def lists(peer: Peer) -> str:
    """The root can be listed, each entry a file, a directory or a blank."""
    with _client(peer) as client:
        entries = client.list("/")
    bad = [entry for entry in entries if entry[0] not in "FDS"]
    holds(not bad, f"saw {bad[:3]}")
    return f"{len(entries)} entries"


@check("ftp.missing_directory", claims=CLAIMS)
def missing_directory(peer: Peer) -> str:
    """A directory that is not there is refused."""
    with _client(peer) as client:
        answer = client.ask(ftp.LIST, b"/no/such/directory")
    holds(not answer.ok, "expected NAK, saw ACK")
    return f"error {answer.error}"


@check("ftp.missing_file", claims=CLAIMS)
def missing_file(peer: Peer) -> str:
    """A file that is not there is refused as not found."""
    with _client(peer) as client:
        answer = client.ask(ftp.OPEN_READ, b"/no/such/file")
    holds(not answer.ok, "expected NAK, saw ACK")
    holds(answer.error in (ftp.NOT_FOUND, ftp.FAIL_ERRNO, ftp.FAIL), f"saw error {answer.error}")
    return f"error {answer.error}"


@check("ftp.unknown_operation", claims=CLAIMS)
def unknown_operation(peer: Peer) -> str:
    """An operation nobody has is refused: as unknown, or by ArduPilot without a reason."""
    with _client(peer) as client:
        answer = client.ask(99)
    holds(not answer.ok, "expected NAK, saw ACK")
    holds(answer.error in (ftp.UNKNOWN_COMMAND, ftp.FAIL), f"saw error {answer.error}")
    return f"error {answer.error}"


@check("ftp.session_that_is_not_open", claims=CLAIMS)
def no_session(peer: Peer) -> str:
    """Reading from a session nobody opened is refused."""
    with _client(peer) as client:
        answer = client.ask(ftp.READ, session=0, offset=0, size=10)
    holds(not answer.ok, "expected NAK, saw ACK")
    return f"error {answer.error}"


@check("ftp.reads_a_file", claims=CLAIMS, limit_s=200)
def reads_a_file(peer: Peer) -> str:
    """A file is opened and read to its end."""
    with _client(peer) as client:
        path, data = _some_file(client)
    holds(len(data) > 0, f"{path} is empty")
    return f"{path}, {len(data)} bytes"


@check("ftp.same_twice", claims=CLAIMS, limit_s=200)
def read_again(peer: Peer) -> str:
    """Any part of a file reads the same again."""
    with _client(peer) as client:
        path, data = _some_file(client)
        session, _ = client.open(path)
        for offset in (0, len(data) // 3, max(0, len(data) - 20)):
            answer = client.ask(ftp.READ, session=session, offset=offset, size=20)
            # PX4 fills the message whatever size was asked for.
            holds(answer.ok and len(answer.data) > 0, f"nothing at {offset}")
            if path != PACKED:
                equal(answer.data, data[offset : offset + len(answer.data)], f"bytes at {offset}")
    return f"3 parts of {path}"


@check("ftp.end_of_file", claims=CLAIMS, limit_s=200)
def end_of_file(peer: Peer) -> str:
    """Reading behind the end is refused as end of file."""
    with _client(peer) as client:
        path, data = _some_file(client)
        session, _ = client.open(path)
        answer = client.ask(ftp.READ, session=session, offset=len(data) + 1000, size=20)
    holds(not answer.ok, f"expected NAK, saw {len(answer.data)} bytes")
    equal(answer.error, ftp.EOF, "error")
    return "EndOfFile"


@check("ftp.burst_reads_the_same", claims=CLAIMS, limit_s=200)
def burst(peer: Peer) -> str:
    """Burst reads give the bytes single reads give."""
    with _client(peer) as client:
        path, data = _some_file(client)
        seen = client.burst(path)
    equal(len(seen), len(data), f"bytes of {path}")
    holds(seen == data or path == PACKED, f"{path} differs")
    return f"{len(seen)} bytes"


@check("ftp.repeated_request", claims=CLAIMS)
def repeated(peer: Peer) -> str:
    """The same request again, as after a lost answer, gets the same answer."""
    with _client(peer) as client:
        path, _ = _some_file(client)
        first = client.ask(ftp.OPEN_READ, path.encode())
        mark = peer.mark()
        client.resend(ftp.OPEN_READ, path.encode())
        again = client.reply(mark)
    holds(again is not None, "expected an answer, saw none")
    assert again is not None
    equal(
        (again[0].seq, again[0].opcode, again[0].session), (first.seq, first.opcode, first.session), "answer"
    )
    return "the same"


@check("ftp.checksum", claims=CLAIMS, limit_s=200)
def checksum(peer: Peer) -> str:
    """CalcFileCRC32, where it is served, is the checksum of the bytes."""
    with _client(peer) as client:
        path, data = _some_file(client)
        if path == PACKED:
            raise Skip("the packed parameters are made anew each time")
        answer = client.ask(ftp.CALC_CRC, path.encode())
        if not answer.ok:
            raise Skip(f"CalcFileCRC32 is refused (error {answer.error})")
    seen = int.from_bytes(answer.data[:4], "little")
    # The protocol's checksum is zlib's without its two inversions.
    holds(seen in (zlib.crc32(data), bare_crc32(data)), f"saw {seen:#x}, {bare_crc32(data):#x} expected")
    return f"{seen:#010x}"


def bare_crc32(data: bytes) -> int:
    """CRC32 that begins with 0 and is not inverted at the end."""
    return zlib.crc32(data, 0xFFFFFFFF) ^ 0xFFFFFFFF


@check("ftp.ends_a_session", claims=CLAIMS)
def ends_a_session(peer: Peer) -> str:
    """After TerminateSession the session cannot be read."""
    with _client(peer) as client:
        path, _ = _some_file(client)
        session, _ = client.open(path)
        holds(client.ask(ftp.TERMINATE, session=session).ok, "expected ACK for TerminateSession")
        answer = client.ask(ftp.READ, session=session, offset=0, size=10)
    holds(not answer.ok, "expected NAK, saw ACK")
    return f"error {answer.error}"


@check("ftp.packed_parameters", claims=CLAIMS, dialects=("ardupilot",), limit_s=200)
def packed_parameters(peer: Peer) -> str:
    """@PARAM/param.pck begins with its magic and counts as many parameters as the list."""
    with _client(peer) as client:
        data = client.burst(PACKED)
    magic, count, total = (int.from_bytes(data[i : i + 2], "little") for i in (0, 2, 4))
    holds(magic in PACKED_MAGIC, f"expected a magic of {PACKED_MAGIC[0]:#x}, saw {magic:#x}")
    listed = len(parameters.listed(peer))
    if not abs(total - listed) <= 2:
        raise CheckFailed(f"expected {listed} parameters, saw {total}")
    return f"{count} of {total} parameters, {len(data)} bytes"
