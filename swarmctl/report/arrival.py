"""How well vehicles that were to arrive together did so, for the summary."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from swarmctl.agent.state import AgentState


class Arrivals:
    """When each vehicle of this process was first over its goal, by the run's clock."""

    def __init__(self) -> None:
        self._at_s: dict[int, float] = {}

    def moved(self, after: AgentState, now: float) -> None:
        if after.arrived_boot_s is not None:
            self._at_s.setdefault(after.task.uav, now)

    def summary(self, states: Mapping[int, AgentState], seconds: float) -> dict[str, Any] | None:
        """None where vehicles arrive each by itself. `seconds`: simulated ones in one of the run's clock.

        The spread is how far apart the first and the last were of all that arrived, when the spacing of
        staggered ones is taken away: 0 is as agreed.
        """
        meetings = [state.task.meeting for state in states.values() if state.task.meeting is not None]
        if not meetings:
            return None
        meeting, first_s = meetings[0], min(self._at_s.values(), default=0.0)
        after_s = {uav: (at_s - first_s) * seconds for uav, at_s in self._at_s.items()}
        off_s = [at_s - meeting.rank[uav] * meeting.spacing_s for uav, at_s in after_s.items()]
        spread_s = max(off_s) - min(off_s) if len(off_s) > 1 else None
        return {
            "spacing_s": meeting.spacing_s,
            "tolerance_s": meeting.tolerance_s,
            "spread_s": spread_s,
            "kept": None if spread_s is None else spread_s <= meeting.tolerance_s,
            "vehicles": [
                {"name": state.task.name, "after_the_first_s": after_s.get(uav)}
                for uav, state in sorted(states.items())
            ],
        }
