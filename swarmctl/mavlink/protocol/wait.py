"""Conversations that wait: for a condition, with or without requests, or for messages."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.mavlink.protocol.codec import Message
from swarmctl.mavlink.protocol.command import command_long
from swarmctl.mavlink.protocol.conversation import Conversation, MavlinkPeer


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


class CollectMessages(Conversation[dict[int, tuple[Message, float]]]):
    """Request of some messages (MAV_CMD_REQUEST_MESSAGE), at most `tries` times each.

    The result is message id -> (message, arrival time [s]); a message that did not arrive has no entry.
    """

    REPEAT_PERIOD_S = 1.0

    def __init__(self, peer: MavlinkPeer, ids: Iterable[int], tries: float = math.inf) -> None:
        super().__init__()
        self._requests = {msgid: request_message(peer, msgid) for msgid in ids}
        """requests of the messages that have not arrived, by message id"""
        self._received: dict[int, tuple[Message, float]] = {}
        self._tries_left = tries

    def _begin(self, now: float) -> list[Message]:
        return self._on_deadline(now)

    def _on_message(self, message: Message, now: float) -> list[Message]:
        if self._requests.pop(message.get_msgId(), None) is not None:
            self._received[message.get_msgId()] = message, now
        if not self._requests:
            self._finish(self._received)
        return []

    def _on_deadline(self, now: float) -> list[Message]:
        if self._tries_left == 0:
            self._finish(self._received)
            return []
        self._tries_left -= 1
        self.next_deadline = now + self.REPEAT_PERIOD_S
        return list(self._requests.values())


def request_message(peer: MavlinkPeer, message_id: int) -> Message:
    """Return the command that requests one message, MAV_CMD_REQUEST_MESSAGE."""
    return command_long(peer, mavlink.MAV_CMD_REQUEST_MESSAGE, (float(message_id),))
