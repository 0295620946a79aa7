"""Where a flight is shown: what a face offers, one that cannot break the flight, and who feeds it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

from swarmctl.agent.state import AgentState, Phase
from swarmctl.core import events as ev
from swarmctl.core.frames import Spoken
from swarmctl.core.messages import VehicleAnswer
from swarmctl.report.answers import ordered, told
from swarmctl.report.live_rows import Picture


class Ui(Protocol):
    """Where a flight is shown."""

    def say(self, text: str) -> None:
        """Something a person should read."""

    def log(self, text: str) -> None:
        """Something for who asked for all of it."""

    def refresh(self, picture: Picture) -> None: ...


class Steady:
    """A face that may break (a closed pipe, a full disk) without taking the flight with it."""

    def __init__(self, ui: Ui) -> None:
        self._ui: Ui | None = ui

    def say(self, text: str) -> None:
        self._show("say", text)

    def log(self, text: str) -> None:
        self._show("log", text)

    def refresh(self, picture: Picture) -> None:
        self._show("refresh", picture)

    def _show(self, how: str, what: Any) -> None:
        if self._ui is None:
            return
        try:
            getattr(self._ui, how)(what)
        except (OSError, ValueError, SystemExit):  # Rich exits where standard output is closed
            self._ui = None


@dataclass(slots=True)
class Chatter:
    """Passes on what vehicles say to whoever asked for it."""

    ui: Ui
    names: dict[int, str]

    def folded(
        self, before: AgentState, event: ev.Event, after: AgentState, effects: list[ev.Effect], now: float
    ) -> None:
        if after.phase is not before.phase:
            note = f" ({after.outcome})" if after.outcome else ""
            tell = self.ui.say if after.phase is Phase.RELEASED else self.ui.log
            tell(f"{after.task.name}: {before.phase} → {after.phase}{note}")
        if after.late and not before.late:
            self.ui.say(f"{after.task.name}: {after.late}")
        if after.lost is not before.lost:
            self.ui.say(f"{after.task.name}: " + ("link lost" if after.lost else "heard again"))
        for effect in effects:
            if isinstance(effect, ev.Answer):
                self._answered(event, effect.answer, (after.w, after.strength) != (before.w, before.strength))

    def _answered(self, event: ev.Event, answer: VehicleAnswer, changed: bool) -> None:
        match event:
            case ev.OperatorCommand(order=order):
                self.ui.say(ordered(order, answer))
            # What changes nothing is its operator's to know.
            case ev.WeightsChanged(w=w, strength=strength) if changed or answer.outcome != "taken":
                self.ui.say(told(w, strength, answer))

    def sent(self, uav: int, message: Spoken, recipients: int, now: float) -> None:
        pass

    def said(self, uav: int, text: str, now: float, *, aloud: bool) -> None:
        (self.ui.say if aloud else self.ui.log)(f"{self.names[uav]}: {text}")
