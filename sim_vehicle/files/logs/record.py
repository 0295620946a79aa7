"""The input of a flight log, independent of its format."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum, IntEnum, auto
from typing import Protocol

from sim_vehicle.vehicle.mission import Item


class LogWhen(Enum):
    """The periods in which a vehicle records."""

    NEVER = auto()
    ARMED = auto()  # a log from each arming to the disarming
    FROM_BOOT = auto()  # the first log begins at the boot, later logs at the arming
    ALWAYS = auto()  # one log from the boot on


class Failsafe(IntEnum):
    """Kinds of failsafe; the numbers are ArduPilot's subsystems."""

    RADIO = 5
    BATTERY = 6
    GROUND_STATION = 8
    FENCE = 9
    POSITION = 17


@dataclass(frozen=True, slots=True)
class LogStart:
    """The state of the vehicle at the start of a log."""

    utc_s: float  # UNIX time of the start
    boot_s: float  # simulated time of the boot; the log counts its times from the boot
    banner: tuple[str, ...]  # the autopilot's name and version first, as sent to ground stations
    flight_sw_version: int
    parameters: Mapping[str, float | int]
    defaults: Mapping[str, float | int]
    mode: int  # custom_mode


@dataclass(slots=True)
class Sample:
    """The state of the vehicle at one moment, from its estimator and sensors."""

    lat_deg: float
    lon_deg: float
    alt_amsl_m: float
    above_home_m: float
    north_m: float  # north_m, east_m, up_m: from the origin of the position estimate
    east_m: float
    up_m: float
    north_m_s: float
    east_m_s: float
    down_m_s: float
    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    voltage_v: float
    current_a: float
    used_mah: float
    used_wh: float
    remaining: float  # charge as a share of the full charge, in [0, 1]
    gps_hdop: float
    gps_lat_deg: float
    gps_lon_deg: float
    gps_alt_amsl_m: float
    gps_fix: int  # GPS_FIX_TYPE
    gps_satellites: int


class FlightLog(Protocol):
    """A log during recording; `content` is a readable file at every moment.

    `now` is the simulated time [s], a mode is custom_mode, a severity is MAV_SEVERITY. The cells of a strike
    are (row, column): `over` of the vehicle, `by` of the hostile.
    """

    content: bytearray

    def begin(self, now: float, start: LogStart) -> None: ...
    def sample(self, now: float, sample: Sample) -> None: ...
    def text(self, now: float, severity: int, text: str) -> None: ...
    def mode(self, now: float, number: int) -> None: ...
    def origin(self, now: float, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> None: ...
    def home(self, now: float, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> None: ...
    def armed(self, now: float, armed: bool) -> None: ...
    def landed(self, now: float, landed: bool) -> None: ...
    def failsafe(self, now: float, kind: Failsafe, active: bool) -> None: ...
    def command(self, now: float, index: int, total: int, item: Item) -> None: ...
    def parameter(self, now: float, name: str, value: float) -> None: ...
    def strike(self, now: float, count: int, over: tuple[int, int], by: tuple[int, int]) -> None: ...
