"""Attacks by file and log transfers: bad content, and logs after their flight."""

import random
import struct
from collections.abc import Iterator
from typing import Any

from fuzz_bench import Bench
from fuzz_missions import in_order, spoil
from fuzz_values import COMPONENTS, DEAFENING, TARGETS, number
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.files.ftp import HEADER
from sim_vehicle.files.packed_files import pack_mission
from sim_vehicle.personalities import personality_of

GENERATED = ("@PARAM/param.pck?start=-1&count=x", "@MISSION/mission.dat", "@MISSION/fence.dat")


def _file_message(
    source: random.Random, system: int, opcode: int, offset: int, data: bytes, size: int | None = None
) -> Any:
    head = HEADER.pack(
        source.randint(0, 65_535), 0, opcode, min(len(data) if size is None else size, 255), 0, 0, offset
    )
    return mavlink.MAVLink_file_transfer_protocol_message(0, system, 1, (head + data).ljust(251, b"\0")[:251])


def _packed(bench: Bench, source: random.Random) -> tuple[str, bytes]:
    """Return a packed file of parameters, a mission, a fence or rally points, with a bad part."""
    if source.random() < 0.4:
        names = source.sample(
            [
                name
                for name in personality_of(bench.name, bench.kind).parameters.defaults
                if name not in DEAFENING
            ],
            8,
        )
        body = b"".join(
            bytes([4, (len(name) - 1) << 4]) + name.encode() + struct.pack("<f", number("float", source))
            for name in names
        )
        return "@PARAM/param.pck", struct.pack("<HHH", 0x671B, len(names), 6 + len(body)) + body
    kind = source.randrange(3)
    items = in_order(bench, source, kind, source.randint(1, 10))
    spoil(source, items)
    made = [
        mavlink.MAVLink_mission_item_int_message(0, 0, seq, *fields, kind) for seq, fields in enumerate(items)
    ]
    return f"@MISSION/{('mission', 'fence', 'rally')[kind]}.dat", pack_mission(kind, made)


def written_files(bench: Bench, source: random.Random) -> Iterator[Any]:
    """Open, fill, close, read, rename and remove files."""
    writable = (
        "@PARAM/param.pck",
        "@MISSION/mission.dat",
        "@MISSION/fence.dat",
        "APM/a",
        "/fs/microsd/a",
        "/fs/microsd/b",
    )
    for _ in range(20):
        path, content = _packed(bench, source)
        if source.random() < 0.4:
            path, content = source.choice(writable), source.randbytes(source.randint(0, 700))
        content = content[: source.choice((len(content), len(content), 20))]
        system = source.choice((1, 2))
        yield _file_message(source, system, source.choice((6, 6, 6, 11)), 0, path.encode())
        for at in range(0, len(content), 200):
            place = at if source.random() < 0.9 else source.choice((0, 1, 2**20 - 1, 2**31))
            yield _file_message(source, system, 7, place, content[at : at + 200])
        yield _file_message(source, system, source.choice((1, 1, 2)), 0, b"")
        yield _file_message(source, system, 4, 0, source.choice((path, *GENERATED, *writable)).encode())
        for _ in range(3):
            offset = source.choice((0, 239, 2**32 - 1))
            yield _file_message(
                source, system, source.choice((5, 15)), offset, b"", source.choice((0, 1, 80, 239))
            )
        yield _file_message(source, system, 1, 0, b"")
        one, other = path.encode(), source.choice(writable).encode()
        for opcode, data in (
            (3, b"/"),
            (13, one + b"\0" + other),
            (9, other + b"/d"),
            (12, other),
            (14, other),
            (8, one),
            (10, other),
        ):
            yield _file_message(source, system, opcode, source.choice((0, 1, 2**31)), data)


def logs(_bench: Bench, source: random.Random) -> Iterator[Any]:
    """Request missing logs, parts after the end, all of 4 GB, and erasures in between."""
    edges16, edges32 = (0, 1, 2, 3, 65_534, 65_535), (0, 1, 89, 90, 2**20, 2**31, 2**32 - 1)
    for _ in range(80):
        target, component = source.choice(TARGETS), source.choice(COMPONENTS)
        choice = source.random()
        if choice < 0.4:
            yield mavlink.MAVLink_log_request_list_message(
                target, component, source.choice(edges16), source.choice(edges16)
            )
        elif choice < 0.85:
            yield mavlink.MAVLink_log_request_data_message(
                target, component, source.choice(edges16), source.choice(edges32), source.choice(edges32)
            )
        elif choice < 0.95:
            yield mavlink.MAVLink_log_request_end_message(target, component)
        else:
            yield mavlink.MAVLink_log_erase_message(target, component)


def flown_logs(bench: Bench, source: random.Random) -> Iterator[Any]:
    """Request the logs of a flight that ends first."""
    for sysid in (1, 2):
        bench.command(400, 1, 21_196, sysid=sysid)
    bench.wait(3.0)
    for sysid in (1, 2):
        bench.command(400, 0, 21_196, sysid=sysid)
    yield mavlink.MAVLink_log_request_list_message(0, 1, 0, 65_535)
    yield mavlink.MAVLink_log_request_data_message(0, 1, source.choice((0, 1)), 0, 2**32 - 1)
    yield from logs(bench, source)
