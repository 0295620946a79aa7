"""Required parameters: the accepted values of one parameter, and its correction. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import msgspec

from swarmctl.mavlink.protocol.parameters import same_value

Version = tuple[int, int]
MIN_ABOVE_ZERO = 1e-6
"""least accepted value of a parameter that must be above 0"""


class NoParameterTable(Exception):
    """No table: the firmware's parameters are unknown, or cannot express the declared behaviour."""


class RequiredParameter(msgspec.Struct, frozen=True):
    """A parameter and the accepted values: `values`, and numbers from `least` to `most`.

    If `bit` is set, whole numbers without this bit are accepted, and `set_to` is not used.
    """

    name: str
    declared: str
    """declared behaviour that needs the parameter, as text for operators"""
    set_to: float | None = None
    """value to write if the vehicle's value is not accepted; None: write nothing"""
    values: tuple[float, ...] = ()
    least: float = math.nan
    most: float = math.nan
    bit: int | None = None

    def accepts(self, value: float) -> bool:
        if not math.isfinite(value):
            return False
        if self.bit is not None:
            return value.is_integer() and not int(value) >> self.bit & 1
        # A limit that is no float32, such as 72.8, comes back rounded.
        at_limit = any(math.isclose(value, limit, rel_tol=1e-6) for limit in (self.least, self.most))
        return at_limit or any(same_value(value, v) for v in self.values) or self.least <= value <= self.most

    def met_by(self, reported: Mapping[str, float]) -> bool:
        """Return whether the reported value is accepted.

        A parameter is missing in `reported` if the vehicle lacks it, or if its message was lost.
        """
        return self.name in reported and self.accepts(reported[self.name])

    def corrected(self, value: float) -> float | None:
        """Return the value to write in place of `value`, which is not accepted; None: write nothing."""
        if self.bit is None:
            return self.set_to
        return float(int(value) & ~(1 << self.bit)) if math.isfinite(value) else None

    def __str__(self) -> str:
        if self.bit is not None:
            return f"without bit {self.bit}"
        texts = [f"{v:g}" for v in self.values]
        if not math.isnan(self.least):
            above = "above 0" if self.least <= MIN_ABOVE_ZERO else f"{self.least:g} or more"
            texts.append(above if math.isinf(self.most) else f"{self.least:g} to {self.most:g}")
        return " or ".join(texts)


def corrections(required: Sequence[RequiredParameter], found: Mapping[str, float]) -> dict[str, float]:
    """Return the values to set, by name, for wrong parameters that the vehicle reported."""
    return {
        r.name: value
        for r in required
        if r.name in found
        and not r.accepts(found[r.name])
        and (value := r.corrected(found[r.name])) is not None
    }


def one_of(
    name: str, declared: str, values: Mapping[str, tuple[float, ...]], action: str
) -> RequiredParameter:
    """Return the requirement; a correction writes the action's first value. Raises NoParameterTable."""
    if action not in values:
        raise NoParameterTable(f"{name} has no value for {declared}; it has values for {', '.join(values)}")
    return RequiredParameter(name, declared, values[action][0], values[action])


def exactly(name: str, declared: str, value: float) -> RequiredParameter:
    """Return a requirement with one accepted value."""
    return RequiredParameter(name, declared, value, (value,))


def above_zero(name: str, declared: str) -> RequiredParameter:
    """Return a requirement that accepts every value from MIN_ABOVE_ZERO on; a correction writes nothing."""
    return RequiredParameter(name, declared, least=MIN_ABOVE_ZERO, most=math.inf)
