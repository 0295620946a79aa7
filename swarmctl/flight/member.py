"""A vehicle of the swarm while it is flown."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from swarmctl.agent.state import AgentState
from swarmctl.config.specs import Spec
from swarmctl.flight.runner import Runner
from swarmctl.links.base import Identity

POLL_S = 0.1


@dataclass(slots=True)
class Member:
    """What leads it, what is configured of it, and what was found."""

    spec: Spec
    runner: Runner
    identity: Identity | None = None
    waiting_for: tuple[str, ...] = ()
    hindrance: str = ""
    """what kept it from being made ready, in words"""

    @property
    def state(self) -> AgentState:
        return self.runner.state

    @property
    def name(self) -> str:
        return self.spec.name

    def silent_for(self, limit_s: float) -> bool:
        return self.state.lost and self.runner.link.age_s() > limit_s


def names(members: Sequence[Member]) -> str:
    return ", ".join(m.name for m in members)


async def until(condition: Callable[[Member], bool], members: Sequence[Member]) -> None:
    # Looked at a few times a second: silence, unlike a change of phase, wakes nobody.
    while not all(condition(m) for m in members):  # noqa: ASYNC110
        await asyncio.sleep(POLL_S)
