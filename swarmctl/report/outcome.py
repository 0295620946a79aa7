"""How a flight ended: the result that the composition root returns and every report is written from."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

from swarmctl.agent.state import ARRIVED, AgentState
from swarmctl.preflight.conversation import CheckResult
from swarmctl.report.summary import FlightStatistics

Ending = Literal["ended", "stopped", "abandoned", "failed"]


@dataclass(slots=True)
class Report:
    """How a flight ended."""

    ended: Ending
    trouble: tuple[str, ...]
    """what went wrong before or beside the flight"""
    left: tuple[str, ...]
    """how each vehicle was left"""
    states: dict[int, AgentState]
    statistics: FlightStatistics
    summary: dict[str, Any]
    bug: Exception | None = None
    """what broke the flight and should not have been possible"""
    checked: dict[str, tuple[CheckResult, ...]] = field(default_factory=dict)
    """what the preflight checks found of each vehicle, by its name"""

    @property
    def arrived(self) -> int:
        return sum(s.outcome == ARRIVED for s in self.states.values())

    @property
    def all_arrived(self) -> bool:
        return bool(self.states) and self.arrived == len(self.states)
