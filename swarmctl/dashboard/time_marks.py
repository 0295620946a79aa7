"""Marks above the time slider: alarms, warnings and changes of routes. Pure."""

from __future__ import annotations

from collections.abc import Iterable

from swarmctl.dashboard.model import Timeline

HEIGHTS = {"alarm": 12, "warning": 8, "change": 4}
"""height of each kind of mark, so that its colour is not needed [px]"""
WIDTH = 1000
"""number of different places of a mark"""


def marks_of(timelines: Iterable[Timeline], end_s: float) -> str:
    """Return the marks of runs from 0 to `end_s` as SVG; of several marks at one place the highest."""
    at: dict[int, str] = {}

    def add(time_s: float, kind: str) -> None:
        x = 2 * round(0.5 * WIDTH * min(time_s / max(end_s, 0.1), 1.0))
        if HEIGHTS[kind] > HEIGHTS.get(at.get(x, ""), 0):
            at[x] = kind

    for timeline in timelines:
        for change in timeline.changes.items:
            add(change.time_s, "change")
        for event in timeline.events.items:
            if event.severity != "info":
                add(event.time_s, event.severity)
    marks = (
        f'<rect class="{kind}" x="{x - 1}" y="{HEIGHTS["alarm"] - HEIGHTS[kind]}" width="2" '
        f'height="{HEIGHTS[kind]}"/>'
        for x, kind in at.items()
    )
    label = "Alarms (high), warnings, and changes of routes (low)"
    return (
        f'<svg viewBox="0 0 {WIDTH} {HEIGHTS["alarm"]}" preserveAspectRatio="none" role="img" '
        f'aria-label="{label}">{"".join(marks)}</svg>'
    )
