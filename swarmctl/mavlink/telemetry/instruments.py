"""Instruments of a vehicle, read by the preflight check.

https://mavlink.io/en/messages/common.html: GPS_RAW_INT, SYSTEM_TIME, HOME_POSITION, SYS_STATUS. The request
of HOME_POSITION and SYS_STATUS brings recent values into the vehicle's state.
"""

from __future__ import annotations

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.mavlink.protocol.codec import Message
from swarmctl.mavlink.protocol.procedure import Context, Procedure
from swarmctl.mavlink.protocol.wait import WaitUntil, collect_messages

REQUESTED_IDS = (
    int(mavlink.MAVLINK_MSG_ID_GPS_RAW_INT),
    int(mavlink.MAVLINK_MSG_ID_SYSTEM_TIME),
    int(mavlink.MAVLINK_MSG_ID_HOME_POSITION),
    int(mavlink.MAVLINK_MSG_ID_SYS_STATUS),
)
TRIES = 5
"""greatest number of requests of each message"""
POSITIONS_WAIT_S = 5.0
"""longest wait for positions of a vehicle that has just begun to send them"""
_UNKNOWN_HDOP = 0xFFFF
_UNKNOWN_SATELLITES = 0xFF


class GpsFix(msgspec.Struct, frozen=True):
    """GPS_RAW_INT; None: not reported by the receiver."""

    fix_type: int
    """GPS_FIX_TYPE: 3 and more is a position in three dimensions"""
    satellites: int | None
    hdop: float | None
    """horizontal dilution of precision"""


class Instruments(msgspec.Struct, frozen=True):
    """Readings of a vehicle's instruments; None: not received in time."""

    gps: GpsFix | None
    unix_s: float | None
    """the vehicle's clock (SYSTEM_TIME) since 1970 [s]; None also before the first GPS fix"""
    unix_received_s: float | None
    """arrival time of the SYSTEM_TIME message, by the event loop's clock [s]"""
    position_every_s: float | None = None
    """mean time between the last positions [s]; None: too few positions in time"""


def read_instruments(ctx: Context) -> Procedure[Instruments]:
    """Request the instruments; return the readings that arrive in time."""
    received: dict[int, tuple[Message, float]] = yield collect_messages(ctx.peer, REQUESTED_IDS, TRIES)
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
