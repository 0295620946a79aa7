"""PX4 1.15: the common part of multicopters and fixed wings, and multicopters.

Facts observed in software-in-the-loop and read in PX4's sources.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from types import MappingProxyType

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.geo import LatLon
from swarmctl.core.mission import FlightPlan, MissionItem, Waypoint
from swarmctl.core.records import replace
from swarmctl.mavlink.dialects.base import Dialect
from swarmctl.mavlink.dialects.plan import LAND, TAKEOFF, WAYPOINT, copter_track, item_at
from swarmctl.mavlink.protocol.command import CommandResult, SetCurrent
from swarmctl.mavlink.protocol.conversation import Conversation, MavlinkPeer

_AUTO_MAIN_MODE = 4
# Main and sub mode; custom_mode is sub << 24 | main << 16.
_MODES: Mapping[str, tuple[int, int]] = MappingProxyType(
    {
        "MANUAL": (1, 0),
        "ALTCTL": (2, 0),
        "POSCTL": (3, 0),
        "POSCTL.ORBIT": (3, 1),
        "POSCTL.SLOW": (3, 2),
        "AUTO.READY": (_AUTO_MAIN_MODE, 1),
        "AUTO.TAKEOFF": (_AUTO_MAIN_MODE, 2),
        "AUTO.LOITER": (_AUTO_MAIN_MODE, 3),
        "AUTO.MISSION": (_AUTO_MAIN_MODE, 4),
        "AUTO.RTL": (_AUTO_MAIN_MODE, 5),
        "AUTO.LAND": (_AUTO_MAIN_MODE, 6),
        "AUTO.FOLLOW_TARGET": (_AUTO_MAIN_MODE, 8),
        "AUTO.PRECLAND": (_AUTO_MAIN_MODE, 9),
        "ACRO": (5, 0),
        "OFFBOARD": (6, 0),
        "STABILIZED": (7, 0),
        "TERMINATION": (10, 0),
    }
)
_NAMES: Mapping[tuple[int, int], str] = MappingProxyType({numbers: name for name, numbers in _MODES.items()})

RELATIVE = int(mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)
_READ_BACK_FRAME = MappingProxyType(
    {
        mavlink.MAV_FRAME_GLOBAL: mavlink.MAV_FRAME_GLOBAL_INT,
        mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT: mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
    }
)


class Px4(Dialect):
    """Common part of the dialects of PX4."""

    name = "PX4"
    # POSCTL and ALTCTL need a pilot's stick and are refused in the air without a stick.
    hold_mode = "AUTO.LOITER"
    mission_mode = "AUTO.MISSION"
    return_mode = "AUTO.RTL"
    # PX4 sends all these messages without a request, some at lower rates.
    streams_hz: Mapping[int, float] = MappingProxyType(
        {
            mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 5.0,
            mavlink.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
            mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 1.0,
            mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: 2.0,
            mavlink.MAVLINK_MSG_ID_HOME_POSITION: 0.5,
        }
    )
    first_seq = 0
    """PX4 begins at the current item, which landings and uploads do not reset"""
    first_waypoint_seq = 1
    """after the take-off; there is no home placeholder"""
    upload_timeout_s = 6.0
    """PX4 ends a transfer silently after 5 s without an item"""
    uploads_atomically = True
    flies_stored_within_m = 900.0
    """MIS_DIST_1WP of 1.14 and 1.15; preflight asks for this value at least"""
    serves_single_items = False
    """PX4 answers such requests by an error text to all stations"""

    @property
    def start_mission(self) -> tuple[int, tuple[float, ...]]:
        # An armed vehicle takes off when mission mode is set.
        return int(mavlink.MAV_CMD_DO_SET_MODE), self.mode_params(self.mission_mode)

    def mode_name(self, custom_mode: int) -> str:
        main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
        return _NAMES.get((main, sub), f"MODE {main}/{sub}")

    def mode_params(self, name: str) -> tuple[float, ...]:
        main, sub = _MODES[name]
        return float(mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED), float(main), float(sub)

    def is_same(self, seq: int, sent: MissionItem, found: MissionItem) -> bool:
        """Return whether the items are equal; PX4 stores items as sent, but frames read back as `_INT`."""
        z_fits = abs(sent.z - found.z) <= _FLOAT32_M
        return z_fits and _params(sent) == _params(found) and _exact_fields(sent) == _exact_fields(found)

    def set_current(self, peer: MavlinkPeer, seq: int, attempt: int) -> Conversation[CommandResult]:
        """Return one try of MISSION_SET_CURRENT: PX4 lacks MAV_CMD_DO_SET_MISSION_CURRENT."""
        return SetCurrent(peer, seq)


class Px4Copter(Px4):
    """Dialect of PX4 multicopters."""

    firmware = "PX4"
    land_mode = "AUTO.LAND"
    setpoint_mode = "OFFBOARD"
    start_delay_s = 0.2  # with the default of MPC_JERK_AUTO, measured in software
    speed_type = int(mavlink.SPEED_TYPE_GROUNDSPEED)

    def mission_items(self, plan: FlightPlan, start: LatLon | None = None) -> tuple[MissionItem, ...]:
        """Return take-off, waypoints, landing.

        The take-off item needs a position, because the vehicle moves there after its climb.

        No item sets a heading (param4 is NaN). With 0 the vehicle would face north on its whole mission, and
        would pass a waypoint only with that heading (`MissionBlock::is_mission_item_reached_or_completed`).
        """
        track = copter_track(plan)
        if start is None:
            raise ValueError(
                "the take-off needs the vehicle's position, but none has been received [no-position]"
            )
        above = Waypoint(*start, plan.takeoff_alt_m)
        takeoff = item_at(TAKEOFF, RELATIVE, above, plan.takeoff_alt_m)
        waypoints = (item_at(WAYPOINT, RELATIVE, point, point.alt_rel_m) for point in track)
        items = (takeoff, *waypoints, item_at(LAND, RELATIVE, plan.landing, 0.0))
        return tuple(replace(item, param4=math.nan) for item in items)


_FLOAT32_M = 1e-3
"""tolerance of altitudes, which travel as float32"""


def _params(item: MissionItem) -> tuple[bytes | None, ...]:
    """Return the bytes of param1 to param4; None for a NaN, whose bits may change."""
    params = (item.param1, item.param2, item.param3, item.param4)
    return tuple(None if math.isnan(value) else struct.pack("<f", value) for value in params)


def _exact_fields(item: MissionItem) -> tuple[int, int, int, int, int]:
    frame = int(_READ_BACK_FRAME.get(item.frame, item.frame))
    return item.command, frame, item.x, item.y, item.autocontinue
