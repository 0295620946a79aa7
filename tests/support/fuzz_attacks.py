"""Attacks of a hostile station: sequences of messages, each from one source of randomness."""

import math
import random
import struct
from collections.abc import Callable, Iterator
from typing import Any

from fuzz_bench import Bench
from fuzz_files import flown_logs, written_files
from fuzz_missions import flown_missions
from fuzz_values import COMPONENTS, DEAFENING, TARGETS, number, place, random_message
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import ALT_M, LAT_DEG, LON_DEG

from sim_vehicle.personalities import personality_of
from sim_vehicle.vehicle.commands import HANDLERS
from sim_vehicle.wire.parser import CommandCancel

Attack = Callable[[Bench, random.Random], Iterator[Any]]


COMMANDS = sorted(mavlink.enums["MAV_CMD"])


def any_message(_bench: Bench, source: random.Random) -> Iterator[Any]:
    """Yield every message of the dialect once, in random order."""
    kinds = [kind for kind in mavlink.mavlink_map.values() if kind.msgname != "SETUP_SIGNING"]
    for kind in source.sample(kinds, len(kinds)):
        yield random_message(kind, source)


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
            yield CommandCancel(target, component, command)


def likely_commands(bench: Bench, source: random.Random) -> Iterator[Any]:
    """Yield supported commands with nearly valid parameters."""
    obeyed = sorted({*HANDLERS, *personality_of(bench.name, bench.kind).commands.handlers})
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
            yield mavlink.MAVLink_command_int_message(
                sysid,
                1,
                source.choice((0, 3, 6)),
                command,
                0,
                0,
                *nearly[:4],
                *place(source),
                source.choice((20.0, nearly[6])),
            )
        if source.random() < 0.1:
            yield CommandCancel(sysid, 1, command)


def _wire_value(source: random.Random, *, integer: bool) -> float:
    if not integer:
        return float(number("float", source))
    bits = struct.pack("<i", int(number("int32_t", source)))
    return float(struct.unpack("<f", bits)[0])


def parameters(bench: Bench, source: random.Random) -> Iterator[Any]:
    """Set every parameter to extreme values, of its type and of another."""
    personality = personality_of(bench.name, bench.kind)
    names = [name for name in personality.parameters.defaults if name not in DEAFENING]
    for name in [*source.sample(names, len(names)), "", "_HASH_CHECK", "NO_SUCH", "x" * 16]:
        integer = personality.parameters.byte_wise and isinstance(
            personality.parameters.defaults.get(name), int
        )
        kind = (6 if integer else 9) if source.random() < 0.9 else source.randint(0, 255)
        value = _wire_value(source, integer=integer and kind == 6)
        yield mavlink.MAVLink_param_set_message(
            source.choice(TARGETS), source.choice(COMPONENTS), name.encode(), value, kind
        )
        if source.random() < 0.1:
            index = source.choice((-32_768, -1, 0, 5, 500, 32_767))
            yield mavlink.MAVLink_param_request_read_message(source.choice(TARGETS), 1, name.encode(), index)


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


ATTACKS: dict[str, Attack] = {
    attack.__name__: attack
    for attack in (
        any_message, flown_missions, written_files, flown_logs, commands, likely_commands, parameters,
        setpoints,
    )
}  # fmt: skip


# Most frames that a vehicle sends in answer to one frame: every parameter, or a long unpaced transfer.
MOST_FRAMES = 450
BY_THE_RULES = (flown_missions, written_files, flown_logs, likely_commands)


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
