"""The report of a flight."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import msgspec

from swarmctl.agent.phases import Phase
from swarmctl.agent.state import ARRIVED, AgentState
from swarmctl.core.events import FlightOrder
from swarmctl.preflight.results import CheckResult
from swarmctl.report.summary import FlightStatistics

Ending = Literal["ended", "stopped", "abandoned", "failed"]


class FlightReport(msgspec.Struct, frozen=True):
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
    checked: dict[str, tuple[CheckResult, ...]] = msgspec.field(default_factory=dict)
    """results of the preflight checks, by vehicle name"""

    @property
    def arrived(self) -> int:
        return sum(s.outcome == ARRIVED for s in self.states.values())

    @property
    def all_arrived(self) -> bool:
        return bool(self.states) and self.arrived == len(self.states)

    @property
    def ended_by_operator(self) -> list[str]:
        return ended_by_operator(self.ended, self.states)


def ended_by_operator(ended: Ending, states: Mapping[int, AgentState]) -> list[str]:
    """Return the names of the vehicles that ended their flight by following an operator's order.

    A stopped run has no such vehicles, because the program itself gives the orders. A vehicle that was given
    up, released or disarmed on its way has failed, even after an order.
    """
    if ended != "ended":
        return []
    return [state.task.name for state in states.values() if _followed_order(state)]


def _followed_order(state: AgentState) -> bool:
    flown = state.launch.armed_seen or state.launch.is_aborted
    return (
        state.phase is Phase.DONE
        and state.outcome != ARRIVED
        and flown
        and state.order.given in (FlightOrder.RETURN, FlightOrder.LAND)
        and state.order.is_followed
    )
