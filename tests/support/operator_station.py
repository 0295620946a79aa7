"""A ground station with an operator service, for tests."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass

from swarmctl.bus.authentication import NO_AUTHENTICATION, Authentication
from swarmctl.bus.endpoint import BusEndpoint
from swarmctl.bus.operator_service import AgentCommand, CommandCounts, OperatorService
from swarmctl.bus.transports import zenoh_config
from swarmctl.bus.transports.base import Transport
from swarmctl.bus.transports.memory import MemoryBus
from swarmctl.bus.transports.zenoh import ZenohBus
from swarmctl.core.messages import GiveOrder, VehicleAnswer

KEY, ORDER = (f"swarmctl/test/uav/2/request/{kind}/operator" for kind in ("weights", "order"))
ANYWHERE = BusEndpoint("127.0.0.1", 0)


AnswerTo = Callable[[VehicleAnswer], None]
Pair = Callable[[], AbstractContextManager[tuple[Transport, Transport]]]
"""Opens the buses of a service and of its user, which may be one bus."""


@dataclass
class StubAgent:
    """An agent that passes each command, and the receiver of its answer, to a function."""

    name: str
    command: Callable[[AgentCommand, AnswerTo], None]


class Station:
    """An operator service whose agents accept every command at once, unless they are slow.

    `uav`: the only vehicle of this process, in a swarm of several; None: a swarm of two vehicles.
    `closed`: the reason for which the service refuses orders.
    """

    def __init__(
        self,
        transport: Transport,
        *,
        uav: int | None = None,
        slow: tuple[int, ...] = (),
        closed: str = "",
        authentication: Authentication = NO_AUTHENTICATION,
    ) -> None:
        self.said: list[str] = []
        self.posted: list[tuple[int, AgentCommand]] = []
        self.late: list[Callable[[], None]] = []
        """answers of the slow agents"""
        self.slow = slow
        self.service = OperatorService(
            transport,
            "test",
            self.said.append,
            {n: self._agent(n) for n in ((1, 2) if uav is None else (uav,))},
            flies_all=uav is None,
            refusal=lambda command: closed if isinstance(command, GiveOrder) else "",
            authentication=authentication,
        )

    @property
    def counts(self) -> CommandCounts:
        return self.service.counts

    def _agent(self, uav: int) -> StubAgent:
        taken = VehicleAnswer(uav, f"uav{uav}", "taken", 5)

        def command(event: AgentCommand, answer_to: AnswerTo) -> None:
            self.posted.append((uav, event))
            if uav in self.slow:
                self.late.append(lambda: answer_to(taken))
            else:
                answer_to(taken)

        return StubAgent(taken.name, command)


@contextmanager
def memory_pair() -> Iterator[tuple[Transport, Transport]]:
    bus = MemoryBus()
    yield bus, bus


@contextmanager
def zenoh_pair() -> Iterator[tuple[Transport, Transport]]:
    """Yield the buses of the ground station and of the operator, as in two processes."""
    with ZenohBus(zenoh_config.whole_swarm(ANYWHERE, "test", (1, 2))) as ground:
        assert ground.endpoint is not None
        with ZenohBus(zenoh_config.visitor(ground.endpoint)) as operator:
            yield ground, operator
