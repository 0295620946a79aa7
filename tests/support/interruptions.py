"""Address functions that silence a vehicle or press Ctrl-C."""

from __future__ import annotations

import signal
from typing import Any

from swarmctl.links.transports.base import Address


def silent(
    uav: int, since_s: float, until_s: float = float("inf"), *, comes_back_as: Address = ("new", 1)
) -> Any:
    """Cut one vehicle's link between two times; afterwards it sends from another address."""

    def address_of(sysid: int, now: float) -> Address | None:
        if sysid != uav:
            return ("simulated", sysid)
        if now < since_s:
            return ("simulated", sysid)
        return None if now < until_s else comes_back_as

    return address_of


def interrupting(*times_s: float) -> Any:
    """Press Ctrl-C at these times."""
    due = list(times_s)

    def address_of(sysid: int, now: float) -> Address | None:
        if due and now >= due[0]:
            due.pop(0)
            signal.raise_signal(signal.SIGINT)
        return ("simulated", sysid)

    return address_of
