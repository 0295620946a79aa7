"""The router of a star network, to which companions and the ground station connect."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Callable, Mapping

from swarmctl.bus.transports.access import name_of
from swarmctl.bus.transports.zenoh import ZenohBus
from swarmctl.bus.transports.zenoh_config import Configuration


async def run(
    configuration: Configuration,
    say: Callable[[str], None],
    names: Mapping[int, str] | None = None,
    common_names: Mapping[str, str] | None = None,
) -> None:
    """Route until SIGINT or SIGTERM; report the endpoint, connections and disconnections.

    names: vehicles (system id: name); certificates name vehicles by system id
    common_names: common names of certificates that differ from the participant's name, by participant

    Raises BusError.
    """
    vehicles = {name_of(uav): _label(uav, name) for uav, name in (names or {}).items()}
    for participant, certificate in (common_names or {}).items():
        vehicles[certificate] = vehicles.get(participant, participant)
        vehicles[participant] = f"a revoked certificate of {participant}, which may send nothing,"
    stopped = asyncio.Event()
    loop = asyncio.get_running_loop()

    def report_link(address: str, name: str | None, is_connected: bool) -> None:
        client = "a client" if not name else vehicles.get(name, name)
        say(f"{client} at {address} {'has connected' if is_connected else 'has disconnected'}")

    signals = (signal.SIGINT, signal.SIGTERM)
    for number in signals:
        loop.add_signal_handler(number, stopped.set)
    try:
        with ZenohBus(configuration, on_link=report_link) as bus:
            say(f"listening at {bus.endpoint}")
            await stopped.wait()
    finally:
        for number in signals:
            loop.remove_signal_handler(number)


def _label(uav: int, name: str) -> str:
    return name if name == name_of(uav) else f"{name} ({name_of(uav)})"
