"""How one vehicle speaks: acknowledgements, texts in its personality's words, and what faults do to both."""

import heapq
import math
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.epoch import EPSILON_S
from sim_vehicle.personalities.base import Personality
from sim_vehicle.vehicle.injected_faults import Afflictions

TEXT_BYTES = 50  # of one STATUSTEXT
ACKNOWLEDGEMENTS = frozenset({mavlink.MAVLINK_MSG_ID_COMMAND_ACK, mavlink.MAVLINK_MSG_ID_MISSION_ACK})


class Voice:
    """Sends messages by `send`; `clock` is the vehicle's present time [s], `record` takes every text."""

    def __init__(
        self,
        personality: Personality,
        afflictions: Afflictions,
        *,
        send: Callable[[Any], None],
        clock: Callable[[], float],
        record: Callable[[float, int, str], None],
    ) -> None:
        self._personality, self._afflictions = personality, afflictions
        self._send, self._clock, self._record = send, clock, record
        # Acknowledgements that a fault holds back: until when, their number, themselves; a heap.
        self._late: list[tuple[float, int, Any]] = []
        self._held_back = 0
        self._text_id = 0

    def reset(self) -> None:
        """The vehicle rebooted."""
        self._late.clear()

    @property
    def next_s(self) -> float:
        """When `send_late` has something to do [s]."""
        return self._late[0][0] if self._late else math.inf

    def send(self, message: Any) -> None:
        """Send one message to whoever is there; faults may hold or lose an acknowledgement."""
        if message.get_msgId() in ACKNOWLEDGEMENTS:
            if self._afflictions.loses_ack():
                return
            if self._afflictions.ack_delay_s > 0:
                due_s = self._clock() + self._afflictions.ack_delay_s
                heapq.heappush(self._late, (due_s, self._held_back, message))
                self._held_back += 1
                return
        self._send(message)

    def say(self, severity: int, text: str) -> None:
        """STATUSTEXT; a long one in several, which a ground station puts together by their id."""
        self._record(self._clock(), severity, text)
        data = text.encode()
        if len(data) <= TEXT_BYTES:
            self.send(mavlink.MAVLink_statustext_message(severity, data))
            return
        self._text_id = self._text_id % 0xFFFF + 1
        for chunk, start in enumerate(range(0, len(data) + 1, TEXT_BYTES)):
            part = data[start : start + TEXT_BYTES]
            self.send(mavlink.MAVLink_statustext_message(severity, part, self._text_id, chunk))

    def tell(self, what: str, **facts: Any) -> None:
        """Say something in the personality's words, if it says anything about it."""
        if what in self._personality.texts:
            severity, template = self._personality.texts[what]
            self.say(severity, template.format(**facts))

    def wording(self, what: str, **facts: Any) -> list[str]:
        """The personality's words for something, to be said with something else; empty if it has none."""
        if what not in self._personality.texts:
            return []
        return [self._personality.texts[what][1].format(**facts)]

    def acknowledge(self, command: int, result: int, progress: int, sender: tuple[int, int]) -> None:
        """COMMAND_ACK."""
        self.send(mavlink.MAVLink_command_ack_message(command, result, progress, 0, *sender))

    def send_late(self, now: float) -> None:
        """Send what a fault has held back until `now` [s]."""
        while self._late and self._late[0][0] <= now + EPSILON_S:
            self._send(heapq.heappop(self._late)[2])
