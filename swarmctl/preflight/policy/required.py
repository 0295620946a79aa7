"""What one parameter may be. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from swarmctl.mavlink.protocol.parameters import same_value

Version = tuple[int, int]
LEAST = 1e-6
"""that is not 0"""


class NoParameterTable(Exception):
    """Nobody knows which parameters of this firmware say what is declared, or none can."""


@dataclass(frozen=True, slots=True)
class RequiredParameter:
    """What one parameter may be: one of `values`, from `least` to `most`, or without the bit number `bit`."""

    name: str
    declared: str
    """what it stands for"""
    set_to: float | None = None
    """what is written where it is another, the bit aside; None: a person sets it"""
    values: tuple[float, ...] = ()
    least: float = math.nan
    most: float = math.nan
    bit: int | None = None

    def accepts(self, value: float) -> bool:
        if not math.isfinite(value):
            return False
        if self.bit is not None:
            return value.is_integer() and not int(value) >> self.bit & 1
        return any(same_value(value, v) for v in self.values) or self.least <= value <= self.most

    def met_by(self, told: Mapping[str, float]) -> bool:
        """`told`: what the vehicle has told, by name; what it lacks and what was lost are not told alike."""
        return self.name in told and self.accepts(told[self.name])

    def corrected(self, value: float) -> float | None:
        """What to write in the place of `value`, which is not accepted; None: nothing."""
        if self.bit is None:
            return self.set_to
        return float(int(value) & ~(1 << self.bit)) if math.isfinite(value) else None

    def __str__(self) -> str:
        if self.bit is not None:
            return f"without bit {self.bit}"
        texts = [f"{v:g}" for v in self.values]
        if not math.isnan(self.least):
            above = "above 0" if self.least <= LEAST else f"{self.least:g} or more"
            texts.append(above if math.isinf(self.most) else f"{self.least:g} to {self.most:g}")
        return " or ".join(texts)


def one(name: str, declared: str, values: Mapping[str, tuple[float, ...]], action: str) -> RequiredParameter:
    """An action by its numbers, of which the first is written."""
    if action not in values:
        raise NoParameterTable(f"{name} has no value for {declared}; it can {', '.join(values)}")
    return RequiredParameter(name, declared, values[action][0], values[action])


def exactly(name: str, declared: str, value: float) -> RequiredParameter:
    return RequiredParameter(name, declared, value, (value,))


def above_zero(name: str, declared: str) -> RequiredParameter:
    return RequiredParameter(name, declared, least=LEAST, most=math.inf)
