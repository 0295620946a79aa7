"""The user interface of a flight, and observers of its events."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

from swarmctl.agent.phases import Phase
from swarmctl.agent.state import AgentState
from swarmctl.core import events as ev
from swarmctl.core.messages import VehicleAnswer
from swarmctl.report.answers import order_line, weights_line
from swarmctl.report.live_rows import SwarmView


class Ui(Protocol):
    """The user interface of a flight."""

    def say(self, text: str) -> None:
        """Show a line to the operator."""

    def log(self, text: str) -> None:
        """Show a line if the operator asked for all lines (`--verbose`)."""

    def refresh(self, view: SwarmView) -> None: ...


class SilentUi:
    """A user interface that shows nothing."""

    def say(self, text: str) -> None: ...

    def log(self, text: str) -> None: ...

    def refresh(self, view: SwarmView) -> None: ...


class Observer:
    """A receiver of all events of the flight, such as the recorder; here each method does nothing."""

    def folded(
        self, before: AgentState, event: ev.Event, after: AgentState, effects: list[ev.Effect], now: float
    ) -> None: ...

    def noted(self, uav: int, text: str, now: float, *, to_operator: bool) -> None:
        """Receive a message about a vehicle; `to_operator`: True if an operator should read it."""


class SafeUi:
    """A wrapper of a user interface. A closed pipe or a full disk ends the output, but not the flight."""

    def __init__(self, ui: Ui) -> None:
        self._ui: Ui | None = ui

    def say(self, text: str) -> None:
        self._call("say", text)

    def log(self, text: str) -> None:
        self._call("log", text)

    def refresh(self, view: SwarmView) -> None:
        self._call("refresh", view)

    def _call(self, method: str, argument: Any) -> None:
        if self._ui is None:
            return
        try:
            getattr(self._ui, method)(argument)
        except (OSError, ValueError, SystemExit):  # Rich raises SystemExit if standard output is closed.
            self._ui = None


@dataclass(slots=True)
class UiObserver(Observer):
    """An observer that shows vehicles' messages and changes of state to the operator."""

    ui: Ui
    names: dict[int, str]

    def folded(
        self, before: AgentState, event: ev.Event, after: AgentState, effects: list[ev.Effect], now: float
    ) -> None:
        if after.phase is not before.phase:
            note = f" ({after.outcome})" if after.outcome else ""
            show = self.ui.say if after.phase is Phase.RELEASED else self.ui.log
            show(f"{after.task.name}: {before.phase} → {after.phase}{note}")
        if after.late and not before.late:
            self.ui.say(f"{after.task.name}: {after.late}")
        if after.lost is not before.lost:
            text = (
                "telemetry has stopped; orders may not reach the vehicle, and orders without an effect are "
                "repeated when telemetry is back [telemetry-lost]"
                if after.lost
                else "telemetry is back; orders without an effect are repeated [telemetry-back]"
            )
            self.ui.say(f"{after.task.name}: {text}")
        for effect in effects:
            if isinstance(effect, ev.Answer):
                self._answered(event, effect.answer, (after.w, after.strength) != (before.w, before.strength))

    def _answered(self, event: ev.Event, answer: VehicleAnswer, changed: bool) -> None:
        match event:
            case ev.OperatorCommand(order=order):
                self.ui.say(order_line(order, answer))
            # If a command changes no weight, a line is shown only if the outcome is not `taken`.
            case ev.WeightsChanged(w=w, strength=strength, range=reach, behaviours=behaviours) if (
                changed or reach is not None or behaviours or answer.outcome != "taken"
            ):
                self.ui.say(weights_line(w, strength, answer, reach, behaviours))

    def noted(self, uav: int, text: str, now: float, *, to_operator: bool) -> None:
        (self.ui.say if to_operator else self.ui.log)(f"{self.names[uav]}: {text}")
