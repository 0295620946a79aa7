"""Attacks of a hostile station: sequences of messages, each from one source of randomness."""

import math
import random
from collections.abc import Callable, Iterator
from typing import Any

from fuzz_bench import Bench
from fuzz_values import COMPONENTS, TARGETS, number, place, random_message
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import ALT_M, LAT_DEG, LON_DEG

from sim_vehicle.definitions import COMMAND_CANCEL, DefinedMessage
from sim_vehicle.personalities import personality_of
from sim_vehicle.vehicle.mission import Item

Attack = Callable[[Bench, random.Random], Iterator[Any]]


COMMANDS = sorted(mavlink.enums["MAV_CMD"])


def any_message(_bench: Bench, source: random.Random) -> Iterator[Any]:
    """Yield every message of the dialect once, in random order."""
    kinds = [kind for kind in mavlink.mavlink_map.values() if kind.msgname != "SETUP_SIGNING"]
    for kind in source.sample(kinds, len(kinds)):
        yield random_message(kind, source)


def cancellation(system: int, component: int, command: int) -> DefinedMessage:
    """Return COMMAND_CANCEL."""
    return DefinedMessage(COMMAND_CANCEL, target_system=system, target_component=component, command=command)


def commands(_bench: Bench, source: random.Random) -> Iterator[Any]:
    """Yield every command, and unknown ones, as LONG and as INT."""
    for command in source.sample(COMMANDS, len(COMMANDS)) + [source.randint(0, 65_535) for _ in range(20)]:
        target, component = source.choice(TARGETS), source.choice(COMPONENTS)
        hostile = [number("float", source) for _ in range(7)]
        if source.random() < 0.5:
            yield mavlink.MAVLink_command_long_message(
                target, component, command, source.randint(0, 255), *hostile
            )
        else:
            frame = source.choice((0, 1, 2, 3, 6, 11, 255))
            yield mavlink.MAVLink_command_int_message(
                target, component, frame, command, 0, 0, *hostile[:4], *place(source), hostile[6]
            )
        if source.random() < 0.1:
            yield cancellation(target, component, command)


def likely_commands(bench: Bench, source: random.Random) -> Iterator[Any]:
    """Yield supported commands with nearly valid parameters."""
    obeyed = sorted(personality_of(bench.name, bench.kind).commands.handlers)
    for command in source.choices(obeyed, k=120):
        nearly = [
            source.choice((0.0, 0.0, 1.0, 1.0, 2.0, 3.0, math.nan, number("float", source))) for _ in range(7)
        ]
        sysid = source.choice((1, 2))
        if command in (246, 185):  # left out: a vehicle that is off, or falls, misses the other attacks
            continue
        if source.random() < 0.5:
            at_deg = source.choice(((LAT_DEG, LON_DEG), (math.nan, math.nan), (0.0, 0.0), (1e9, LON_DEG)))
            yield mavlink.MAVLink_command_long_message(
                sysid, 1, command, 0, *nearly[:4], *at_deg, source.choice((ALT_M + 20, 20.0, nearly[6]))
            )
        else:
            frame, at = source.choice((0, 3, 6)), place(source)
            up_m = source.choice((20.0, nearly[6]))
            yield mavlink.MAVLink_command_int_message(sysid, 1, frame, command, 0, 0, *nearly[:4], *at, up_m)
        if source.random() < 0.1:
            yield cancellation(sysid, 1, command)


def setpoints(bench: Bench, source: random.Random) -> Iterator[Any]:
    """Yield positions, velocities, accelerations, attitudes and rates, in the mode that follows them."""
    guided = {"ardupilotcopter": (4, 0), "ardupilotplane": (15, 0)}.get(bench.name + bench.kind, (6, 0))
    for i in range(120):
        if i % 20 == 2:
            for sysid in (1, 2):
                yield mavlink.MAVLink_command_long_message(sysid, 1, 176, 0, 1, *guided, 0, 0, 0, 0)
        target = source.choice((1, 1, 2, 0))
        mask = source.choice((0, 0x0FF8, 0x0DF8, 0x0FC7, 0x0E3F, 0x05C7, 0x09C7, source.randint(0, 65_535)))
        wild = [source.choice((0.0, 1.0, 5.0, number("float", source))) for _ in range(12)]
        choice = source.random()
        if choice < 0.35:
            frame = source.choice((1, 7, 8, 9, 12, 255))
            yield mavlink.MAVLink_set_position_target_local_ned_message(0, target, 1, frame, mask, *wild[:11])
        elif choice < 0.65:
            frame = source.choice((0, 3, 5, 6, 10, 11, 255))
            yield mavlink.MAVLink_set_position_target_global_int_message(
                0, target, 1, frame, mask, *place(source), *wild[:9]
            )
        else:
            yield mavlink.MAVLink_set_attitude_target_message(
                0, target, 1, source.choice((0, 7, 128, source.randint(0, 255))), wild[:4], *wild[4:8]
            )


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
        if kind == 1:
            angle = 2 * math.pi * seq / count
            x = round(LAT_DEG * 1e7 + 30_000 * math.cos(angle))
            y = round(LON_DEG * 1e7 + 30_000 * math.sin(angle))
        frame, command = {1: (3, fenced), 2: (3, 5100)}.get(
            kind, (3, 22) if seq < 2 else source.choice(flown)
        )
        param1 = float(vertices) if kind == 1 else source.choice((0.0, 0.0, 1.0, 3.0))
        others = [source.choice((0.0, 0.0, 1.0, 3.0)) for _ in range(3)]
        items.append([frame, command, 0, 1, param1, *others, x, y, 12.0])
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


ATTACKS: dict[str, Attack] = {
    attack.__name__: attack for attack in (any_message, flown_missions, commands, likely_commands, setpoints)
}


# Most frames that a vehicle sends in answer to one frame: every parameter, or a long unpaced transfer.
MOST_FRAMES = 450
BY_THE_RULES = (flown_missions, likely_commands)


def launch(bench: Bench, attack: Attack, source: random.Random) -> None:
    """Launch an attack from two stations, in both versions of MAVLink; limit the answers to a frame."""
    strays = 0.02 if attack in BY_THE_RULES else 0.33
    for message in attack(bench, source):
        station = int(source.random() < strays)
        old = message.get_msgId() < 256 and source.random() < 0.1
        bench.send(message, station, mavlink1=old)
        if source.random() < 0.2:
            bench.wait(source.choice((0.1, 0.1, 0.5, 1.5)))
    assert bench.most_frames <= MOST_FRAMES
