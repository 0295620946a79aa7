"""The router of a star: what the vehicles' companions and the ground station connect to."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Callable, Mapping

from swarmctl.bus.transports.access import name_of
from swarmctl.bus.transports.zenoh import ZenohBus
from swarmctl.bus.transports.zenoh_config import Configuration


async def run(
    configuration: Configuration, say: Callable[[str], None], names: Mapping[int, str] | None = None
) -> None:
    """Route until SIGINT or SIGTERM, and say where it listens, who comes and who goes.

    `names` are the vehicles (system id: name); a certificate has the system id. Raises BusError.
    """
    vehicles = {name_of(uav): _called(uav, name) for uav, name in (names or {}).items()}
    stopped = asyncio.Event()
    loop = asyncio.get_running_loop()

    def changed(address: str, name: str | None, has_come: bool) -> None:
        who = "somebody" if not name else vehicles.get(name, name)
        say(f"{who} at {address} {'has connected' if has_come else 'has gone'}")

    signals = (signal.SIGINT, signal.SIGTERM)
    for number in signals:
        loop.add_signal_handler(number, stopped.set)
    try:
        with ZenohBus(configuration, on_link=changed) as bus:
            say(f"listening at {bus.endpoint}")
            await stopped.wait()
    finally:
        for number in signals:
            loop.remove_signal_handler(number)


def _called(uav: int, name: str) -> str:
    return name if name == name_of(uav) else f"{name} ({name_of(uav)})"
