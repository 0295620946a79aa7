"""Presence of a vehicle from its heartbeats, and the own heartbeat.

https://mavlink.io/en/services/heartbeat.html
"""

from __future__ import annotations

from enum import Enum
from math import inf

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.mavlink.protocol.codec import Message

LOST_AFTER_S = 5.0
"""age of the last heartbeat from which on a vehicle is lost"""
LOST_EVERY_S = 1.0
"""Time between two reports of a lost vehicle [s]."""
AUTOPILOT_COMPID = int(mavlink.MAV_COMP_ID_AUTOPILOT1)
_NO_VEHICLE_TYPES = (
    mavlink.MAV_TYPE_GCS,
    mavlink.MAV_TYPE_ANTENNA_TRACKER,
    mavlink.MAV_TYPE_ONBOARD_CONTROLLER,
    mavlink.MAV_TYPE_GIMBAL,
    mavlink.MAV_TYPE_CAMERA,
    mavlink.MAV_TYPE_ADSB,
)


def is_vehicle_heartbeat(message: Message) -> bool:
    """Return whether a message is an autopilot's heartbeat, not a station's, camera's or companion's."""
    return (
        message.get_type() == "HEARTBEAT"
        and message.get_srcComponent() == AUTOPILOT_COMPID
        and message.autopilot != mavlink.MAV_AUTOPILOT_INVALID
        and message.type not in _NO_VEHICLE_TYPES
    )


def is_armed(heartbeat: Message) -> bool:
    return bool(heartbeat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)


class LinkState(Enum):
    NEVER_HEARD = "never heard"
    ALIVE = "alive"
    LOST = "lost"


class Presence:
    """Presence of a vehicle by the age of its last heartbeat."""

    def __init__(self) -> None:
        self.state = LinkState.NEVER_HEARD
        self._last_heartbeat_s = -inf
        self.next_deadline: float | None = None
        """time of the next `tick` that reports the vehicle as lost [s]; None before its first heartbeat"""

    def age_s(self, now: float) -> float:
        """Return the time since the last heartbeat [s]; infinite before the first."""
        return now - self._last_heartbeat_s

    def on_heartbeat(self, now: float) -> LinkState:
        """Record a heartbeat; return the state before the heartbeat."""
        before, self.state, self._last_heartbeat_s = self.state, LinkState.ALIVE, now
        self.next_deadline = now + LOST_AFTER_S
        return before

    def tick(self, now: float) -> bool:
        """Return whether the vehicle is lost, once when it becomes so, then every LOST_EVERY_S."""
        if self.next_deadline is None or now < self.next_deadline:
            return False
        self.state, self.next_deadline = LinkState.LOST, now + LOST_EVERY_S
        return True


HEARTBEAT_PERIOD_S = 1.0


def own_heartbeat() -> Message:
    """Return the heartbeat of a ground station, due every `HEARTBEAT_PERIOD_S`."""
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
    )
