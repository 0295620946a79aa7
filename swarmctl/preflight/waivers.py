"""Waivers: failures that an operator accepts, by the name of the check. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import msgspec

from swarmctl.config.communication import vehicle_of
from swarmctl.preflight.checks import CHECKS


class Waiver(msgspec.Struct, frozen=True):
    """An accepted failure of one check."""

    check: str
    vehicle: str | None = None
    """None: every vehicle"""

    def covers(self, check: str, vehicle: str) -> bool:
        return self.check == check and self.vehicle in (None, vehicle)


def parse_waivers(texts: Iterable[str], names: Mapping[int, str]) -> tuple[Waiver, ...]:
    """Return the waivers of texts `CHECK` or `CHECK:VEHICLE`; `names`: of all vehicles, by system id.

    Raises ValueError for an unknown check or vehicle, and for a check that may not be waived.
    """
    return tuple(_parse_waiver(text, names) for text in texts)


def _parse_waiver(text: str, names: Mapping[int, str]) -> Waiver:
    check, colon, vehicle = text.partition(":")
    is_waivable = {module.NAME: module.WAIVABLE for module in CHECKS}
    waivable = ", ".join(name for name, may in is_waivable.items() if may)
    if check not in is_waivable:
        raise ValueError(f"{text}: unknown check {check!r}; the checks are {', '.join(is_waivable)}")
    if not is_waivable[check]:
        raise ValueError(f"{text}: check {check} cannot be waived; the waivable checks are {waivable}")
    if not colon:
        return Waiver(check)
    try:
        return Waiver(check, names[vehicle_of(vehicle, names)])
    except ValueError as error:
        raise ValueError(f"{text}: {error}") from None
