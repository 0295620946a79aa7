"""Conversion of mission items, counts and acknowledgements to messages, and of messages to items."""

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.definitions import DefinedMessage, Layout, layout_of
from sim_vehicle.vehicle.mission import Item

MissionPeer = tuple[int, int]  # system and component id of a ground station

MISSION = int(mavlink.MAV_MISSION_TYPE_MISSION)
FENCE = int(mavlink.MAV_MISSION_TYPE_FENCE)
RALLY = int(mavlink.MAV_MISSION_TYPE_RALLY)
ALL = int(mavlink.MAV_MISSION_TYPE_ALL)

# Commands with other numbers than coordinates in x and y, which the legacy MISSION_ITEM does not scale.
_NO_COORDINATES = frozenset(
    {
        mavlink.MAV_CMD_DO_DIGICAM_CONTROL,
        mavlink.MAV_CMD_DO_DIGICAM_CONFIGURE,
        mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW,
        mavlink.MAV_CMD_NAV_ATTITUDE_TIME,
    }
)
_ACK, _COUNT = (
    layout_of(number) for number in (mavlink.MAVLINK_MSG_ID_MISSION_ACK, mavlink.MAVLINK_MSG_ID_MISSION_COUNT)
)


def ack_message(peer: MissionPeer, result: int, kind: int, opaque_id: int = 0) -> Any:
    """Return MISSION_ACK with a MAV_MISSION_RESULT."""
    return _for_peer(_ACK, peer, type=result, mission_type=kind, opaque_id=opaque_id)


def count_message(peer: MissionPeer, count: int, kind: int, opaque_id: int = 0) -> Any:
    return _for_peer(_COUNT, peer, count=count, mission_type=kind, opaque_id=opaque_id)


def _for_peer(layout: Layout, peer: MissionPeer, **fields: int) -> DefinedMessage:
    system, component = peer
    return DefinedMessage(layout, target_system=system, target_component=component, **fields)


def item_from_message(message: Any) -> Item | None:
    """Return the item of MISSION_ITEM_INT or of the legacy MISSION_ITEM; None for invalid coordinates."""
    x, y = message.x, message.y
    if message.get_type() == "MISSION_ITEM":
        if not (math.isfinite(x) and math.isfinite(y)):
            return None
        if message.frame != mavlink.MAV_FRAME_MISSION and message.command not in _NO_COORDINATES:
            x, y = x * 1e7, y * 1e7
        if max(abs(x), abs(y)) > 2**31 - 1:
            return None
        x, y = round(x), round(y)
    return Item(
        command=message.command,
        frame=message.frame,
        param1=message.param1,
        param2=message.param2,
        param3=message.param3,
        param4=message.param4,
        x=x,
        y=y,
        z=message.z,
        autocontinue=message.autocontinue != 0,
    )


def item_message(
    peer: MissionPeer,
    seq: int,
    item: Item,
    kind: int,
    *,
    as_int: bool,
    current: bool = False,
    autocontinue: int = 1,
) -> Any:
    """Return MISSION_ITEM_INT, or the legacy MISSION_ITEM, for a ground station."""
    head = (*peer, seq, item.frame, item.command, int(current), autocontinue)
    parameters = (item.param1, item.param2, item.param3, item.param4)
    if as_int:
        return mavlink.MAVLink_mission_item_int_message(*head, *parameters, item.x, item.y, item.z, kind)
    scaled = item.frame != mavlink.MAV_FRAME_MISSION and item.command not in _NO_COORDINATES
    x, y = (item.x * 1e-7, item.y * 1e-7) if scaled else (float(item.x), float(item.y))
    return mavlink.MAVLink_mission_item_message(*head, *parameters, x, y, item.z, kind)
