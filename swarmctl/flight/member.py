"""One vehicle of a flight: its configuration, its runner and its identity."""

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
    """One vehicle of this process."""

    spec: Spec
    runner: Runner
    identity: Identity | None = None
    waiting_for: tuple[str, ...] = ()
    """unmet conditions during the preparation"""
    is_overdue: bool = False
    """True if the preparation takes longer than for a healthy vehicle"""
    not_ready_because: str = ""
    """reason why the preparation failed or was stopped"""

    @property
    def state(self) -> AgentState:
        return self.runner.state

    @property
    def name(self) -> str:
        return self.spec.name

    def silent_for(self, limit_s: float) -> bool:
        """Return whether the link is lost and the vehicle's last message is older than `limit_s`."""
        return self.state.lost and self.runner.link.age_s() > limit_s


def names(members: Sequence[Member]) -> str:
    return ", ".join(m.name for m in members)


async def until(condition: Callable[[Member], bool], members: Sequence[Member]) -> None:
    """Wait until the condition holds for every member."""
    # Polled: silence, unlike a change of phase, raises no event.
    while not all(condition(m) for m in members):  # noqa: ASYNC110
        await asyncio.sleep(POLL_S)
