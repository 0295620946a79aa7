"""One-shot messages of all autopilots, which a vehicle sends on request only.

The parameters of each function are the vehicle and param2 of the request. The result is the messages to send.
"""

from collections.abc import Sequence
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.vehicle.interface import OneShotMessage, Vehicle


def autopilot_version(vehicle: Vehicle, _parameter: float) -> Sequence[Any]:
    """Return AUTOPILOT_VERSION; uid2 is `sim_vehicle` and the system id, unlike on any real aircraft."""
    uid2 = list(b"sim_vehicle".ljust(17, b"\0") + bytes([vehicle.sysid]))
    nothing = [0] * 8
    identity = vehicle.personality.identity
    return [
        mavlink.MAVLink_autopilot_version_message(
            identity.capabilities,
            identity.flight_sw_version,
            0,
            0,
            0,
            nothing,
            nothing,
            nothing,
            0,
            0,
            vehicle.sysid,
            uid2,
        )
    ]


ONE_SHOT_MESSAGES: dict[int, OneShotMessage] = {
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: autopilot_version,
}
