"""Messages of vehicles, each with its receiver, for tests of single conversations."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.mission import MissionItem
from swarmctl.mavlink.protocol.conversation import MavlinkPeer

PEER = MavlinkPeer(1)
ITEMS = tuple(MissionItem(16, 3, 460_000_000 + i, 145_000_000, 20.0 + i) for i in range(3))


def ack(command: int, result: int, to: int = 255):
    return mavlink.MAVLink_command_ack_message(command, result, 0, 0, to, 190)


def request(seq: int, *, to: int = 255, kind: int = 0):
    return mavlink.MAVLink_mission_request_message(to, 190, seq, kind)


def mission_ack(result: int, *, to: int = 255, kind: int = 0):
    return mavlink.MAVLink_mission_ack_message(to, 190, result, kind)


def mission_count(n: int):
    return mavlink.MAVLink_mission_count_message(255, 190, n, 0)


def kinds(messages) -> list[str]:
    return [m.get_type() for m in messages]
