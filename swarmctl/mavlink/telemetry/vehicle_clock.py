"""The vehicle's clock against this program's: the age of the newest telemetry, and reboots.

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
REBOOT_STEP_S = 3.0
"""greatest step back of the vehicle's clock by a late datagram; a larger step is a reboot"""
LATE_MESSAGE_S = 1.0
"""Margin for late messages. A vehicle has rebooted if its time since boot is shorter than the time since the
previous message of its clock, by more than this margin."""
CONTINUES_S = 0.5
"""greatest step of the vehicle's clock between two messages of a vehicle that has not rebooted"""
CLOCK_WRAP_S = 2**32 / 1000.0
"""period of time_boot_ms, which has 32 bits: 49.7 days"""
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
        self._reported_s = 0.0
        """time of the vehicle's clock in the last message that `read` has read"""
        self._read_s: float | None = None
        """receipt of that message"""
        self._wraps_s = 0.0
        """time in completed periods of `time_boot_ms`"""

    def read(self, message: Message, now: float, last_s: float) -> tuple[float, bool]:
        """Record a message with a clock; return its time since boot [s], and whether it shows a reboot.

        last_s: time since boot in the vehicle's state, which a late message does not set back
        """
        boot_s = self._across_wraps_s(float(message.time_boot_ms) / 1000.0, now)
        last_wrap_s = self._reported_s // CLOCK_WRAP_S * CLOCK_WRAP_S
        went_back = boot_s < last_s - REBOOT_STEP_S
        ran_s = boot_s - last_wrap_s  # below 0: late message from before the wrap
        # A clock that continues belongs to a message that has waited somewhere.
        continues = 0.0 <= boot_s - self._reported_s <= CONTINUES_S
        waited_s = 0.0 if self._read_s is None or continues else now - self._read_s - LATE_MESSAGE_S
        has_rebooted = went_back or 0.0 <= ran_s < waited_s
        if has_rebooted:
            boot_s, self._wraps_s = boot_s - self._wraps_s, 0.0
            self._offset_s, self._newest_s = math.inf, None
            self._asked_ns.clear()
            self._sent_s.clear()
        self._reported_s, self._read_s = boot_s, now
        self.receive(boot_s, now)
        return boot_s, has_rebooted

    def _across_wraps_s(self, reported_s: float, now: float) -> float:
        """Return the time since boot, also across the wraps of `time_boot_ms` after 49.7 days each.

        A restarted clock has wrapped if the local clock expects a wrap; otherwise the vehicle has rebooted.
        """
        boot_s = reported_s + self._wraps_s
        if self._wraps_s and boot_s - self._reported_s > CLOCK_WRAP_S / 2.0:
            return boot_s - CLOCK_WRAP_S  # late message from before the wrap
        if self._read_s is not None:
            ran_s = boot_s + CLOCK_WRAP_S - self._reported_s
            if abs(ran_s - (now - self._read_s)) <= REBOOT_STEP_S:
                self._wraps_s += CLOCK_WRAP_S
                return boot_s + CLOCK_WRAP_S
        return boot_s

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
