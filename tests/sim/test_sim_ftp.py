"""MAVLink FTP: the answers of each autopilot, and the content of files."""

import errno
import struct
import zlib
from typing import Any

import pytest
from files_client import FtpClient, MessageCodec
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

from sim_vehicle.files import ftp_rules as ftp
from sim_vehicle.files.filesystem import MAX_BYTES, FileError, FileSystem, GeneratedFile, constant
from sim_vehicle.files.ftp_rules import FtpError, FtpRules, Opcode

BOTH = pytest.mark.parametrize("rules", [ftp.ARDUPILOT, ftp.PX4], ids=["ardupilot", "px4"])
TEXT = bytes(range(256)) * 40
FILES = {"etc/motd": b"hello", "etc/big.bin": TEXT, "etc/empty": b""}


def files(**more: GeneratedFile) -> FileSystem:
    sources = {name: constant(content) for name, content in FILES.items()} | more
    return FileSystem(lambda: sources, writable=("disk",))


def client(rules: FtpRules, **pace: float) -> FtpClient:
    return FtpClient(files(), rules, **pace)


def opened(client: FtpClient, path: bytes, opcode: int = Opcode.OPEN_FILE_RO, session: int = 0) -> int:
    reply = client.one(opcode, path, session=session)
    assert reply.opcode == Opcode.ACK, reply
    return reply.session


# -- reading -------------------------------------------------------------------------------------------


def test_ardupilot_returns_the_requested_size_and_px4_a_full_message() -> None:
    for rules, length in ((ftp.ARDUPILOT, 10), (ftp.PX4, 239)):
        c = client(rules)
        session = opened(c, b"/etc/big.bin")
        assert len(c.one(Opcode.READ_FILE, session=session, size=10).data) == length


@BOTH
@settings(max_examples=examples(40))
@given(content=st.binary(max_size=2000), reads=st.lists(st.tuples(st.integers(0, 2100), st.integers(1, 239))))
def test_every_read_returns_its_part_of_the_file(
    rules: FtpRules, content: bytes, reads: list[tuple[int, int]]
) -> None:
    c = FtpClient(FileSystem(lambda: {"a": constant(content)}), rules)
    session = opened(c, b"a")
    for offset, size in reads:
        reply = c.one(Opcode.READ_FILE, session=session, offset=offset, size=size)
        length = size if rules.obeys_read_size else 239
        if offset < len(content):
            assert reply.data == content[offset : offset + length]
        else:
            assert reply.error == FtpError.END_OF_FILE


@BOTH
@settings(max_examples=examples(40))
@given(
    content=st.binary(max_size=3000),
    offset=st.integers(0, 3100),
    size=st.integers(0, 239),
    first=st.integers(0, 65535),
)
def test_a_burst_is_the_rest_of_the_file_in_order(
    rules: FtpRules, content: bytes, offset: int, size: int, first: int
) -> None:
    c = FtpClient(FileSystem(lambda: {"a": constant(content)}), rules)
    session = opened(c, b"a")
    replies = c.request(Opcode.BURST_READ_FILE, session=session, offset=offset, size=size, seq=first)
    replies += c.wait(10.0)
    *data, end = replies
    assert end.error == FtpError.END_OF_FILE
    assert end.offset == max(offset, len(content))
    assert b"".join(reply.data for reply in data) == content[offset:]
    assert [reply.seq for reply in replies] == [(first + 1 + i) & 0xFFFF for i in range(len(replies))]
    assert not any(reply.complete for reply in data)


@BOTH
def test_a_burst_is_paced_and_pauses_for_a_new_request(rules: FtpRules) -> None:
    big = bytes(400_000)
    c = FtpClient(FileSystem(lambda: {"a": constant(big)}), rules, bytes_s=20_000, max_bytes_at_once=5_000)
    session = opened(c, b"a")
    at_once = c.request(Opcode.BURST_READ_FILE, session=session, size=239)
    assert sum(len(reply.data) + 38 for reply in at_once) <= 5_000
    in_a_second = c.wait(1.0)
    assert 15_000 < sum(len(reply.data) for reply in in_a_second) < 21_000
    replies = at_once + in_a_second + c.wait(20.0)
    assert len(replies) == rules.burst_messages
    assert [reply.complete for reply in replies] == [0] * (len(replies) - 1) + [1]
    assert not c.server.busy


@BOTH
def test_terminating_ends_a_burst(rules: FtpRules) -> None:
    c = FtpClient(FileSystem(lambda: {"a": constant(TEXT)}), rules, bytes_s=1_000, max_bytes_at_once=300)
    session = opened(c, b"a")
    c.request(Opcode.BURST_READ_FILE, session=session, size=239)
    assert c.one(Opcode.TERMINATE_SESSION, session=session).opcode == Opcode.ACK
    assert c.wait(5.0) == []


