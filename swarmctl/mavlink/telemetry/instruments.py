"""Instruments of a vehicle, read by the preflight check.

https://mavlink.io/en/messages/common.html: GPS_RAW_INT, SYSTEM_TIME, HOME_POSITION, SYS_STATUS. The request
of HOME_POSITION and SYS_STATUS brings recent values into the vehicle's state.
"""

from __future__ import annotations

from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.mavlink.protocol.codec import Message
from swarmctl.mavlink.protocol.command import command_long
from swarmctl.mavlink.protocol.conversation import Conversation, ConversationState, MavlinkPeer
from swarmctl.mavlink.protocol.procedure import Context, Procedure
from swarmctl.mavlink.protocol.wait import WaitUntil

REQUESTED_IDS = (
    int(mavlink.MAVLINK_MSG_ID_GPS_RAW_INT),
    int(mavlink.MAVLINK_MSG_ID_SYSTEM_TIME),
    int(mavlink.MAVLINK_MSG_ID_HOME_POSITION),
    int(mavlink.MAVLINK_MSG_ID_SYS_STATUS),
)
POSITIONS_WAIT_S = 5.0
"""longest wait for positions of a vehicle that has just begun to send them"""
_UNKNOWN_HDOP = 0xFFFF
_UNKNOWN_SATELLITES = 0xFF


@dataclass(frozen=True, slots=True)
class GpsFix:
    """GPS_RAW_INT; None: not reported by the receiver."""

    fix_type: int
    """GPS_FIX_TYPE: 3 and more is a position in three dimensions"""
    satellites: int | None
    hdop: float | None
    """horizontal dilution of precision"""


@dataclass(frozen=True, slots=True)
class Instruments:
    """Readings of a vehicle's instruments; None: not received in time."""

    gps: GpsFix | None
    unix_s: float | None
    """the vehicle's clock (SYSTEM_TIME) since 1970 [s]; None also before the first GPS fix"""
    unix_received_s: float | None
    """arrival time of the SYSTEM_TIME message, by the event loop's clock [s]"""
    position_every_s: float | None = None
    """mean time between the last positions [s]; None: too few positions in time"""


class CollectMessages(Conversation[dict[int, tuple[Message, float]]]):
    """Request of some messages (MAV_CMD_REQUEST_MESSAGE), at most TRIES times each.

    The result is message id -> (message, arrival time [s]); a message that did not arrive has no entry.
    """

    REPEAT_PERIOD_S = 1.0
    TRIES = 5

    def __init__(self, peer: MavlinkPeer, ids: tuple[int, ...]) -> None:
        super().__init__()
        self._peer = peer
        self._ids = ids
        self._received: dict[int, tuple[Message, float]] = {}
        self._tries = 0

    def _begin(self, now: float) -> list[Message]:
        self._enter(ConversationState.EXCHANGING)
        return self._ask(now)

    def _ask(self, now: float) -> list[Message]:
        self._tries += 1
        self.next_deadline = now + self.REPEAT_PERIOD_S
        missing = [msgid for msgid in self._ids if msgid not in self._received]
        return [
            command_long(self._peer, mavlink.MAV_CMD_REQUEST_MESSAGE, (float(msgid),)) for msgid in missing
        ]

    def _on_message(self, message: Message, now: float) -> list[Message]:
        msgid = int(message.get_msgId())
        if msgid in self._ids:
            self._received[msgid] = (message, now)
            if len(self._received) == len(self._ids):
                self._finish(self._received)
        return []

    def _on_deadline(self, now: float) -> list[Message]:
        if self._tries < self.TRIES:
            return self._ask(now)
        self._finish(self._received)
        return []


def read_instruments(ctx: Context) -> Procedure[Instruments]:
    """Request the instruments; return the readings that arrive in time."""
    received: dict[int, tuple[Message, float]] = yield CollectMessages(ctx.peer, REQUESTED_IDS)
    gps = received.get(int(mavlink.MAVLINK_MSG_ID_GPS_RAW_INT))
    clock = received.get(int(mavlink.MAVLINK_MSG_ID_SYSTEM_TIME))
    fix = None if gps is None else _fix(gps[0])
    yield WaitUntil(lambda: ctx.telemetry.position_every_s(ctx.now) is not None, POSITIONS_WAIT_S)
    every_s = ctx.telemetry.position_every_s(ctx.now)
    if clock is None or clock[0].time_unix_usec == 0:
        return Instruments(fix, None, None, every_s)
    return Instruments(fix, clock[0].time_unix_usec / 1e6, clock[1], every_s)


def _fix(message: Message) -> GpsFix:
    satellites, eph = int(message.satellites_visible), int(message.eph)
    return GpsFix(
        int(message.fix_type),
        None if satellites == _UNKNOWN_SATELLITES else satellites,
        None if eph == _UNKNOWN_HDOP else eph / 100.0,
    )
