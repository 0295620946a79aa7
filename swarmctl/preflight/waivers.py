"""What an operator takes upon himself, by the name of a check. Pure."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass

from swarmctl.preflight.checks import CHECKS


@dataclass(frozen=True, slots=True)
class Waiver:
    check: str
    vehicle: str | None = None
    """None: of every vehicle"""

    def covers(self, check: str, vehicle: str) -> bool:
        return self.check == check and self.vehicle in (None, vehicle)


def parse_waivers(texts: Iterable[str], vehicles: Collection[str]) -> tuple[Waiver, ...]:
    """Of `CHECK` or `CHECK:VEHICLE` each. Raises ValueError, for one that may not be waived too."""
    return tuple(_parsed(text, vehicles) for text in texts)


def _parsed(text: str, vehicles: Collection[str]) -> Waiver:
    name, colon, vehicle = text.partition(":")
    may = {check.NAME: check.WAIVABLE for check in CHECKS}
    waivable = ", ".join(check for check, so in may.items() if so)
    if name not in may:
        raise ValueError(f"{text}: there is no check {name!r}; there is {', '.join(may)}")
    if not may[name]:
        raise ValueError(f"{text}: {name} may not be waived; {waivable} may")
    if colon and vehicle not in vehicles:
        raise ValueError(f"{text}: there is no vehicle {vehicle!r}; there is {', '.join(vehicles)}")
    return Waiver(name, vehicle if colon else None)
