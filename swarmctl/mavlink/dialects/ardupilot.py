"""ArduPilot 4.x: the common part of ArduCopter and ArduPlane, and ArduCopter.

Facts observed on ArduCopter 4.6.2 in software-in-the-loop.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import trunc
from types import MappingProxyType

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.geo import LatLon
from swarmctl.core.mission import FlightPlan, MissionItem
from swarmctl.core.records import replace
from swarmctl.mavlink.dialects.base import Dialect
from swarmctl.mavlink.dialects.plan import LAND, TAKEOFF, WAYPOINT, copter_track, item_at
from swarmctl.mavlink.protocol.command import Command, CommandResult
from swarmctl.mavlink.protocol.conversation import Conversation, MavlinkPeer

RELATIVE = int(mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT)
HOME_PLACEHOLDER = MissionItem(WAYPOINT, int(mavlink.MAV_FRAME_GLOBAL), 0, 0, 0.0)
"""item 0, which the vehicle overwrites with home; a take-off at item 0 would be lost"""
_STORED_FRAME = MappingProxyType(
    {
        mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT: mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
        mavlink.MAV_FRAME_GLOBAL_INT: mavlink.MAV_FRAME_GLOBAL,
        mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT: mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT,
    }
)
_WITHOUT_POSITION = frozenset(
    {mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH, mavlink.MAV_CMD_DO_JUMP, mavlink.MAV_CMD_DO_CHANGE_SPEED}
)
_CENTIMETRE_M = 0.01


def modes(enum: str) -> Mapping[int, str]:
    """Return the names of a firmware's modes by number (custom_mode)."""
    prefix = f"{enum}_"
    return MappingProxyType(
        {
            number: entry.name.removeprefix(prefix)
            for number, entry in mavlink.enums[enum].items()
            if not entry.name.endswith("ENUM_END")
        }
    )


class ArduPilot(Dialect):
    """Common part of the dialects of ArduPilot."""

    name = "ArduPilot"
    hold_mode = "GUIDED"
    mission_mode = "AUTO"
    return_mode = "RTL"
    land_mode = "LAND"
    mode_names: Mapping[int, str]
    streams_hz: Mapping[int, float] = MappingProxyType(
        {
            mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 4.0,
            mavlink.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
            mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: 1.0,
            mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 1.0,
            mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: 2.0,
            mavlink.MAVLINK_MSG_ID_HOME_POSITION: 0.2,
        }
    )
    first_waypoint_seq = 2
    """after home and the take-off"""
    uncounted_items = 1
    upload_timeout_s = 9.0
    """ArduPilot ends a transfer after 8 s without an item"""
    uploads_atomically = False
    serves_single_items = True
    may_lack_rally = True

    @property
    def start_mission(self) -> tuple[int, tuple[float, ...]]:
        # Without this command, a vehicle armed in AUTO stays on the ground and disarms itself after 10 s.
        return int(mavlink.MAV_CMD_MISSION_START), ()

    def mode_name(self, custom_mode: int) -> str:
        return self.mode_names.get(custom_mode, f"MODE {custom_mode}")

    def mode_params(self, name: str) -> tuple[float, ...]:
        number = next(number for number, mode in self.mode_names.items() if mode == name)
        return float(mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED), float(number)

    def set_current(self, peer: MavlinkPeer, seq: int, attempt: int) -> Conversation[CommandResult]:
        return Command(peer, mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, float(seq), confirmation=attempt)

    def is_same(self, seq: int, sent: MissionItem, found: MissionItem) -> bool:
        if seq == 0:  # the vehicle sets item 0 to home
            return sent.command == found.command
        stored = self.as_stored(sent)
        # ArduPilot cuts altitudes to centimetres in float32: 20.3 m loses a whole centimetre (20.29 m).
        z_loss_m = abs(stored.z) - abs(found.z)
        z_fits = -1e-3 <= z_loss_m <= _CENTIMETRE_M + 1e-3 and stored.z * found.z >= 0
        return z_fits and replace(stored, z=0.0) == replace(self.as_stored(found), z=0.0)

    def as_stored(self, item: MissionItem) -> MissionItem:
        """Return an item as ArduPilot stores it, but with the altitude as sent.

        The frame loses `_INT`, and is 0 for items without a position. A landing's param4 reads back as 1,
        but is set to 0 here.
        """
        frame = _STORED_FRAME.get(item.frame, item.frame) if item.command not in _WITHOUT_POSITION else 0
        item = replace(item, frame=int(frame))
        return replace(item, param4=0.0) if item.command == mavlink.MAV_CMD_NAV_LAND else item


class ArduCopter(ArduPilot):
    """Dialect of ArduCopter."""

    firmware = "ArduCopter"
    # Hold mode is GUIDED: without radio control LOITER reads the throttle stick as "down" and lands hard.
    # BRAKE also holds, but a launch needs GUIDED.
    mode_names = modes("COPTER_MODE")
    setpoint_mode = "GUIDED"
    # A leg that does not follow a completed leg begins at rest, at the stopping point
    # (`AC_WPNav::set_wp_destination`).
    brakes_m_s2 = 2.5  # default of WPNAV_ACCEL
    start_delay_s = 1.9  # with the default of WPNAV_JERK, measured in software
    speed_type = int(mavlink.SPEED_TYPE_GROUNDSPEED)

    def mission_items(self, plan: FlightPlan, start: LatLon | None = None) -> tuple[MissionItem, ...]:
        """Return home placeholder, take-off at the vehicle's position, waypoints, landing."""
        track = copter_track(plan)
        takeoff = MissionItem(TAKEOFF, RELATIVE, 0, 0, plan.takeoff_alt_m)
        waypoints = (item_at(WAYPOINT, RELATIVE, point, point.alt_rel_m) for point in track)
        return (HOME_PLACEHOLDER, takeoff, *waypoints, item_at(LAND, RELATIVE, plan.landing, 0.0))

    def as_stored(self, item: MissionItem) -> MissionItem:
        """Return an item as stored; of its parameters a waypoint keeps only param1, cut to an integer."""
        item = super().as_stored(item)
        if item.command != mavlink.MAV_CMD_NAV_WAYPOINT:
            return item
        return replace(item, param1=float(trunc(item.param1)), param2=0.0, param3=0.0, param4=0.0)
