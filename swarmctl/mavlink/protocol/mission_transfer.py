"""Base of the conversations about a list of items on a vehicle: https://mavlink.io/en/services/mission.html"""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar, TypeVar

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.mission import MissionItem
from swarmctl.mavlink.protocol.codec import Message
from swarmctl.mavlink.protocol.command import name_of
from swarmctl.mavlink.protocol.conversation import Conversation, MavlinkPeer

MISSION = int(mavlink.MAV_MISSION_TYPE_MISSION)

R = TypeVar("R")


class MissionTransfer(Conversation[R]):
    """Conversation about the list of one MAV_MISSION_TYPE."""

    REPLIES: ClassVar[frozenset[str]]
    """types of the vehicle's messages in this conversation"""

    def __init__(self, peer: MavlinkPeer, mission_type: int = MISSION) -> None:
        super().__init__()
        self._peer = peer
        self.mission_type = mission_type

    def _on_message(self, message: Message, now: float) -> list[Message]:
        if message.get_type() not in self.REPLIES or message.mission_type != self.mission_type:
            return []
        return self._on_reply(message, now) if self._peer.is_for_us(message) else []

    @abstractmethod
    def _on_reply(self, message: Message, now: float) -> list[Message]:
        """Handle a reply about this list to this ground station."""

    def _list_request(self) -> Message:
        """Return the request of the number of items."""
        to = (self._peer.sysid, self._peer.compid)
        return mavlink.MAVLink_mission_request_list_message(*to, mission_type=self.mission_type)

    def _ack(self, code: int) -> Message:
        to = (self._peer.sysid, self._peer.compid)
        return mavlink.MAVLink_mission_ack_message(*to, code, mission_type=self.mission_type)

    def _closing_messages(self, now: float) -> list[Message]:
        """Return the message that ends the transfer; otherwise the vehicle would wait for more."""
        return [self._ack(mavlink.MAV_MISSION_OPERATION_CANCELLED)]


def result_name(code: int) -> str:
    """Return the name of a MAV_MISSION_RESULT without its prefix, e.g. 14 -> DENIED."""
    return name_of("MAV_MISSION_RESULT", code).removeprefix("MAV_MISSION_")


def item_message(
    peer: MavlinkPeer, seq: int, item: MissionItem, mission_type: int = MISSION, *, current: bool = False
) -> Message:
    """Return a MISSION_ITEM_INT, the answer to both kinds of request."""
    return mavlink.MAVLink_mission_item_int_message(
        peer.sysid,
        peer.compid,
        seq,
        item.frame,
        item.command,
        int(current),
        item.autocontinue,
        item.param1,
        item.param2,
        item.param3,
        item.param4,
        item.x,
        item.y,
        item.z,
        mission_type,
    )


def item_of(message: Message) -> MissionItem:
    """Return the item in a MISSION_ITEM_INT."""
    return MissionItem(
        command=int(message.command),
        frame=int(message.frame),
        x=int(message.x),
        y=int(message.y),
        z=float(message.z),
        param1=float(message.param1),
        param2=float(message.param2),
        param3=float(message.param3),
        param4=float(message.param4),
        autocontinue=int(message.autocontinue),
    )
