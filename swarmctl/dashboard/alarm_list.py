"""Alarms of a flight in progress: each stays until a person acknowledges it."""

from __future__ import annotations

from nicegui import ui

from swarmctl.dashboard.model import Timeline
from swarmctl.dashboard.picture import Event, Picture

SHOWN = 3
"""most alarms shown at once, the newest first"""


class AlarmList:
    """The alarms that nobody has acknowledged yet; an acknowledgement counts for all browsers."""

    def __init__(self, timeline: Timeline, *, may_acknowledge: bool) -> None:
        self._timeline = timeline
        self._may_acknowledge = may_acknowledge
        self._shown: tuple[int, ...] | None = None
        self._box = ui.column().classes("alarms w-full").props('role=alert aria-label="Alarms"')
        self._box.set_visibility(False)

    def show(self, picture: Picture) -> None:
        """Show the open alarms of a picture, if they have changed."""
        acknowledged = self._timeline.acknowledged
        alarms = [e for e in picture.events if e.severity == "alarm" and e.number not in acknowledged]
        numbers = tuple(alarm.number for alarm in alarms)
        if numbers == self._shown:
            return
        self._shown = numbers
        self._box.clear()
        self._box.set_visibility(bool(alarms))
        with self._box:
            for alarm in alarms[-SHOWN:][::-1]:
                self._row(alarm)
            if len(alarms) > 1 and self._may_acknowledge:
                more = f"{len(alarms)} alarms"
                ui.button(f"Acknowledge all {more}", on_click=lambda: self._acknowledge(numbers)).props(
                    "dense flat no-caps"
                )

    def _row(self, alarm: Event) -> None:
        with ui.row().classes("w-full no-wrap items-center text-xs"):
            ui.badge(f"{alarm.time_s:.0f} s", color="red").classes("shrink-0")
            ui.label(f"{alarm.vehicle}: {alarm.text}" if alarm.vehicle else alarm.text).classes("grow")
            if not self._may_acknowledge:
                return
            button = ui.button(icon="done", on_click=lambda: self._acknowledge((alarm.number,)))
            button.props('dense flat round size=sm aria-label="Acknowledge"').tooltip("Acknowledge")

    def _acknowledge(self, numbers: tuple[int, ...]) -> None:
        self._timeline.acknowledged.update(numbers)
