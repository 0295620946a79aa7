"""The autopilots of simulated vehicles, by their names in `simulate.autopilot`. Pure.

A new autopilot is a line in `AUTOPILOTS`, with a personality of the simulator.
"""

from __future__ import annotations

from collections.abc import Callable

import msgspec

from swarmctl.core.vehicle import Airframe
from swarmctl.mavlink.dialects import ArduCopter, ArduPlane, Px4Copter, Px4Plane
from swarmctl.mavlink.firmware import Firmware

BATTERY_MAH = 6600.0
"""battery capacity of simulated ArduPilot vehicles [mAh], enough for heights of hundreds of metres"""


class SimulatedAutopilot(msgspec.Struct, frozen=True):
    """An autopilot of the simulator."""

    personality: str
    airframe: Airframe
    firmware: Firmware
    start_delay_s: float
    """delay of a start from a stand [s], as of its dialect"""
    params: Callable[[float, int], dict[str, float]]
    """(cruise speed, least airspeed) [m/s] -> parameters to set"""


AUTOPILOTS: dict[str, SimulatedAutopilot] = {
    "ardupilot": SimulatedAutopilot(
        "ardupilot",
        "copter",
        Firmware("ArduCopter", (4, 6)),
        ArduCopter.start_delay_s,
        lambda speed, _: {"WPNAV_SPEED": 100.0 * speed, "BATT_CAPACITY": BATTERY_MAH},
    ),
    "px4": SimulatedAutopilot(
        "px4",
        "copter",
        Firmware("PX4", (1, 15)),
        Px4Copter.start_delay_s,
        lambda speed, _: {"MPC_XY_CRUISE": speed, "MPC_XY_VEL_MAX": speed},
    ),
    "arduplane": SimulatedAutopilot(
        "ardupilot",
        "plane",
        Firmware("ArduPlane", (4, 6)),
        ArduPlane.start_delay_s,
        lambda speed, least: {"AIRSPEED_CRUISE": speed, "AIRSPEED_MIN": least, "BATT_CAPACITY": BATTERY_MAH},
    ),
    "px4plane": SimulatedAutopilot(
        "px4",
        "plane",
        Firmware("PX4 plane", (1, 15)),
        Px4Plane.start_delay_s,
        lambda speed, least: {"FW_AIRSPD_TRIM": speed, "FW_AIRSPD_MIN": least, "FW_LND_ABORT": 0},
    ),
}
MIXED = ("ardupilot", "px4")
"""the autopilots of `mixed`, in turn"""
