"""The bus of a flight, open to its operator and to its vehicles' payloads."""

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
    """A session that operators reach at `listen`, if only with commands for `swarm`, and payloads with looks.

    Raises BusError.
    """
    if listen == NO_ENDPOINT:
        with ZenohBus(on_failure=on_failure) as bus:
            yield bus
        return
    with contextlib.ExitStack() as stack:
        door = parse_endpoint(listen)
        if door.is_certified:
            raise BusError(f"communication.listen: {door}: a flight in one process listens at tcp/HOST:PORT")
        asked = tuple(keys.request(swarm, kind) for kind in keys.KINDS)
        looks = keys.sensor_report(swarm, "*")
        bus = stack.enter_context(
            ZenohBus(standalone(door, (*asked, looks), (looks,)), on_failure=on_failure)
        )
        assert bus.endpoint is not None
        here = bus.endpoint.reachable
        try:
            stack.enter_context(directory.registered(swarm, here))
        except BusError as error:
            say(f"`swarmctl set` finds this swarm with --connect {here} only: {error}")
        if not door.is_loopback:
            say(
                f"whoever reaches {bus.endpoint} can change this swarm's weights and report for its sensors: "
                "nobody asks who it is"
            )
        yield bus
