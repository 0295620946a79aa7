"""Conversation with a vehicle: a state machine fed with messages and times.

`start(now)`, `receive(message, now)` and `tick(now)` return the messages to send. `next_deadline` is the time
of the next `tick`. `result` is None until the conversation ends. No function reads a clock.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Container
from enum import StrEnum
from typing import Generic, TypeVar

import msgspec

from swarmctl.mavlink.protocol.codec import GCS_COMPID, GCS_SYSID, Message

R = TypeVar("R")


class ConversationState(StrEnum):
    """State of a conversation, for checks and error texts."""

    NEW = "new"
    WAITING = "waiting for the first answer"
    EXCHANGING = "exchanging"
    DONE = "done"


TRANSITIONS: dict[ConversationState, frozenset[ConversationState]] = {
    ConversationState.NEW: frozenset({ConversationState.WAITING, ConversationState.DONE}),
    ConversationState.WAITING: frozenset({ConversationState.EXCHANGING, ConversationState.DONE}),
    ConversationState.EXCHANGING: frozenset({ConversationState.DONE}),
    ConversationState.DONE: frozenset(),
}


class IllegalEvent(RuntimeError):
    """A bug in the caller: the event is illegal in this state."""


def check_transition(machine: object, before: str, after: str, may_follow: Container[str]) -> None:
    """Raise IllegalEvent if a machine's table does not let `after` follow `before`."""
    if after not in may_follow:
        raise IllegalEvent(f"{type(machine).__name__}: {after} does not follow {before}")


class MavlinkPeer(msgspec.Struct, frozen=True):
    """Ids of the vehicle in a conversation, and of this ground station."""

    sysid: int
    compid: int = 1
    own_sysid: int = GCS_SYSID
    own_compid: int = GCS_COMPID

    def is_for_us(self, message: Message) -> bool:
        """Return whether a message is for this ground station. Old firmware leaves some targets 0."""
        return getattr(message, "target_system", 0) in (0, self.own_sysid) and (
            getattr(message, "target_component", 0) in (0, self.own_compid)
        )


class Conversation(ABC, Generic[R]):
    """Base of all conversations: the state, and a check of each transition.

    Messages after the end are normal on a radio and are ignored.
    """

    def __init__(self) -> None:
        self.state = ConversationState.NEW
        self.result: R | None = None
        self.next_deadline: float | None = None

    def start(self, now: float) -> list[Message]:
        if self.state is not ConversationState.NEW:
            raise IllegalEvent(f"{type(self).__name__}: start while {self.state}")
        self._enter(ConversationState.WAITING)
        return self._begin(now)

    def receive(self, message: Message, now: float) -> list[Message]:
        return self._on_message(message, now) if self._is_running("receive") else []

    def tick(self, now: float) -> list[Message]:
        if not self._is_running("tick") or self.next_deadline is None or now < self.next_deadline:
            return []
        return self._on_deadline(now)

    def cancel(self, now: float) -> list[Message]:
        """Stop; return the messages that end the exchange on the vehicle. `result` stays None."""
        if not self._is_running("cancel"):
            return []
        closing = self._closing_messages(now)
        self._enter(ConversationState.DONE)
        self.next_deadline = None
        return closing

    @abstractmethod
    def _begin(self, now: float) -> list[Message]: ...

    @abstractmethod
    def _on_message(self, message: Message, now: float) -> list[Message]: ...

    @abstractmethod
    def _on_deadline(self, now: float) -> list[Message]: ...

    def _closing_messages(self, now: float) -> list[Message]:
        return []

    def _is_running(self, event: str) -> bool:
        if self.state is ConversationState.NEW:
            raise IllegalEvent(f"{type(self).__name__}: {event} while {self.state}; start it first")
        return self.state is not ConversationState.DONE

    def _enter(self, state: ConversationState) -> None:
        check_transition(self, self.state, state, TRANSITIONS[self.state])
        self.state = state

    def _finish(self, result: R) -> None:
        self._enter(ConversationState.DONE)
        self.result = result
        self.next_deadline = None
