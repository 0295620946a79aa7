"""Values for fields of messages, mostly at their limits."""

import math
import random
import struct
from collections.abc import Iterator
from typing import Any

from station import LAT_DEG, LON_DEG

FLOATS = (
    0.0, -0.0, 1.0, -1.0, 2.0, 0.5, 4.0, 12.0, 90.0, 180.0, 255.0, 1e-45, 1.2e-38, 65_535.0,
    21_196.0, 2.0**31, -(2.0**31), 2.0**32, 1e9, -1e9, 3.4e38, -3.4e38, math.nan, math.inf, -math.inf,
)  # fmt: skip
TARGETS = (0, 1, 1, 1, 1, 2, 2, 3, 255)
COMPONENTS = (0, 1, 1, 1, 1, 190, 255)
DEAFENING = frozenset({"SYSID_ENFORCE"})  # makes a vehicle ignore other stations, as specified


def place(source: random.Random) -> tuple[int, int]:
    """Return a position, mostly nearby, else anywhere."""
    if source.random() < 0.7:
        return tuple(round((at + source.uniform(-1e-3, 1e-3)) * 1e7) for at in (LAT_DEG, LON_DEG))  # type: ignore[return-value]
    return int(number("int32_t", source)), int(number("int32_t", source))


def number(kind: str, source: random.Random) -> float | int:
    """Return a value of a field's type, often at its limit."""
    if kind in ("float", "double"):
        if source.random() < 0.2:
            return float(struct.unpack("<f", source.randbytes(4))[0])
        return source.choice(FLOATS)
    kind = kind.removesuffix("_mavlink_version")
    bits = int(kind.removesuffix("_t").lstrip("uint"))
    signed = not kind.startswith("u")
    lowest, highest = (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) if signed else (0, 2**bits - 1)
    return source.choice((lowest, highest, 0, 1, 2, 3, source.randint(lowest, highest)))


def values(message: Any, source: random.Random) -> Iterator[Any]:
    """Yield values for all fields of a message class, mostly addressed to an existing vehicle."""
    lengths = dict(zip(message.ordered_fieldnames, message.array_lengths, strict=True))
    for field, kind in zip(message.fieldnames, message.fieldtypes, strict=True):
        if field == "target_system":
            yield source.choice((0, 1, 1, 1, 2, 3, 255))
        elif field == "target_component":
            yield source.choice((0, 1, 1, 1, 190, 255))
        elif kind == "char":
            yield source.randbytes(source.randint(0, max(lengths[field], 1)))
        elif lengths[field]:
            yield [number(kind, source) for _ in range(lengths[field])]
        else:
            yield number(kind, source)


def random_message(message: Any, source: random.Random) -> Any:
    return message(*values(message, source))
