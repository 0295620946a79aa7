"""The report of a flight."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

from swarmctl.agent.state import ARRIVED, AgentState
from swarmctl.preflight.results import CheckResult
from swarmctl.report.summary import FlightStatistics

Ending = Literal["ended", "stopped", "abandoned", "failed"]


@dataclass(slots=True)
class FlightReport:
    """The report of one flight: ending, final states, summary and results of preflight."""

    ended: Ending
    trouble: tuple[str, ...]
    """lines about errors of the run, and about output files that ended early"""
    final_states: tuple[str, ...]
    """a line for each vehicle that has not arrived"""
    states: dict[int, AgentState]
    statistics: FlightStatistics
    summary: dict[str, Any]
    bug: Exception | None = None
    """unexpected exception, caused by a bug"""
    checked: dict[str, tuple[CheckResult, ...]] = field(default_factory=dict)
    """results of the preflight checks, by vehicle name"""

    @property
    def arrived(self) -> int:
        return sum(s.outcome == ARRIVED for s in self.states.values())

    @property
    def all_arrived(self) -> bool:
        return bool(self.states) and self.arrived == len(self.states)
