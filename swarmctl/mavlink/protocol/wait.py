"""Conversations that wait: for a condition, with or without requests, or for the answers to requests."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Generic, TypeVar

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.mavlink.protocol.codec import Message
from swarmctl.mavlink.protocol.command import command_long
from swarmctl.mavlink.protocol.conversation import Conversation, MavlinkPeer

K = TypeVar("K")
A = TypeVar("A")


class WaitUntil(Conversation[bool]):
    """Wait until `condition()` holds, for at most `timeout_s`; the result is True if the condition holds."""

    def __init__(self, condition: Callable[[], bool], timeout_s: float) -> None:
        super().__init__()
        self._condition = condition
        self._timeout_s = timeout_s

    def _begin(self, now: float) -> list[Message]:
        self.next_deadline = now + self._timeout_s
        return self._check()

    def _on_message(self, message: Message, now: float) -> list[Message]:
        return self._check()

    def _on_deadline(self, now: float) -> list[Message]:
        self._finish(self._is_fulfilled())
        return []

    def _is_fulfilled(self) -> bool:
        return self._condition()

    def _check(self) -> list[Message]:
        if self._is_fulfilled():
            self._finish(True)
        return []


def wait(seconds: float) -> WaitUntil:
    """Return a conversation that lets time pass."""
    return WaitUntil(lambda: False, seconds)


class SendUntil(WaitUntil):
    """Send a message at once and repeatedly, until `condition()` holds or `timeout_s` have passed.

    The result is True if the condition holds. No answer to the message is expected.
    """

    REPEAT_PERIOD_S = 0.5

    def __init__(self, message: Message, condition: Callable[[], bool], timeout_s: float) -> None:
        super().__init__(condition, timeout_s)
        self._message = message
        self._end = 0.0

    def _begin(self, now: float) -> list[Message]:
        self._end = now + self._timeout_s
        return self._send(now)

    def _on_deadline(self, now: float) -> list[Message]:
        return super()._on_deadline(now) if now >= self._end else self._send(now)

    def _send(self, now: float) -> list[Message]:
        self.next_deadline = min(self._end, now + self.REPEAT_PERIOD_S)
        return [self._message, *self._check()]


class RequestUntil(SendUntil):
    """Repeated request of a message, until the message has arrived and `condition()` holds.

    The result is True, or False after `timeout_s`. A message counts as arrived only if `counts()` holds then.

    The message is usually a heartbeat, the only message with mode and arming. ArduPilot sends a heartbeat
    soon after MAV_CMD_REQUEST_MESSAGE. Other autopilots send a heartbeat every second anyway.
    """

    REPEAT_PERIOD_S = 1.0

    def __init__(
        self,
        peer: MavlinkPeer,
        condition: Callable[[], bool],
        timeout_s: float,
        message_id: int = mavlink.MAVLINK_MSG_ID_HEARTBEAT,
        counts: Callable[[], bool] = lambda: True,
    ) -> None:
        super().__init__(request_message(peer, message_id), condition, timeout_s)
        self._counts = counts
        self._message_id = message_id
        self._received = False

    def _on_message(self, message: Message, now: float) -> list[Message]:
        self._received = self._received or (message.get_msgId() == self._message_id and self._counts())
        return super()._on_message(message, now)

    def _is_fulfilled(self) -> bool:
        return self._received and super()._is_fulfilled()


class Requests(Conversation[dict[K, A]], Generic[K, A]):
    """Several requests by key, repeated after each second without an answer, at most `tries` times each.

    The result has the last answer of each key; a key without an answer has no entry.

    answer_to: returns key and content of an answer that arrives at a time [s]; None for other messages
    confirms: returns whether an answer ends its request
    max_pending: greatest number of requests under way
    closing: messages that end the exchange on the vehicle
    """

    REPEAT_PERIOD_S = 1.0

    def __init__(
        self,
        requests: Mapping[K, Message],
        answer_to: Callable[[Message, float], tuple[K, A] | None],
        confirms: Callable[[K, A], bool] = lambda _key, _answer: True,
        *,
        tries: float = math.inf,
        max_pending: float = math.inf,
        closing: Sequence[Message] = (),
    ) -> None:
        super().__init__()
        self._requests = requests
        self._closing = closing
        self._answer_to = answer_to
        self._confirms = confirms
        self._tries = tries
        self._max_pending = max_pending
        self._unsent = list(requests)
        self._pending: dict[K, int] = {}
        """number of tries of each unanswered request"""
        self._answers: dict[K, A] = {}

    def _begin(self, now: float) -> list[Message]:
        return self._send_new(now)

    def _on_message(self, message: Message, now: float) -> list[Message]:
        found = self._answer_to(message, now)
        if found is None or found[0] not in self._pending:
            return []
        key, answer = found
        self._answers[key] = answer
        if not self._confirms(key, answer):
            return []
        del self._pending[key]
        return self._send_new(now)

    def _on_deadline(self, now: float) -> list[Message]:
        self._pending = {key: n + 1 for key, n in self._pending.items() if n < self._tries}
        again = [self._requests[key] for key in self._pending]
        return again + self._send_new(now)

    def _closing_messages(self, now: float) -> list[Message]:
        return list(self._closing)

    def _send_new(self, now: float) -> list[Message]:
        """Return new requests while there is room, and restart the wait; end without a pending request."""
        new = []
        while self._unsent and len(self._pending) < self._max_pending:
            new.append(key := self._unsent.pop(0))
            self._pending[key] = 1
        if not self._pending:
            self._finish(self._answers)
            return list(self._closing)
        # A slow vehicle answers one request after the other: earlier repetitions would fill its queue.
        self.next_deadline = now + self.REPEAT_PERIOD_S
        return [self._requests[key] for key in new]


def collect_messages(
    peer: MavlinkPeer, ids: Iterable[int], tries: float = math.inf
) -> Requests[int, tuple[Message, float]]:
    """Return requests of single messages; the result is message id -> (message, time of arrival [s])."""
    requests = {msgid: request_message(peer, msgid) for msgid in ids}
    return Requests(requests, lambda message, now: (message.get_msgId(), (message, now)), tries=tries)


def request_message(peer: MavlinkPeer, message_id: int) -> Message:
    """Return the command that requests one message, MAV_CMD_REQUEST_MESSAGE."""
    return command_long(peer, mavlink.MAV_CMD_REQUEST_MESSAGE, (float(message_id),))