def test_a_read_returns_the_content_at_the_open() -> None:
    content = bytearray(b"one")
    source = GeneratedFile(read=lambda _query: bytes(content), size=lambda: len(content))
    c = FtpClient(FileSystem(lambda: {"log": source}), ftp.ARDUPILOT)
    session = opened(c, b"log")
    content += b" two"
    assert c.one(Opcode.READ_FILE, session=session, size=239).data == b"one"


# -- requests that come again, sessions ----------------------------------------------------------------


@BOTH
def test_a_repeated_request_gets_the_same_answer_and_acts_once(rules: FtpRules) -> None:
    c = client(rules)
    first = c.request(Opcode.CREATE_DIRECTORY, b"/disk/a", seq=7)
    again = c.request(Opcode.CREATE_DIRECTORY, b"/disk/a", seq=7)
    assert first == again
    assert first[0].opcode == Opcode.ACK
    assert c.one(Opcode.CREATE_DIRECTORY, b"/disk/a", seq=8).error == FtpError.FILE_EXISTS


@BOTH
def test_the_sequence_number_wraps(rules: FtpRules) -> None:
    assert client(rules).one(Opcode.NONE, seq=65535).seq == 0


def test_px4_has_one_session_and_closes_an_idle_one() -> None:
    c = client(ftp.PX4)
    assert c.one(Opcode.READ_FILE, size=10).error == FtpError.INVALID_SESSION
    assert c.one(Opcode.TERMINATE_SESSION).error == FtpError.INVALID_SESSION
    assert opened(c, b"/etc/motd", session=3) == 0
    assert c.one(Opcode.OPEN_FILE_RO, b"/etc/big.bin").error == FtpError.NO_SESSIONS_AVAILABLE
    assert c.one(Opcode.READ_FILE, session=3, size=10).error == FtpError.INVALID_SESSION
    c.wait(10.5)
    assert opened(c, b"/etc/big.bin") == 0


def test_on_ardupilot_the_client_chooses_the_session_and_another_waits_three_seconds() -> None:
    c = client(ftp.ARDUPILOT)
    assert c.one(Opcode.READ_FILE, size=10).error == FtpError.FILE_NOT_FOUND
    assert c.one(Opcode.TERMINATE_SESSION, session=9).opcode == Opcode.ACK
    assert opened(c, b"/etc/motd", session=3) == 3
    other = MessageCodec(sysid=254)
    assert c.one(Opcode.OPEN_FILE_RO, b"/etc/motd", session=3).error == FtpError.FAIL
    assert c.one(Opcode.OPEN_FILE_RO, b"/etc/motd", session=4, wire=other).error == FtpError.INVALID_SESSION
    assert c.one(Opcode.RESET_SESSIONS, session=4, wire=other).opcode == Opcode.ACK
    assert c.one(Opcode.READ_FILE, session=3, size=10).data == b"hello"
    c.wait(3.1)
    assert opened(c, b"/etc/motd", session=4) == 4


@BOTH
def test_errors_have_the_autopilots_codes(rules: FtpRules) -> None:
    c = client(rules)
    assert c.one(Opcode.OPEN_FILE_RO, b"/nowhere").error == FtpError.FILE_NOT_FOUND
    assert c.one(Opcode.LIST_DIRECTORY, b"/nowhere").error == FtpError.FILE_NOT_FOUND
    assert c.one(Opcode.OPEN_FILE_RO, b"").error == FtpError.INVALID_DATA_SIZE
    assert c.one(Opcode.OPEN_FILE_RO, b"x" * 200, size=250).error == FtpError.INVALID_DATA_SIZE
    assert c.one(99).error == (FtpError.FAIL if rules is ftp.ARDUPILOT else FtpError.UNKNOWN_COMMAND)
    read_only = c.one(Opcode.CREATE_FILE, b"/etc/new")
    assert list(read_only.data) == [FtpError.FAIL_ERRNO, errno.EROFS]
    assert list(c.one(Opcode.REMOVE_FILE, b"/etc/motd").data) == [FtpError.FAIL_ERRNO, errno.EROFS]
    assert c.request(Opcode.ACK) == []


@BOTH
@settings(max_examples=examples(60))
@given(
    payloads=st.lists(st.binary(min_size=251, max_size=251), max_size=12),
    opcodes=st.lists(st.integers(0, 17)),
)
def test_the_server_survives_any_payload(rules: FtpRules, payloads: list[bytes], opcodes: list[int]) -> None:
    c = client(rules)
    for payload in payloads:
        c.send(payload)
    for opcode in opcodes:
        c.request(opcode, b"/disk/x\0/disk/y", offset=1_000)
        c.request(opcode, b"/etc/motd", offset=2**32 - 1, size=239)
    c.wait(15.0)
    c.request(Opcode.RESET_SESSIONS)
    c.wait(1.0)
    assert opened(c, b"/etc/motd") == 0


# -- directories and writing ---------------------------------------------------------------------------


def listed(c: FtpClient, path: bytes) -> list[bytes]:
    names: list[bytes] = []
    while True:
        reply = c.one(Opcode.LIST_DIRECTORY, path, offset=len(names))
        if reply.opcode == Opcode.NAK:
            assert reply.error == FtpError.END_OF_FILE
            return names
        names += reply.data.removesuffix(b"\0").split(b"\0")


