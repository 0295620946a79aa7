"""The identity of a vehicle, and the behaviour of known autopilots where MAVLink allows a choice.

`ARDUCOPTER` and `PX4` were observed on ArduCopter 4.6.2 and PX4 1.15 in software-in-the-loop. Other
autopilots are tested only against the specification; checks that need more are skipped.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from pymavlink.dialects.v20 import ardupilotmega as mavlink

PLANE_TYPES = frozenset({mavlink.MAV_TYPE_FIXED_WING})
SIMULATOR_MARK = b"sim_vehicle"  # first bytes of the simulator's uid2


@dataclass(frozen=True, slots=True)
class VehicleIdentity:
    """The identity of a vehicle, from HEARTBEAT and, if received, AUTOPILOT_VERSION."""

    sysid: int
    component: int
    autopilot: int  # MAV_AUTOPILOT
    vehicle_type: int  # MAV_TYPE
    capabilities: int = 0  # MAV_PROTOCOL_CAPABILITY bits
    software: int = 0  # flight_sw_version
    uid2: bytes = b""

    @property
    def simulator(self) -> bool:
        return self.uid2.startswith(SIMULATOR_MARK)

    @property
    def kind(self) -> str:
        return "plane" if self.vehicle_type in PLANE_TYPES else "copter"

    def claims(self, capability: str) -> bool:
        bit: int = getattr(mavlink, f"MAV_PROTOCOL_CAPABILITY_{capability}")
        return bool(self.capabilities & bit)


def version_text(software: int) -> str:
    """Return the version in flight_sw_version, such as `4.6.2`."""
    return f"{software >> 24}.{software >> 16 & 0xFF}.{software >> 8 & 0xFF}"


def px4_mode(main: int, sub: int = 0) -> int:
    """Return PX4's custom_mode for a main mode and a sub mode."""
    return sub << 24 | main << 16


@dataclass(frozen=True, slots=True)
class Dialect:
    """The known behaviour of one autopilot; None for unknown behaviour."""

    name: str
    modes: Mapping[str, int]  # role of a mode, such as "hold" -> custom_mode
    ready_mode: str | None = None  # role of the mode for arming and for commands
    hold_mode: str | None = None  # role of a mode that holds the position without stick input
    byte_wise: bool | None = None  # True: integer parameters are sent as their bytes
    sysid_parameters: tuple[str, ...] = ()  # possible names of the parameter with the system id
    # (name, value) of parameters that are safe to write, in the order of preference
    integer_parameters: tuple[tuple[str, int], ...] = ()
    real_parameters: tuple[tuple[str, float], ...] = ()
    refusal: str | None = None  # MAV_RESULT of a refused arming, and of a refused disarming in flight
    home_item: bool = False  # True: item 0 of a mission is home
    battery_parameter: str | None = None  # name of the parameter with the battery's capacity [mAh]

    @property
    def is_known(self) -> bool:
        return self.name != "mavlink"


_ARDUPILOT = Dialect(
    "ardupilot",
    {},
    ready_mode="guided",
    hold_mode="hold",
    byte_wise=False,
    sysid_parameters=("SYSID_THISMAV", "MAV_SYSID"),
    refusal="FAILED",
    home_item=True,
    battery_parameter="BATT_CAPACITY",
)
ARDUCOPTER = replace(
    _ARDUPILOT,
    modes={
        "manual": 0, "altitude": 2, "mission": 3, "guided": 4, "loiter": 5, "return": 6, "circle": 7,
        "land": 9, "position": 16, "hold": 17,
    },
    integer_parameters=(("RTL_ALT", 1600), ("DISARM_DELAY", 11)),
    real_parameters=(("WPNAV_SPEED", 750.5), ("WPNAV_ACCEL", 220.5)),
)  # fmt: skip
ARDUPLANE = replace(
    _ARDUPILOT,
    modes={
        "manual": 0, "circle": 1, "stabilized": 2, "altitude": 6, "cruise": 7, "mission": 10, "return": 11,
        "hold": 12, "takeoff": 13, "guided": 15,
    },
    integer_parameters=(("WP_RADIUS", 95), ("TKOFF_ALT", 51)),
    real_parameters=(("TECS_CLMB_MAX", 4.5), ("TKOFF_LVL_ALT", 11.5)),
)  # fmt: skip
PX4 = Dialect(
    "px4",
    {
        "manual": px4_mode(1), "altitude": px4_mode(2), "position": px4_mode(3), "takeoff": px4_mode(4, 2),
        "hold": px4_mode(4, 3), "mission": px4_mode(4, 4), "return": px4_mode(4, 5), "land": px4_mode(4, 6),
        "acro": px4_mode(5), "offboard": px4_mode(6), "stabilized": px4_mode(7),
    },
    ready_mode="hold",
    hold_mode="hold",
    byte_wise=True,
    sysid_parameters=("MAV_SYS_ID",),
    integer_parameters=(("NAV_DLL_ACT", 1), ("COM_LOW_BAT_ACT", 1)),
    real_parameters=(("RTL_RETURN_ALT", 61.25), ("MIS_TAKEOFF_ALT", 3.75)),
    refusal="TEMPORARILY_REJECTED",
    battery_parameter="BAT1_CAPACITY",
)  # fmt: skip
GENERIC = Dialect("mavlink", {})


def dialect_of(autopilot: int, vehicle_type: int) -> Dialect:
    """Return the dialect of a MAV_AUTOPILOT and a MAV_TYPE."""
    if autopilot == mavlink.MAV_AUTOPILOT_PX4:
        return PX4
    if autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA:
        return ARDUPLANE if vehicle_type in PLANE_TYPES else ARDUCOPTER
    return GENERIC
