"""Sender of one vehicle: messages, the personality's texts, and delayed or lost acknowledgements."""

import heapq
import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.epoch import EPSILON_S
from sim_vehicle.vehicle.interface import Vehicle
from sim_vehicle.wire.outbox import Outbox

TEXT_BYTES = 50  # largest length of the text in one STATUSTEXT
ACKNOWLEDGEMENTS = frozenset({mavlink.MAVLINK_MSG_ID_COMMAND_ACK, mavlink.MAVLINK_MSG_ID_MISSION_ACK})


class Sender:
    """Sender of one vehicle's messages to the fleet's `output`."""

    def __init__(self, vehicle: Vehicle, output: Outbox) -> None:
        self._vehicle, self._output = vehicle, output
        self._texts, self._injected_faults = vehicle.personality.telemetry.texts, vehicle.injected_faults
        # Heap of acknowledgements that a fault delays: due time [s], number, message.
        self._delayed: list[tuple[float, int, Any]] = []
        self._delayed_count = 0
        self._text_id = 0

    def reset(self) -> None:
        """Drop delayed acknowledgements, as a reboot does."""
        self._delayed.clear()

    @property
    def next_s(self) -> float:
        """Time of the next delayed acknowledgement [s]; inf: none is delayed."""
        return self._delayed[0][0] if self._delayed else math.inf

    def send(self, message: Any) -> None:
        """Send one message; faults can delay or drop an acknowledgement."""
        if message.get_msgId() in ACKNOWLEDGEMENTS:
            if self._injected_faults.loses_ack():
                return
            if self._injected_faults.effect.ack_delay_s > 0:
                due_s = self._vehicle.now + self._injected_faults.effect.ack_delay_s
                heapq.heappush(self._delayed, (due_s, self._delayed_count, message))
                self._delayed_count += 1
                return
        self._output.message(self._vehicle.index, message)

    def send_text(self, severity: int, text: str) -> None:
        """Send a text as STATUSTEXT; split a text of more than TEXT_BYTES into chunks with a common id."""
        self._vehicle.storage.text(self._vehicle.now, severity, text)
        data = text.encode()
        if len(data) <= TEXT_BYTES:
            self.send(mavlink.MAVLink_statustext_message(severity, data))
            return
        self._text_id = self._text_id % 0xFFFF + 1
        for chunk, start in enumerate(range(0, len(data) + 1, TEXT_BYTES)):
            part = data[start : start + TEXT_BYTES]
            self.send(mavlink.MAVLink_statustext_message(severity, part, self._text_id, chunk))

    def announce(self, event: str, **values: Any) -> None:
        """Send the personality's text for an event, if the personality has a text."""
        if event in self._texts:
            severity, template = self._texts[event]
            self.send_text(severity, template.format(**values))

    def texts_for(self, event: str, **values: Any) -> list[str]:
        """Return a list with the personality's text for an event, or an empty list."""
        if event not in self._texts:
            return []
        return [self._texts[event][1].format(**values)]

    def acknowledge(self, command: int, result: int, progress: int, target: tuple[int, int]) -> None:
        """Send COMMAND_ACK to `target` (system id, component id)."""
        self.send(mavlink.MAVLink_command_ack_message(command, result, progress, 0, *target))

    def send_delayed(self, now: float) -> None:
        """Send the delayed acknowledgements due by `now` [s]."""
        while self._delayed and self._delayed[0][0] <= now + EPSILON_S:
            self._output.message(self._vehicle.index, heapq.heappop(self._delayed)[2])
