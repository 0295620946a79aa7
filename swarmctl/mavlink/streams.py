"""Asking for telemetry until it comes, and again when it stays away (after a reboot, or a lost request)."""

from __future__ import annotations

from collections.abc import Mapping

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.mavlink.codec import Message
from swarmctl.mavlink.command import command_long
from swarmctl.mavlink.conversation import Peer

_PATIENCE_S = 3.0
_PATIENCE_LIMIT_S = 30.0
AFTER_SILENCE_S = 1.5
"""a vehicle that is heard again may have rebooted, or just go on"""


class StreamKeeper:
    """Keeps the periodic messages `rates_hz` (message id -> rate) coming.

    Requests are not followed up by their acknowledgements: what counts is whether the message comes.
    A message that never comes is asked for ever more seldom, some firmwares do not have it.
    """

    def __init__(self, peer: Peer, rates_hz: Mapping[int, float]) -> None:
        self._peer = peer
        self._rates_hz = rates_hz
        self._due: dict[int, float] = {}
        self._patience_s = dict.fromkeys(rates_hz, _PATIENCE_S)

    @property
    def next_deadline(self) -> float | None:
        return min(self._due.values(), default=None)

    def demand(self, due: float) -> None:
        """Ask at `due` for everything that has not come by then: at the start, after a reboot or silence."""
        for msgid in self._rates_hz:
            self._due[msgid] = due
            self._patience_s[msgid] = _PATIENCE_S

    def saw(self, msgid: int, now: float) -> None:
        if msgid in self._due:
            self._patience_s[msgid] = _PATIENCE_S
            self._due[msgid] = now + max(_PATIENCE_S, 3.0 / self._rates_hz[msgid])

    def tick(self, now: float) -> list[Message]:
        missing = [msgid for msgid, due in self._due.items() if now >= due]
        for msgid in missing:
            self._due[msgid] = now + max(self._patience_s[msgid], 3.0 / self._rates_hz[msgid])
            self._patience_s[msgid] = min(2 * self._patience_s[msgid], _PATIENCE_LIMIT_S)
        return [self._request(msgid) for msgid in missing]

    def _request(self, msgid: int) -> Message:
        interval_us = 1e6 / self._rates_hz[msgid]
        return command_long(
            self._peer, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, (float(msgid), float(round(interval_us)))
        )
