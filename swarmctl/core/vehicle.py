"""What the ground station knows of one vehicle, as last told by its telemetry."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

Airframe = Literal["copter", "plane"]
ModeRole = Literal["", "hold", "mission", "return", "land", "other"]

STALE_MODE_S = 2.0
"""a mode that was left may show for so long in a heartbeat that was overtaken on its way"""


class Landed(IntEnum):
    """MAV_LANDED_STATE."""

    UNDEFINED = 0
    ON_GROUND = 1
    IN_AIR = 2
    TAKEOFF = 3
    LANDING = 4


@dataclass(frozen=True, slots=True)
class VehicleState:
    """One snapshot; None means the vehicle has not said it yet."""

    time_boot_s: float = 0.0
    """the vehicle's own clock since boot [s]; simulated seconds where the vehicle is simulated"""
    lat_deg: float | None = None
    lon_deg: float | None = None
    alt_rel_m: float | None = None
    """above home [m]"""
    alt_amsl_m: float | None = None
    ground_speed_m_s: float = 0.0
    east_m_s: float = 0.0
    north_m_s: float = 0.0
    """over ground, which need not be where it heads"""
    climb_m_s: float = 0.0
    """upwards positive [m/s]"""
    heading_deg: float | None = None
    mode: str = ""
    """the firmware's own name of the mode, e.g. AUTO"""
    mode_role: ModeRole = ""
    """what its mode is for, whatever the firmware calls it; "" until it has told"""
    armed: bool = False
    landed: Landed = Landed.UNDEFINED
    ready: bool = False
    """it would arm now and fly a mission: pre-arm checks and position estimate"""
    not_ready: tuple[str, ...] = ()
    """why not, in the vehicle's words where it has said so"""
    battery_percent: int | None = None
    battery_v: float | None = None
    gps_ok: bool | None = None
    """it has a receiver, and that has a fix; None where it has none"""
    mission_seq: int | None = None
    mission_total: int | None = None
    brakes_m_s2: float | None = None
    """how hard it brakes, down to a stop, before it takes up another plan in flight; None: it just turns"""
    other_mission: bool = False
    """somebody else has put another mission on it than was verified there"""
    home_lat_deg: float | None = None
    home_lon_deg: float | None = None
    home_alt_amsl_m: float | None = None
    strikes: int = 0
    """strikes the vehicle has reported (simulated vehicles do)"""
    status_text: str = ""
    """its last STATUSTEXT of severity WARNING or worse"""
    heartbeat_s: float | None = None
    """when its last heartbeat came, by our clock [s]: what mode and arming are as of"""
    status_s: float | None = None
    """when its last SYS_STATUS came, by our clock [s]: what battery, GPS and readiness are as of"""
    position_s: float | None = None
    """when it last told where it is, by our clock [s]"""

    @property
    def takeoff_lat_lon(self) -> tuple[float, float] | None:
        """Where it takes off, or did (home is set when it is armed) [deg]; None where it has not told."""
        if self.armed and self.home_lat_deg is not None and self.home_lon_deg is not None:
            return self.home_lat_deg, self.home_lon_deg
        return None if self.lat_deg is None or self.lon_deg is None else (self.lat_deg, self.lon_deg)

    @property
    def has_position(self) -> bool:
        """It knows where it is, and has told so of late."""
        return self.lat_deg is not None and self.lon_deg is not None and self.alt_rel_m is not None
