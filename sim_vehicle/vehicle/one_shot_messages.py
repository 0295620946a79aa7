"""Messages that are sent one at a time, on request: what a vehicle is.

Each is a function of the vehicle and the request's second parameter, and returns the messages to send.
"""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

if TYPE_CHECKING:
    from sim_vehicle.vehicle.autopilot import Autopilot

Single = Callable[["Autopilot", float], Sequence[Any]]


def autopilot_version(vehicle: "Autopilot", _parameter: float) -> Sequence[Any]:
    """uid2 begins with `sim_vehicle` and ends with the system id: no real aircraft is behind this vehicle."""
    uid2 = list(b"sim_vehicle".ljust(17, b"\0") + bytes([vehicle.sysid]))
    nothing = [0] * 8
    personality = vehicle.personality
    return [
        mavlink.MAVLink_autopilot_version_message(
            personality.capabilities,
            personality.flight_sw_version,
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


SINGLES: dict[int, Single] = {
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: autopilot_version,
}
