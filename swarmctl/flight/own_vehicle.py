"""One vehicle of a flight: its configuration, its runner, and its preparation on the ground."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Sequence

from swarmctl.agent.state import AgentState
from swarmctl.bus.external_observations import ReportCounts
from swarmctl.config.specs import Spec
from swarmctl.flight.runner import Runner
from swarmctl.mavlink.events import Identity
from swarmctl.report.final_state import describe_final_state

POLL_S = 0.1


class OwnVehicle:
    """One vehicle of this process."""

    def __init__(self, spec: Spec, runner: Runner, report_counts: ReportCounts | None = None) -> None:
        self.spec = spec
        self.runner = runner
        self.report_counts = report_counts
        """counters of its payload's reports; None: its payload does not report"""
        self.identity: Identity | None = None
        """None before the vehicle has answered"""
        self._waits_for: tuple[str, ...] = ()
        """unmet conditions during the preparation"""
        self._is_overdue = False
        """True if the preparation takes longer than for a healthy vehicle"""
        self._failure = ""

    @property
    def state(self) -> AgentState:
        return self.runner.state

    @property
    def name(self) -> str:
        return self.spec.name

    @property
    def not_ready_because(self) -> str:
        """The reason why the preparation is not complete, or why it has failed; empty if there is none."""
        return "; ".join(self._waits_for) or self._failure

    @property
    def overdue_because(self) -> str:
        """The unmet conditions of a preparation that takes too long, as text; empty if there is none."""
        return "; ".join(self._waits_for) if self._is_overdue else ""

    def silent_for(self, limit_s: float) -> bool:
        """Return whether the link is lost and the vehicle's last message is older than `limit_s`."""
        return self.state.lost and self.runner.link.age_s() > limit_s

    def final_state(self) -> str:
        """Return a line with the vehicle's state, for the end of the flight."""
        link = self.runner.link
        return describe_final_state(self.state, link.state(), link.age_s())

    async def connect(self, timeout_s: float) -> Identity:
        """Wait for the vehicle's first answer and return its identity. Raises LinkError."""
        self.identity = await self.runner.link.connect(timeout_s)
        return self.identity

    def permit(self, check_again: Callable[[], Awaitable[Sequence[str]]]) -> None:
        """Let the connected vehicle be armed; `check_again` returns the failures of its checks now."""
        self.runner.clearance.permit(self.identity, check_again)

    async def prepare(
        self, timeout_s: float, *, report_every_s: float, on_overdue: Callable[[str], None]
    ) -> None:
        """Wait until the vehicle is ready to arm; a long wait calls `on_overdue`. Raises LinkError."""
        clock = asyncio.get_running_loop().time
        reported_s = clock()

        def waiting(reasons: tuple[str, ...]) -> None:
            nonlocal reported_s
            self._waits_for = reasons
            # A healthy vehicle waits for its estimator too, so only a long wait is reported.
            if reasons and clock() - reported_s >= report_every_s:
                reported_s = clock()
                self._is_overdue = True
                on_overdue("; ".join(reasons))

        await self.runner.link.prepare(timeout_s, waiting)
        self._waits_for, self._is_overdue, self._failure = (), False, ""

    def fail(self, reason: str) -> None:
        """Keep the reason of a failed preparation, without the vehicle's name."""
        self._failure = reason.removeprefix(f"{self.name}: ")


def not_simulated(vehicles: Sequence[OwnVehicle]) -> list[OwnVehicle]:
    """Return the vehicles that are not known to be of the built-in simulator."""
    return [m for m in vehicles if m.identity is None or not m.identity.simulated]


def names(vehicles: Sequence[OwnVehicle]) -> str:
    return ", ".join(m.name for m in vehicles)


async def until(condition: Callable[[OwnVehicle], bool], vehicles: Sequence[OwnVehicle]) -> None:
    """Wait until the condition holds for every vehicle."""
    # Polled: silence, unlike a change of phase, raises no event.
    while not all(condition(m) for m in vehicles):  # noqa: ASYNC110
        await asyncio.sleep(POLL_S)