def test_a_long_directory_is_listed_in_several_answers() -> None:
    many = {f"logs/{i:08d}.BIN": constant(bytes(i)) for i in range(60)}
    c = FtpClient(FileSystem(lambda: many), ftp.ARDUPILOT)
    assert listed(c, b"/logs") == [b"F%08d.BIN\t%d" % (i, i) for i in range(60)]
    assert listed(c, b"/") == [b"Dlogs"]
    assert listed(FtpClient(FileSystem(lambda: many), ftp.PX4), b"/")[2:] == [b"Dlogs"]


@BOTH
def test_a_file_is_written_read_checksummed_renamed_and_removed(rules: FtpRules) -> None:
    c = client(rules)
    assert c.one(Opcode.CREATE_DIRECTORY, b"/disk/a").opcode == Opcode.ACK
    session = opened(c, b"/disk/a/f", Opcode.CREATE_FILE)
    for offset in (200, 0, 100):
        assert (
            c.one(Opcode.WRITE_FILE, TEXT[offset : offset + 100], session=session, offset=offset).offset
            == offset
        )
    c.one(Opcode.TERMINATE_SESSION, session=session)
    crc = c.one(Opcode.CALC_FILE_CRC32, b"/disk/a/f").data
    assert crc == struct.pack("<I", zlib.crc32(TEXT[:300], 0xFFFFFFFF) ^ 0xFFFFFFFF)
    assert c.one(Opcode.RENAME, b"/disk/a/f\0/disk/g").opcode == Opcode.ACK
    assert [line for line in listed(c, b"/disk") if line != b"S"] == [b"Da", b"Fg\t300"]
    session = opened(c, b"disk/g")
    assert c.one(Opcode.READ_FILE, session=session, offset=100, size=239).data == TEXT[100:300]
    c.one(Opcode.TERMINATE_SESSION, session=session)
    assert c.one(Opcode.REMOVE_FILE, b"/disk/g").opcode == Opcode.ACK
    assert c.one(Opcode.REMOVE_DIRECTORY, b"/disk/a").opcode == Opcode.ACK
    assert [line for line in listed(c, b"/disk") if line != b"S"] == []


@BOTH
def test_a_directory_is_not_renamed_onto_a_file(rules: FtpRules) -> None:
    c = client(rules)
    assert c.one(Opcode.CREATE_DIRECTORY, b"/disk/a").opcode == Opcode.ACK
    c.one(Opcode.TERMINATE_SESSION, session=opened(c, b"/disk/f", Opcode.CREATE_FILE))
    assert c.one(Opcode.RENAME, b"/disk/a\0/disk/f").error == FtpError.FILE_EXISTS
    assert [line for line in listed(c, b"/disk") if line != b"S"] == [b"Da", b"Ff\t0"]


def test_the_disk_space_is_limited() -> None:
    c = client(ftp.PX4)
    session = opened(c, b"/disk/f", Opcode.CREATE_FILE)
    full = c.one(Opcode.WRITE_FILE, b"x", session=session, offset=2**31)
    assert list(full.data) == [FtpError.FAIL_ERRNO, errno.ENOSPC]
    assert c.one(Opcode.TRUNCATE_FILE, b"/disk/f", offset=MAX_BYTES).opcode == Opcode.ACK
    assert c.one(Opcode.TRUNCATE_FILE, b"/disk/f", offset=MAX_BYTES + 1).data[1] == errno.ENOSPC


def test_only_px4_truncates() -> None:
    assert client(ftp.ARDUPILOT).one(Opcode.TRUNCATE_FILE, b"/disk/f").error == FtpError.FAIL


PATHS = st.sampled_from(
    ["disk/a", "disk/a/b", "disk/a/b/c", "disk/d", "disk", "etc/motd", "etc", "", "disk/../x"]
)
STEPS = st.tuples(st.sampled_from(["make", "rmdir", "write", "remove", "rename", "truncate"]), PATHS, PATHS)


@settings(max_examples=examples(150))
@given(steps=st.lists(STEPS, max_size=14))
def test_every_listed_entry_can_be_opened_after_any_operations(steps: list[Any]) -> None:
    tree = files()
    for kind, path, other in steps:
        try:
            if kind == "make":
                tree.make_directory(path)
            elif kind == "rmdir":
                tree.remove_directory(path)
            elif kind == "write":
                tree.write(tree.open_to_write(path, truncate=True), 3, b"abc")
            elif kind == "remove":
                tree.remove(path)
            elif kind == "rename":
                tree.rename(path, other)
            else:
                tree.truncate(path, 2)
        except FileError:
            pass
    waiting = [""]
    while waiting:
        path = waiting.pop()
        for entry in tree.entries(path):
            full = f"{path}/{entry.name}"
            if entry.size is None:
                waiting.append(full)
            else:
                assert len(tree.read(full)) == entry.size
    assert tree.read("etc/motd") == b"hello"
