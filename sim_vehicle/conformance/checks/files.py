"""MAVLink FTP, and the component metadata that it transfers."""

import json
import lzma
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from sim_vehicle.conformance import ftp, parameters
from sim_vehicle.conformance.assertions import at_least, equal, holds, near, one_of
from sim_vehicle.conformance.ftp import FtpClient
from sim_vehicle.conformance.outcomes import Skip
from sim_vehicle.conformance.registry import check, checks, row
from sim_vehicle.conformance.vehicle import VehicleUnderTest

PARAMETER_METADATA = 1  # COMP_METADATA_TYPE_PARAMETER
SCHEME = "mftp://"
PACKED = "@PARAM/param.pck"
PACKED_MAGIC = (0x671B, 0x671C)
CANDIDATES = (PACKED, "/etc/extras/component_general.json.xz", "@SYS/uarts.txt")  # files of known autopilots
CLAIMS = ("FTP",)
_check = partial(check, "ftp", claims=CLAIMS)


@contextmanager
def _client(vehicle: VehicleUnderTest) -> Iterator[FtpClient]:
    client = FtpClient(vehicle)
    client.ask(ftp.RESET)
    try:
        yield client
    finally:
        with vehicle.extra_time():
            client.ask(ftp.RESET)


def _some_file(client: FtpClient) -> tuple[str, bytes]:
    """Return the path and content of a file on the vehicle; raise Skip if no file is found."""
    for path in CANDIDATES:
        answer = client.ask(ftp.OPEN_READ, path.encode())
        if answer.ok:
            client.ask(ftp.TERMINATE, session=answer.session)
            return path, client.read(path)
    for entry in client.list("/"):
        if entry.startswith("F") and not entry.endswith("\t0"):
            path = "/" + entry[1:].partition("\t")[0]
            return path, client.read(path)
    raise Skip("no readable file is known")


@_check()
def reset(vehicle: VehicleUnderTest) -> None:
    """ResetSessions is acknowledged."""
    holds(FtpClient(vehicle).ask(ftp.RESET).ok, "expected ACK")


@_check()
def sequence_number(vehicle: VehicleUnderTest) -> None:
    """An answer carries the request's number plus one, and the request's operation."""
    client = FtpClient(vehicle)
    client.seq = 700
    answer = client.ask(ftp.RESET)
    equal((answer.seq, answer.request), (702, ftp.RESET), "seq, request opcode")


@_check()
def addressed_to_us(vehicle: VehicleUnderTest) -> str:
    """The answer is addressed to the requesting station."""
    FtpClient(vehicle).ask(ftp.RESET)
    message = vehicle.last["FILE_TRANSFER_PROTOCOL"]
    equal(message.target_system, 255, "target_system")
    return str(message.target_system)


@_check()
def lists_a_directory(vehicle: VehicleUnderTest) -> str:
    """The root can be listed; each entry is a file (F), a directory (D) or a skipped entry (S)."""
    with _client(vehicle) as client:
        entries = client.list("/")
    bad = [entry for entry in entries if entry[0] not in "FDS"]
    holds(not bad, f"saw {bad[:3]}")
    return f"{len(entries)} entries"


def _refuses(vehicle: VehicleUnderTest, opcode: int, path: bytes, errors: tuple[int, ...]) -> str:
    """The request is refused, with one of the errors or, if there are none, with any."""
    with _client(vehicle) as client:
        answer = client.ask(opcode, path)
    return _refused(answer, *errors)


def _refused(answer: ftp.Reply, *errors: int) -> str:
    holds(not answer.ok, "expected NAK, saw ACK")
    return f"error {one_of(answer.error, errors or (answer.error,), 'error')}"


checks(
    "ftp", _refuses,
    row("missing_directory", "A missing directory is refused.", ftp.LIST, b"/no/such/directory", ()),
    row("missing_file", "A missing file is refused with FileNotFound, FailErrno or Fail.",
        ftp.OPEN_READ, b"/no/such/file", (ftp.NOT_FOUND, ftp.FAIL_ERRNO, ftp.FAIL)),
    row("unknown_operation",
        "An unknown operation is refused with UnknownCommand or, as by ArduPilot, with Fail.",
        99, b"", (ftp.UNKNOWN_COMMAND, ftp.FAIL)),
    row("session_that_is_not_open", "A read from an unopened session is refused.", ftp.READ, b"", ()),
    claims=CLAIMS,
)  # fmt: skip


@_check()
def reads_a_file(vehicle: VehicleUnderTest) -> str:
    """A file can be opened and read to its end."""
    with _client(vehicle) as client:
        path, data = _some_file(client)
    return f"{path}, {at_least(len(data), 1, 'bytes')} bytes"


