"""The vehicle's clock against this program's: the age of the newest telemetry.

Telemetry may be late on the link, or wait in this program's own inbox; the time of its receipt shows neither.
The time since boot in each message does, if the offset of the two clocks is known. Each receipt is an upper
bound of the offset, because no message arrives before it is sent. Each answer to a TIMESYNC is a lower bound,
because no question is answered before it is asked. https://mavlink.io/en/services/timesync.html
By the receipts alone, telemetry of a vehicle with a slow clock would look ever older.
"""

from __future__ import annotations

import math
from collections import deque
from itertools import pairwise

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.mavlink.protocol.codec import Message

ASK_FROM_S = 1.0
"""Least age of the newest telemetry for a question. A simulator slower than real time also makes telemetry
look old; its answers show that it is not."""
ASK_FROM_DELAY_S = 0.1
"""Least delay of a message, at its receipt, for a question. Positions are predicted by their age, so a clock
that is slow, as a simulator's on a busy machine, costs a metre at 10 m/s until its next answer."""
ASK_PERIOD_S = 1.0
N_INTERVALS = 9
"""number of last intervals between messages"""
N_ASKED = 64
"""greatest number of questions whose answers count"""


class VehicleClock:
    """Clock of one vehicle, from its messages and its answers; all times in seconds."""

    def __init__(self) -> None:
        self._offset_s = math.inf
        """this program's clock less the vehicle's"""
        self._newest_s: float | None = None
        """latest time of the vehicle's clock in a message"""
        self._newest_received_s = -math.inf
        self._sent_s: deque[float] = deque(maxlen=N_INTERVALS + 1)
        """times of the last messages, by the vehicle's clock"""
        self._asked_ns: list[int] = []
        self._next_question_s = -math.inf

    def restart(self) -> None:
        """Forget the offset and the unanswered questions, after a reboot of the vehicle."""
        self._offset_s, self._newest_s = math.inf, None
        self._asked_ns.clear()
        self._sent_s.clear()

    def receive(self, boot_s: float, now: float) -> None:
        """Record a message from `boot_s` of the vehicle's clock."""
        self._offset_s = min(self._offset_s, now - boot_s)
        if self._newest_s is None or boot_s > self._newest_s:
            self._newest_s, self._newest_received_s = boot_s, now
            self._sent_s.append(boot_s)

    def receive_answer(self, message: Message, now: float) -> None:
        """Record a TIMESYNC, if it answers a question of this clock."""
        if message.tc1 == 0 or message.ts1 not in self._asked_ns:
            return
        boot_s = message.tc1 / 1e9
        self._offset_s = max(self._offset_s, message.ts1 / 1e9 - boot_s)
        self.receive(boot_s, now)

    def age_s(self, now: float, boot_s: float | None = None) -> float:
        """Return the age of the newest message, or of a message from `boot_s`; 0 before the first message."""
        sent_s = self._newest_s if boot_s is None else boot_s
        return 0.0 if sent_s is None else max(now - sent_s - self._offset_s, 0.0)

    def is_old(self, now: float, limit_s: float) -> bool:
        """Return whether the newest message is older than `limit_s` and the usual interval of messages."""
        age_s = self.age_s(now)
        return age_s > limit_s and age_s > limit_s + self._usual_interval_s()

    def _usual_interval_s(self) -> float:
        """Return the median interval of the last messages, by the vehicle's clock; 0 before the second."""
        intervals_s = sorted(later - earlier for earlier, later in pairwise(self._sent_s))
        return intervals_s[len(intervals_s) // 2] if intervals_s else 0.0

    def questions(self, now: float) -> list[Message]:
        """Return a TIMESYNC if the newest message is old or was late, at most one a second."""
        if now < self._next_question_s:
            return []
        if self.age_s(self._newest_received_s) < ASK_FROM_DELAY_S and not self.is_old(now, ASK_FROM_S):
            return []
        self._next_question_s = now + ASK_PERIOD_S
        asked_ns = round(now * 1e9)
        self._asked_ns = [*self._asked_ns, asked_ns][-N_ASKED:]
        return [mavlink.MAVLink_timesync_message(0, asked_ns)]
