"""Rally points: positions to which a vehicle may return instead of home or its mission's landing.

https://mavlink.io/en/services/mission.html#mission_types

This module requests only the number of rally points. ArduPilot reports RALLY_TOTAL
(`MissionItemProtocol_Rally::item_count`). A build without rally points (HAL_RALLY_ENABLED 0) answers
MAV_MISSION_UNSUPPORTED and returns to home (`GCS_MAVLINK::handle_mission_request_list`,
`ModeRTL::compute_return_target`).
"""

from __future__ import annotations

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.mavlink.protocol.codec import Message
from swarmctl.mavlink.protocol.conversation import MavlinkPeer
from swarmctl.mavlink.protocol.mission_transfer import MissionTransfer, result_name
from swarmctl.mavlink.protocol.procedure import Context, Procedure

RALLY = int(mavlink.MAV_MISSION_TYPE_RALLY)


class RallyPoints(msgspec.Struct, frozen=True):
    """Number of a vehicle's rally points; None: unknown, because of `failure`."""

    count: int | None
    failure: str = ""


class CountRallyPoints(MissionTransfer[RallyPoints]):
    """Request of the number of rally points, sent up to TRIES times.

    `may_lack`: True if the answer "unsupported" means 0 points.
    """

    REPLIES = frozenset({"MISSION_COUNT", "MISSION_ACK"})
    REPEAT_PERIOD_S = 1.0
    TRIES = 12

    def __init__(self, peer: MavlinkPeer, *, may_lack: bool) -> None:
        super().__init__(peer, RALLY)
        self._may_lack = may_lack
        self._tries = 0
        self._last_answer = "no answer"

    def _begin(self, now: float) -> list[Message]:
        return self._ask(now)

    def _ask(self, now: float) -> list[Message]:
        self._tries += 1
        self.next_deadline = now + self.REPEAT_PERIOD_S
        return [self._list_request()]

    def _on_reply(self, message: Message, now: float) -> list[Message]:
        if message.get_type() == "MISSION_COUNT":
            self._finish(RallyPoints(int(message.count)))
            return self._closing_messages(now)
        if self._may_lack and message.type == mavlink.MAV_MISSION_UNSUPPORTED:
            self._finish(RallyPoints(0))
            return []
        # Other refusals may be temporary: another station may be uploading rally points.
        self._last_answer = result_name(int(message.type))
        return []

    def _on_deadline(self, now: float) -> list[Message]:
        if self._tries < self.TRIES:
            return self._ask(now)
        self._finish(RallyPoints(None, f"no number after {self._tries} requests: {self._last_answer}"))
        return self._closing_messages(now)


def count_rally_points(ctx: Context) -> Procedure[RallyPoints]:
    """Request and return the number of rally points on the vehicle."""
    counted: RallyPoints = yield CountRallyPoints(ctx.peer, may_lack=ctx.dialect.may_lack_rally)
    return counted
