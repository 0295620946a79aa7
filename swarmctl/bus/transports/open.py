"""Opening of a flight's bus to operators and payloads."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence

from swarmctl.bus import directory
from swarmctl.bus.endpoint import NO_ENDPOINT, parse_endpoint
from swarmctl.bus.transports.base import BusError, Failure
from swarmctl.bus.transports.subscriptions import report_to_loop
from swarmctl.bus.transports.zenoh import ZenohBus
from swarmctl.bus.transports.zenoh_config import whole_swarm


@contextlib.contextmanager
def open_bus(
    swarm: str,
    uavs: Sequence[int],
    listen: str,
    token: str,
    say: Callable[[str], None],
    on_failure: Failure = report_to_loop,
) -> Iterator[ZenohBus]:
    """Open a session at `listen` for operators' commands and payloads' reports to the vehicles `uavs` only.

    Registers the flight in the directory of running swarms, with the token that requests need. If `listen` is
    `none`, the bus serves this process only. Raises BusError.
    """
    if listen == NO_ENDPOINT:
        with ZenohBus(on_failure=on_failure) as bus:
            yield bus
        return
    with contextlib.ExitStack() as stack:
        endpoint = parse_endpoint(listen)
        if endpoint.is_certified:
            raise BusError(f"communication.listen: {endpoint}: `swarmctl fly` listens only at tcp/HOST:PORT")
        bus = stack.enter_context(ZenohBus(whole_swarm(endpoint, swarm, uavs), on_failure=on_failure))
        assert bus.endpoint is not None
        address = bus.endpoint.client_endpoint
        try:
            stack.enter_context(directory.registered(swarm, address, token))
        except BusError as error:
            say(
                f"operators' commands find this swarm with --connect {address} only, and need the same "
                f"SWARMCTL_TOKEN_FILE: {error} [not-registered]"
            )
        if not endpoint.is_loopback:
            say(
                f"{bus.endpoint} is open to other machines without encryption: requests need this flight's "
                "token, but other machines can read them and use up connections; to prevent this, set "
                "communication.listen to tcp/127.0.0.1:PORT [open-endpoint]"
            )
        yield bus
