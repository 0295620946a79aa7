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
from swarmctl.mavlink.protocol.mission_transfer import result_name
from swarmctl.mavlink.protocol.procedure import Context, Procedure
from swarmctl.mavlink.protocol.wait import Requests

RALLY = int(mavlink.MAV_MISSION_TYPE_RALLY)


class RallyPoints(msgspec.Struct, frozen=True):
    """Number of a vehicle's rally points; None: unknown, because of `failure`."""

    count: int | None
    failure: str = ""


TRIES = 12
"""number of tries of the request"""


def count_rally_points(ctx: Context) -> Procedure[RallyPoints]:
    """Request and return the number of rally points on the vehicle."""
    to = (ctx.peer.sysid, ctx.peer.compid)

    def answer_to(message: Message, _now: float) -> tuple[int, RallyPoints] | None:
        kind = message.get_type()
        if kind not in ("MISSION_COUNT", "MISSION_ACK") or message.mission_type != RALLY:
            return None
        if not ctx.peer.is_for_us(message):
            return None
        if kind == "MISSION_COUNT":
            return RALLY, RallyPoints(int(message.count))
        if ctx.dialect.may_lack_rally and message.type == mavlink.MAV_MISSION_UNSUPPORTED:
            return RALLY, RallyPoints(0)
        # Other refusals may be temporary: another station may be uploading rally points.
        failure = f"no number after {TRIES} requests: {result_name(int(message.type))}"
        return RALLY, RallyPoints(None, failure)

    request = mavlink.MAVLink_mission_request_list_message(*to, mission_type=RALLY)
    # The end of the transfer; otherwise PX4 would wait for the next request.
    end = mavlink.MAVLink_mission_ack_message(
        *to, mavlink.MAV_MISSION_OPERATION_CANCELLED, mission_type=RALLY
    )
    answers: dict[int, RallyPoints] = yield Requests(
        {RALLY: request},
        answer_to,
        lambda _key, found: found.count is not None,
        tries=TRIES,
        closing=[end],
    )
    return answers.get(RALLY) or RallyPoints(None, f"no number after {TRIES} requests: no answer")
