"""The bus of a flight, open to its operator."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

from swarmctl.bus import directory, keys
from swarmctl.bus.base import BusError
from swarmctl.bus.endpoint import parse_endpoint
from swarmctl.bus.zenoh_bus import ZenohBus

NOBODY = "none"
"""instead of an endpoint: nobody outside this process reaches the bus"""


@contextlib.contextmanager
def opened(swarm: str, listen: str, say: Callable[[str], None]) -> Iterator[ZenohBus]:
    """A session that an operator reaches at `listen`, if only with commands for `swarm`. Raises BusError."""
    if listen == NOBODY:
        with ZenohBus() as bus:
            yield bus
        return
    with contextlib.ExitStack() as stack:
        door = parse_endpoint(listen)
        bus = stack.enter_context(ZenohBus(listen=door, open_keys=(keys.weights(swarm),)))
        assert bus.endpoint is not None
        here = bus.endpoint.reachable
        try:
            stack.enter_context(directory.listed(swarm, here))
        except BusError as error:
            say(f"`swarmctl set` finds this swarm with --connect {here} only: {error}")
        if not door.is_loopback:
            say(f"whoever reaches {bus.endpoint} can change this swarm's weights: nobody asks who it is")
        yield bus