@_check()
def same_twice(vehicle: VehicleUnderTest) -> str:
    """A second read of three parts of a file gives the same bytes; packed parameters may differ."""
    with _client(vehicle) as client:
        path, data = _some_file(client)
        session, _ = client.open(path)
        for offset in (0, len(data) // 3, max(0, len(data) - 20)):
            answer = client.ask(ftp.READ, session=session, offset=offset, size=20)
            # PX4 fills the message and ignores the requested size.
            holds(answer.ok and len(answer.data) > 0, f"expected bytes at {offset}, saw none")
            if path != PACKED:
                equal(answer.data, data[offset : offset + len(answer.data)], f"bytes at {offset}")
    return f"3 parts of {path}"


@_check()
def end_of_file(vehicle: VehicleUnderTest) -> None:
    """A read after the end is refused as end of file."""
    with _client(vehicle) as client:
        path, data = _some_file(client)
        session, _ = client.open(path)
        answer = client.ask(ftp.READ, session=session, offset=len(data) + 1000, size=20)
    _refused(answer, ftp.EOF)


@_check()
def burst_reads_the_same(vehicle: VehicleUnderTest) -> str:
    """Burst reads give the same bytes as single reads; of packed parameters only the length is compared."""
    with _client(vehicle) as client:
        path, data = _some_file(client)
        seen = client.burst(path)
    equal(len(seen), len(data), f"bytes of {path}")
    holds(seen == data or path == PACKED, f"{path} differs")
    return f"{len(seen)} bytes"


@_check()
def repeated_request(vehicle: VehicleUnderTest) -> None:
    """A repeated request to open a file, as after a lost answer, gets the same answer and session."""
    with _client(vehicle) as client:
        path, _ = _some_file(client)
        first = client.ask(ftp.OPEN_READ, path.encode())
        vehicle.send(client.message(ftp.OPEN_READ, path.encode()))
        again = client.reply()
    seen = (again[0].seq, again[0].opcode, again[0].session) if again is not None else None
    equal(seen, (first.seq, first.opcode, first.session), "answer")


@_check()
def checksum(vehicle: VehicleUnderTest) -> str:
    """CalcFileCRC32, where supported, returns the checksum of the file."""
    with _client(vehicle) as client:
        path, data = _some_file(client)
        if path == PACKED:
            raise Skip("the vehicle generates the packed parameters for each read")
        answer = client.ask(ftp.CALC_CRC, path.encode())
        if not answer.ok:
            raise Skip(f"CalcFileCRC32 is refused (error {answer.error})")
    seen = int.from_bytes(answer.data[:4], "little")
    # The protocol's checksum is zlib's CRC-32 without the two inversions; the check accepts both.
    holds(seen in (zlib.crc32(data), bare_crc32(data)), f"expected {bare_crc32(data):#x}, saw {seen:#x}")
    return f"{seen:#010x}"


def bare_crc32(data: bytes) -> int:
    """Return the CRC-32 with initial value 0 and without a final inversion."""
    return zlib.crc32(data, 0xFFFFFFFF) ^ 0xFFFFFFFF


@_check()
def ends_a_session(vehicle: VehicleUnderTest) -> str:
    """A read from a session after its TerminateSession is refused."""
    with _client(vehicle) as client:
        path, _ = _some_file(client)
        session, _ = client.open(path)
        holds(client.ask(ftp.TERMINATE, session=session).ok, "expected ACK for TerminateSession")
        answer = client.ask(ftp.READ, session=session, offset=0, size=10)
    return _refused(answer)


@_check(dialects=("ardupilot",))
def packed_parameters(vehicle: VehicleUnderTest) -> str:
    """@PARAM/param.pck begins with its magic, and its total agrees with the parameter list within 2."""
    with _client(vehicle) as client:
        data = client.burst(PACKED)
    magic, count, total = (int.from_bytes(data[i : i + 2], "little") for i in (0, 2, 4))
    one_of(magic, PACKED_MAGIC, "magic")
    near(total, len(parameters.listed(vehicle)), 2, "parameters")
    return f"{count} of {total} parameters, {len(data)} bytes"


def _metadata(vehicle: VehicleUnderTest) -> tuple[int, str]:
    """Return checksum and URI of the general metadata file."""
    found = vehicle.request("COMPONENT_METADATA")
    return found.file_crc, found.uri.decode("ascii", "replace")


def _path_in(uri: str) -> str:
    """Return the path in an FTP URI, without the component id; raise Skip for another URI."""
    if not uri.startswith(SCHEME):
        raise Skip(f"the file {uri} is not on the vehicle")
    path = uri.removeprefix(SCHEME)
    if path.startswith("["):
        path = path.partition("]")[2]
    return "/" + path.lstrip("/")


def _fetch(vehicle: VehicleUnderTest, uri: str) -> tuple[bytes, Any]:
    """Return the stored bytes of a file, and its JSON content."""
    data = FtpClient(vehicle).burst(_path_in(uri))
    return data, json.loads(lzma.decompress(data) if uri.endswith(".xz") else data)


@check("component")
def metadata_is_announced(vehicle: VehicleUnderTest) -> str:
    """COMPONENT_METADATA names a file."""
    _, uri = _metadata(vehicle)
    holds(bool(uri), "the URI is empty")
    return uri


@check("component", source="PX4 generate_crc.py: the checksum of the file before its compression")
def general_file_is_valid(vehicle: VehicleUnderTest) -> str:
    """The general file, before its compression, has the announced checksum, and lists metadata by type."""
    crc, uri = _metadata(vehicle)
    data, content = _fetch(vehicle, uri)
    equal(bare_crc32(lzma.decompress(data) if uri.endswith(".xz") else data), crc, "checksum")
    entries = content.get("metadataTypes")
    is_list = isinstance(entries, list) and len(entries) > 0
    holds(is_list, f"metadataTypes: expected a list with entries, saw {entries!r:.80}")
    return f"types {[entry['type'] for entry in entries]}"


@check("component")
def parameter_file_is_valid(vehicle: VehicleUnderTest) -> str:
    """The parameter file describes at least 90 % of the vehicle's parameters."""
    _, uri = _metadata(vehicle)
    _, general = _fetch(vehicle, uri)
    found = [e for e in general["metadataTypes"] if e["type"] == PARAMETER_METADATA]
    if not found:
        raise Skip("no parameter metadata is listed")
    data, content = _fetch(vehicle, found[0]["uri"])
    if "fileCrc" in found[0]:
        equal(bare_crc32(data), found[0]["fileCrc"], "checksum")
    names = {entry["name"] for entry in content["parameters"]}
    listed = set(parameters.listed(vehicle))
    at_least(len(names & listed), 0.9 * len(listed), "parameters of the vehicle in the file")
    return f"{len(names)} parameters"
