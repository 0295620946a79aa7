"""A station in a thread of its own."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from operator_station import Station

from swarmctl.bus.transports.open import open_bus
from swarmctl.security.requests import by_token
from swarmctl.security.token import new_token


@contextmanager
def station_in_a_thread() -> Iterator[Station]:
    """Yield a ground station that listens in a thread while the command line runs."""
    ready, over = threading.Event(), threading.Event()
    made: list[Station] = []

    async def scene() -> None:
        token = new_token()
        with open_bus("test", (1, 2), "tcp/127.0.0.1:0", token.text, print) as bus:
            made.append(Station(bus, authentication=by_token("test", token, 5.0, time.time)))
            ready.set()
            await asyncio.to_thread(over.wait)

    thread = threading.Thread(target=asyncio.run, args=(scene(),))
    thread.start()
    try:
        assert ready.wait(10.0)
        yield made[0]
    finally:
        over.set()
        thread.join()
