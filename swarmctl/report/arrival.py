"""Statistics of a simultaneous or staggered arrival, for the summary."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from swarmctl.agent.state import AgentState


class Arrivals:
    """Times at which the vehicles of this process first reached their goals, by the run's clock [s]."""

    def __init__(self) -> None:
        self._at_s: dict[int, float] = {}

    def moved(self, after: AgentState, now: float) -> None:
        if after.arrived_boot_s is not None:
            self._at_s.setdefault(after.task.uav, now)

    def summary(self, states: Mapping[int, AgentState], speedup: float) -> dict[str, Any] | None:
        """Return the section of the summary; None if no vehicle has an arrival group.

        `speedup`: simulated seconds in one second of the run's clock. The spread is the greatest deviation
        between two arrivals from the configured spacing [s]; None for fewer than two arrivals.
        """
        groups = [s.task.arrival_group for s in states.values() if s.task.arrival_group is not None]
        if not groups:
            return None
        group, first_s = groups[0], min(self._at_s.values(), default=0.0)
        after_s = {uav: (at_s - first_s) * speedup for uav, at_s in self._at_s.items()}
        off_s = [at_s - group.rank[uav] * group.spacing_s for uav, at_s in after_s.items()]
        spread_s = max(off_s) - min(off_s) if len(off_s) > 1 else None
        return {
            "spacing_s": group.spacing_s,
            "tolerance_s": group.tolerance_s,
            "spread_s": spread_s,
            "kept": None if spread_s is None else spread_s <= group.tolerance_s,
            "vehicles": [
                {"name": state.task.name, "after_the_first_s": after_s.get(uav)}
                for uav, state in sorted(states.items())
            ],
        }
