"""Procedures as generators: `result = yield Upload(...)`, driven without I/O.

A procedure yields conversations and is resumed with their results, so its steps are in order in the source.
The `Driver` of a procedure is a conversation.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from math import inf
from typing import Any, TypeVar

from swarmctl.core.mission import MissionItem
from swarmctl.core.vehicle import RECENT_DELAY_S, VehicleState
from swarmctl.mavlink.dialects import Dialect
from swarmctl.mavlink.protocol.codec import Message
from swarmctl.mavlink.protocol.conversation import Conversation, ConversationState, MavlinkPeer
from swarmctl.mavlink.protocol.wait import WaitUntil
from swarmctl.mavlink.telemetry.vehicle_state import Telemetry

R = TypeVar("R")
Procedure = Generator[Conversation[Any], Any, R]


@dataclass(slots=True)
class Context:
    """State shared by the procedures of one vehicle; only the procedures and the session write to it."""

    peer: MavlinkPeer
    autopilot: int
    """MAV_AUTOPILOT"""
    dialect: Dialect
    telemetry: Telemetry
    now: float = 0.0
    verified_items: tuple[MissionItem, ...] = field(default=())
    """the mission last verified on the vehicle; empty if none, or if the vehicle may store another mission"""
    plan_first_seq: int = 0
    """index in `verified_items` of the flown plan's first waypoint, after home, take-off and earlier plans"""
    interrupted: bool = False
    """True if the previous procedure was cancelled: a command of that procedure may take effect later"""

    setpoint_sent_s: float = -inf
    """time of the last set-point to the vehicle, by this program's clock [s]"""

    @property
    def state(self) -> VehicleState:
        return self.telemetry.state

    def has_recent_telemetry(self) -> bool:
        """Return whether a message that arrives now is recent enough for a command."""
        return not self.telemetry.clock.is_old(self.now, RECENT_DELAY_S)

    def after_heartbeat(self, condition: Callable[[VehicleState], bool]) -> Callable[[], bool]:
        """Return a condition: a heartbeat has arrived after this call, and `condition` holds."""
        before = self.telemetry.n_heartbeats
        return lambda: self.telemetry.n_heartbeats > before and condition(self.state)


class Driver(Conversation[R]):
    """Driver of a procedure; `result` is the procedure's return value."""

    def __init__(self, procedure: Procedure[R], context: Context) -> None:
        super().__init__()
        self._procedure = procedure
        self._context = context
        self._current: Conversation[Any]
        """conversation that runs, from the procedure's first wait on"""

    @property
    def is_waiting(self) -> bool:
        """Return whether the procedure waits, without a command or a transfer under way."""
        return isinstance(self._current, WaitUntil)

    def _begin(self, now: float) -> list[Message]:
        self._enter(ConversationState.EXCHANGING)
        return self._resume(None, now)

    def _on_message(self, message: Message, now: float) -> list[Message]:
        return self._resume_after_end(self._current.receive(message, now), now)

    def _on_deadline(self, now: float) -> list[Message]:
        return self._resume_after_end(self._current.tick(now), now)

    def _closing_messages(self, now: float) -> list[Message]:
        messages = self._current.cancel(now)
        self._procedure.close()
        return messages

    def _resume_after_end(self, messages: list[Message], now: float) -> list[Message]:
        if self._current.result is not None:
            return messages + self._resume(self._current.result, now)
        self.next_deadline = self._current.next_deadline
        return messages

    def _resume(self, result: Any, now: float) -> list[Message]:
        """Resume the procedure until a conversation waits for the vehicle; return the messages to send."""
        self._context.now = now
        messages: list[Message] = []
        while True:
            try:
                self._current = self._procedure.send(result)
            except StopIteration as stop:
                self._finish(stop.value)
                return messages
            messages += self._current.start(now)
            if self._current.result is None:
                self.next_deadline = self._current.next_deadline
                return messages
            result = self._current.result
