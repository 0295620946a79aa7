"""Transports of the bus: memory, and Zenoh with its configuration, access lists and session renewal.

Every transport implements `base.Transport`. A new transport is a module and a line in `BUSES`; its name
is a value of `communication.bus`.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, closing
from importlib import import_module
from typing import Any

import msgspec

from swarmctl.bus.transports.base import Transport
from swarmctl.bus.transports.memory import MemoryBus


def _memory(*_: Any, on_failure: Any) -> AbstractContextManager[Transport]:
    return closing(MemoryBus(on_failure))


def _zenoh(*args: Any, **kwargs: Any) -> AbstractContextManager[Transport]:
    """Open a Zenoh session. Its library is native, so only the first use imports the module."""
    opened: AbstractContextManager[Transport] = import_module("swarmctl.bus.transports.open").open_bus(
        *args, **kwargs
    )
    return opened


class BusKind(msgspec.Struct, frozen=True):
    """A kind of transport that a flight opens by its configuration."""

    open: Callable[..., AbstractContextManager[Transport]]
    """function with the parameters of `open.open_bus`"""
    is_networked: bool
    """True if other processes reach it; then requests need a token, and it does not fit a virtual clock"""


BUSES: dict[str, BusKind] = {
    "zenoh": BusKind(_zenoh, is_networked=True),
    "memory": BusKind(_memory, is_networked=False),
}
