"""Statistics of a flight, from an agent's events."""

from __future__ import annotations

from agent_stories import GRID, Story

from swarmctl.core import events as ev
from swarmctl.report.summary import FlightStatistics


def test_a_long_hover_adds_no_positions() -> None:
    story, statistics = Story().flying(), FlightStatistics()
    for _ in range(100):
        before = story.state
        story.over((4, 1))
        event = ev.TelemetryReceived(story.state.vehicle)
        statistics.folded(before, event, story.state, [], story.now)
    before = story.state
    story.over((4, 2))
    statistics.folded(before, ev.TelemetryReceived(story.state.vehicle), story.state, [], story.now)
    vehicle = statistics.vehicles[1]
    assert vehicle.flown == [GRID.centre((4, 1)), GRID.centre((4, 2))]
    assert vehicle.last_s == story.state.vehicle.time_boot_s
