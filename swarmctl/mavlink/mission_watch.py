"""Whether the mission on a vehicle is still the one that was put there, by how many items it says there are.

https://mavlink.io/en/messages/common.html#MISSION_CURRENT: `total` is 0 where it is not supported, and 65535
where there is no mission. Another mission of as many items is not noticed.
"""

from __future__ import annotations

from swarmctl.mavlink.codec import Message

SETTLES_S = 2.0
"""What is said within this after a procedure of ours may be of before."""
LASTS_S = 1.0
"""One message may have been overtaken; it comes twice a second."""


class MissionWatch:
    """Told each MISSION_CURRENT that comes while nothing of ours runs."""

    def __init__(self) -> None:
        self._quiet_until_s = 0.0
        self._other_since_s: float | None = None

    def own_procedure_ended(self, now: float) -> None:
        self._quiet_until_s, self._other_since_s = now + SETTLES_S, None

    def is_another(self, message: Message, expected: int, now: float) -> bool:
        """Whether it has told for a while that it holds another number of items than `expected`."""
        if now < self._quiet_until_s or int(message.total) in (0, expected):
            self._other_since_s = None
            return False
        if self._other_since_s is None:
            self._other_since_s = now
        return now - self._other_since_s >= LASTS_S
