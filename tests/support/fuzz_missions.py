"""Attacks by the mission protocol: valid lists with bad content."""

import math
import random
from collections.abc import Iterator
from typing import Any

from fuzz_bench import Bench
from fuzz_values import number
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import LAT_DEG, LON_DEG

from sim_vehicle.personalities import personality_of
from sim_vehicle.vehicle.mission import Item

FLOWN = (
    16, 16, 16, 17, 18, 19, 20, 21, 22, 31, 82, 93, 112, 113, 114, 115, 177, 178, 179, 189, 5001, 5003, 5004,
    5100, 0, 65_535,
)  # fmt: skip


def _flown(bench: Bench) -> list[tuple[int, int]]:
    """Return the frames and commands that this autopilot accepts as mission items."""
    store = personality_of(bench.name, bench.kind).mission.store_item
    pairs = [(frame, command) for command in FLOWN for frame in (3, 2)]
    taken = [
        pair for pair in pairs if isinstance(store(Item(pair[1], frame=pair[0], x=1, y=1, z=12.0)), Item)
    ]
    return [pair for pair in taken if pair[0] == 3 or (3, pair[1]) not in taken]


def in_order(bench: Bench, source: random.Random, kind: int, count: int) -> list[list[Any]]:
    """Return fields of valid items: frame, command, flags, parameters, position."""
    items, flown = [], _flown(bench)
    fenced, vertices = source.choice(((5001, count), (5002, count), (5003, 30), (5004, 5)))
    for seq in range(count):
        x, y = (round((at + source.uniform(-1e-4, 1e-4)) * 1e7) for at in (LAT_DEG, LON_DEG + 1e-3))
        wide = 30_000 if kind == 1 else 0
        if wide:
            angle = 2 * math.pi * seq / count
            x, y = (
                round(LAT_DEG * 1e7 + wide * math.cos(angle)),
                round(LON_DEG * 1e7 + wide * math.sin(angle)),
            )
        frame, command = {1: (3, fenced), 2: (3, 5100)}.get(
            kind, (3, 22) if seq < 2 else source.choice(flown)
        )
        param1 = float(vertices) if kind == 1 else source.choice((0.0, 0.0, 1.0, 3.0))
        items.append(
            [
                frame,
                command,
                0,
                1,
                param1,
                *(source.choice((0.0, 0.0, 1.0, 3.0)) for _ in range(3)),
                x,
                y,
                12.0,
            ]
        )
    return items


def spoil(source: random.Random, items: list[list[Any]]) -> None:
    """Replace some fields by bad values."""
    for _ in range(source.choice((0, 1, 1, 2, 4))):
        fields = source.choice(items)
        place = source.choice((0, 2, 3, 4, 4, 5, 5, 6, 7, 8, 9, 10))
        types = ("uint8_t", "", "uint8_t", "uint8_t", *["float"] * 4, "int32_t", "int32_t", "float")
        fields[place] = source.choice((0, 2, 3, 5, 6, 10, 11)) if place == 0 else number(types[place], source)


def flown_missions(bench: Bench, source: random.Random) -> Iterator[Any]:
    """Upload valid lists with bad content and fly them."""
    mode = {"ardupilotcopter": (3, 0), "ardupilotplane": (10, 0)}.get(bench.name + bench.kind, (4, 4))
    for _ in range(5):
        sysid, kind = source.choice((1, 1, 2)), source.choice((0, 0, 0, 0, 1, 2))
        items = in_order(bench, source, kind, source.randint(1, 10))
        spoil(source, items)
        yield mavlink.MAVLink_mission_count_message(sysid, 1, len(items), kind)
        for seq, fields in enumerate(items):
            yield mavlink.MAVLink_mission_item_int_message(sysid, 1, seq, *fields, kind)
        bench.wait(1.0)
        start = source.choice(((176, 1, *mode), (176, 1, 4, 3)))  # a copter arms in GUIDED
        for command, *params in start, (400, 1), (300, 0), (224, source.choice((0, 1, 5))), (400, 1):
            padded = [*params, *[0.0] * (7 - len(params))]
            yield mavlink.MAVLink_command_long_message(sysid, 1, command, 0, *padded)
        bench.wait(source.choice((5.0, 25.0)))
        yield mavlink.MAVLink_mission_set_current_message(sysid, 1, source.randint(0, len(items)))
        yield mavlink.MAVLink_mission_request_list_message(sysid, 1, kind)
        for seq in range(len(items)):
            yield mavlink.MAVLink_mission_request_int_message(sysid, 1, seq, kind)
        yield mavlink.MAVLink_mission_ack_message(sysid, 1, 0, kind)
