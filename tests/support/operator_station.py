"""A ground station with an operator service, for tests."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from swarmctl.bus.authentication import NO_AUTHENTICATION, Authentication
from swarmctl.bus.endpoint import BusEndpoint
from swarmctl.bus.operator_service import CommandCounts, OperatorService
from swarmctl.bus.transports.base import Transport
from swarmctl.bus.transports.zenoh import ZenohBus
from swarmctl.core import events as ev
from swarmctl.core.messages import VehicleAnswer

KEY = "swarmctl/test/station/request/weights/operator"
ANYWHERE = BusEndpoint("127.0.0.1", 0)


class Station:
    """An operator service with two agents that accept every command at once, unless they are slow."""

    def __init__(
        self,
        transport: Transport,
        *,
        slow: tuple[int, ...] = (),
        authentication: Authentication = NO_AUTHENTICATION,
    ) -> None:
        self.said: list[str] = []
        self.counts = CommandCounts()
        self.posted: list[tuple[int, ev.WeightsChanged]] = []
        self.service = OperatorService(
            transport, "test", self.said.append, self.counts, authentication=authentication
        )
        for uav in (1, 2):
            self.service.join(uav, f"uav{uav}", self._agent(uav, slow=uav in slow))

    def _agent(self, uav: int, *, slow: bool) -> Callable[[ev.WeightsChanged], None]:
        def post(event: ev.WeightsChanged) -> None:
            self.posted.append((uav, event))
            if not slow:
                self.service.answered(event.command, VehicleAnswer(uav, f"uav{uav}", "taken", 5))

        return post


@contextmanager
def zenoh_pair() -> Iterator[tuple[Transport, Transport]]:
    """Yield the buses of the ground station and of the operator, as in two processes."""
    with ZenohBus(listen=ANYWHERE, ask_keys=(KEY,)) as ground:
        assert ground.endpoint is not None
        with ZenohBus(connect=ground.endpoint) as operator:
            yield ground, operator
