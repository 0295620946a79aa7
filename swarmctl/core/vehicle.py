"""The state of one vehicle by its last telemetry."""

from __future__ import annotations

from enum import IntEnum
from typing import Literal

import msgspec

Airframe = Literal["copter", "plane"]
ModeRole = Literal["", "hold", "mission", "return", "land", "setpoints", "other"]

STALE_MODE_S = 2.0
"""time for which a delayed heartbeat may still report the previous mode [s]"""

MAX_DELAY_S = 3.0
"""greatest delay of telemetry, from its sending to its processing, for a mission change [s]"""
RECENT_DELAY_S = 1.5
"""greatest delay of telemetry for a command [s]"""

BRAKING_M_S2 = 1.75
"""Deceleration assumed for a copter's stop. The defaults of WPNAV_ACCEL (2.5) and MPC_ACC_HOR (3) are higher,
but limits of the jerk and late telemetry make the stop longer."""

VERTICAL_ACCELERATION_M_S2 = 1.0
"""Acceleration with which a copter begins and ends a climb or descent: the default of WPNAV_ACCEL_Z."""

START_DELAY_S = 1.9
"""`VehicleState.start_delay_s` assumed for an unknown vehicle: the delay of an ArduCopter, the longest."""


class Landed(IntEnum):
    """MAV_LANDED_STATE."""

    UNDEFINED = 0
    ON_GROUND = 1
    IN_AIR = 2
    TAKEOFF = 3
    LANDING = 4


class VehicleState(msgspec.Struct, frozen=True):
    """Values of the last telemetry; None for a value not reported yet, and for an outdated position."""

    time_boot_s: float = 0.0
    """the vehicle's clock since boot [s]; simulated seconds for a simulated vehicle"""
    lat_deg: float | None = None
    lon_deg: float | None = None
    alt_rel_m: float | None = None
    """above home [m]"""
    alt_amsl_m: float | None = None
    ground_speed_m_s: float = 0.0
    east_m_s: float = 0.0
    north_m_s: float = 0.0
    """velocity over ground [m/s]; its direction may differ from the heading"""
    climb_m_s: float = 0.0
    """upwards positive [m/s]"""
    heading_deg: float | None = None
    mode: str = ""
    """the firmware's name of the mode, such as AUTO"""
    mode_role: ModeRole = ""
    """The purpose of the mode, equal for all firmwares; "" before the first heartbeat. ArduCopter follows
    set-points in its hold mode, with the role "hold"."""
    armed: bool = False
    landed: Landed = Landed.UNDEFINED
    ready: bool = False
    """True if pre-arm checks pass and the position estimate is good"""
    not_ready: tuple[str, ...] = ()
    """reasons why `ready` is False, in the vehicle's words if available"""
    battery_percent: int | None = None
    battery_v: float | None = None
    gps_ok: bool | None = None
    """True if the GPS works; None for a vehicle without a GPS receiver"""
    mission_seq: int | None = None
    mission_total: int | None = None
    brakes_m_s2: float | None = None
    """deceleration to a stop before a new mission in flight [m/s²]; None: the vehicle turns without a stop"""
    start_delay_s: float = START_DELAY_S
    """delay of a start from a stand, because the jerk is limited [s]"""
    other_mission: bool = False
    """True if the vehicle stores another mission than the verified one"""
    home_lat_deg: float | None = None
    home_lon_deg: float | None = None
    home_alt_amsl_m: float | None = None
    strikes: int = 0
    """number of reported strikes; only simulated vehicles report strikes"""
    status_text: str = ""
    """last STATUSTEXT of severity WARNING or worse"""
    heartbeat_s: float | None = None
    """arrival of the last heartbeat by this program's clock [s]: the time of `mode` and `armed`"""
    status_s: float | None = None
    """arrival of the last SYS_STATUS by this program's clock [s]: the time of battery, GPS and readiness"""
    position_s: float | None = None
    """arrival of the last position by this program's clock [s]"""
    delay_s: float = 0.0
    """time from the sending of this telemetry to its processing, by the vehicle's clock [s]"""

    @property
    def takeoff_lat_lon(self) -> tuple[float, float] | None:
        """Place of take-off [deg]: home of an armed vehicle, else the vehicle's position; None if unknown."""
        return (self.home_lat_lon if self.armed else None) or self.lat_lon

    @property
    def home_lat_lon(self) -> tuple[float, float] | None:
        """The vehicle's home [deg]; None if unknown."""
        if self.home_lat_deg is None or self.home_lon_deg is None:
            return None
        return self.home_lat_deg, self.home_lon_deg

    @property
    def lat_lon(self) -> tuple[float, float] | None:
        """The vehicle's position [deg]; None if unknown."""
        return None if self.lat_deg is None or self.lon_deg is None else (self.lat_deg, self.lon_deg)

    @property
    def has_position(self) -> bool:
        """True if latitude, longitude and both heights are known: a vehicle reports all of them or none."""
        return self.lat_lon is not None and self.alt_rel_m is not None and self.alt_amsl_m is not None
