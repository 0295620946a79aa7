"""Opens the bus of a flight to its operator and to its vehicles' payloads."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

from swarmctl.bus import directory, keys
from swarmctl.bus.endpoint import NO_ENDPOINT, parse_endpoint
from swarmctl.bus.transports.base import BusError, Failure
from swarmctl.bus.transports.routes import report_to_loop
from swarmctl.bus.transports.zenoh import ZenohBus
from swarmctl.bus.transports.zenoh_config import standalone


@contextlib.contextmanager
def open_bus(
    swarm: str, listen: str, say: Callable[[str], None], on_failure: Failure = report_to_loop
) -> Iterator[ZenohBus]:
    """Open a session at `listen` that accepts operators' commands and payloads' reports for `swarm` only.

    The flight is registered in the directory of running swarms. Raises BusError.
    """
    if listen == NO_ENDPOINT:
        with ZenohBus(on_failure=on_failure) as bus:
            yield bus
        return
    with contextlib.ExitStack() as stack:
        endpoint = parse_endpoint(listen)
        if endpoint.is_certified:
            raise BusError(
                f"communication.listen: {endpoint}: a flight in one process listens at tcp/HOST:PORT"
            )
        requests = tuple(keys.request(swarm, kind) for kind in keys.REQUEST_KINDS)
        reports = keys.sensor_report(swarm, "*")
        configuration = standalone(endpoint, (*requests, reports), (reports,))
        bus = stack.enter_context(ZenohBus(configuration, on_failure=on_failure))
        assert bus.endpoint is not None
        here = bus.endpoint.reachable
        try:
            stack.enter_context(directory.registered(swarm, here))
        except BusError as error:
            say(f"operators' commands find this swarm with --connect {here} only: {error} [not-registered]")
        if not endpoint.is_loopback:
            say(
                f"{bus.endpoint} is open to other machines without authentication: they can change this "
                "swarm's weights, give it orders and report for its sensors [open-endpoint]"
            )
        yield bus
