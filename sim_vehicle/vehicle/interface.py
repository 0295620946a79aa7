"""Narrow protocols between the parts of one vehicle, so that the parts do not import each other.

`personalities.base.Vehicle` composes these protocols into the whole vehicle.
"""

from collections.abc import Sequence
from typing import Any, Protocol

from sim_vehicle.physics.body import Body
from sim_vehicle.physics.geodesy import GeodeticPosition
from sim_vehicle.vehicle.behaviour import Behaviour, Mode
from sim_vehicle.vehicle.flight_parameters import FailsafeAction, FlightParameters
from sim_vehicle.vehicle.mission import Item, Mission
from sim_vehicle.vehicle.rally import Rally
from sim_vehicle.vehicle.sticks import Sticks


class MessageOutput(Protocol):
    """The fleet's encoder and link, which take a vehicle's messages."""

    def message(self, vehicle: int, message: Any) -> None:
        """Pack and send one message."""

    def raw(self, vehicle: int, data: bytes) -> None:
        """Send bytes that are not a MAVLink frame, such as a boot text."""

    def stream_now(self, vehicle: int, message_id: int, now: float) -> bool:
        """Send one message of STREAMS; return False if the vehicle has no data for the message yet."""
        ...


class ModeControl(Protocol):
    """The flight mode and its changes (`modes.Modes`)."""

    mission_checked_s: float
    chosen: bool

    @property
    def mode(self) -> Mode: ...

    def set(self, number: int, now: float) -> bool: ...

    def set_behaviour(self, behaviour: Behaviour, now: float) -> bool: ...

    def enter_behaviour(self, behaviour: Behaviour) -> None: ...

    def enter(self, number: int) -> None: ...

    def mission_ready(self, now: float) -> bool: ...

    def disarmed(self) -> None: ...


class ArmingControl(Protocol):
    """Arming and disarming (`arming.Arming`)."""

    @property
    def armed_since_s(self) -> float: ...

    @property
    def flying_since_s(self) -> float: ...

    def arm(self, now: float, *, force: bool, text: str = ...) -> bool: ...

    def stop(self, text: str = ...) -> None: ...


class FailsafeControl(Protocol):
    """The latched failsafes (`failsafe.Failsafes`)."""

    @property
    def gcs_lost(self) -> bool: ...

    @property
    def rc_lost(self) -> bool: ...

    @property
    def position_lost(self) -> bool: ...

    @property
    def battery_level(self) -> int: ...

    @property
    def any_latched(self) -> bool: ...

    @property
    def battery_state(self) -> int: ...

    @property
    def gcs_missing(self) -> bool: ...

    def gcs_late(self, now: float) -> bool: ...

    def receive_heartbeat(self, sysid: int, now: float) -> None: ...

    def receive_remote_frame(self, now: float) -> None: ...

    def act(self, action: FailsafeAction, now: float, *, at_once: bool = ...) -> None: ...


class RemoteInput(Protocol):
    """The remote control or joystick (`remote.Remote` of a personality)."""

    def reset(self) -> None: ...

    def receive(self, message: Any, now: float) -> None:
        """Process RC_CHANNELS_OVERRIDE or MANUAL_CONTROL."""

    def channels_us(self, now: float) -> Sequence[int]:
        """Return the pulses of the channels for RC_CHANNELS [us]."""
        ...

    @property
    def count(self) -> int:
        """Number of channels for RC_CHANNELS."""
        ...

    def sticks(self, now: float) -> Sticks: ...

    def missing(self, now: float) -> bool:
        """Return True if modes that need a pilot cannot run."""
        ...

    def keeps_armed(self, now: float) -> bool:
        """Return True while the sticks prevent the automatic disarming."""
        ...


class FenceControl(Protocol):
    """The geofence in force (`fence_watch.FenceWatch`)."""

    @property
    def enabled(self) -> bool: ...

    @property
    def has_limits(self) -> bool: ...

    @property
    def breached(self) -> frozenset[str]: ...

    @property
    def count(self) -> int: ...

    @property
    def last_s(self) -> float: ...

    @property
    def kind(self) -> int: ...

    def find(self, lat_deg: float, lon_deg: float, height_m: float) -> frozenset[str]: ...

    def refusal(self) -> str | None: ...

    def mode_changed_by_station(self, now: float) -> None: ...

    def set_enabled(self, *, on: bool) -> None: ...


class ReferencePlaces(Protocol):
    """Home, origin and rally points (`home_and_rally.HomeAndRally`)."""

    @property
    def home(self) -> GeodeticPosition | None: ...

    @property
    def home_locked(self) -> bool: ...

    @property
    def home_deg(self) -> tuple[float, float]: ...

    @property
    def home_or_here(self) -> GeodeticPosition: ...

    @property
    def height_above_home_m(self) -> float: ...

    @property
    def origin(self) -> GeodeticPosition | None: ...

    @property
    def origin_m(self) -> tuple[float, float, float]: ...

    @property
    def rally(self) -> Rally: ...

    def home_item(self) -> Item: ...

    def set_home(self, position: GeodeticPosition, now: float, *, locked: bool = ...) -> None: ...

    def set_origin(self, position: GeodeticPosition, now: float) -> None: ...


class SetpointControl(Protocol):
    """Set-points from outside (`setpoints.Setpoints`)."""

    def reset(self) -> None: ...

    def streaming(self, now: float) -> bool: ...

    def receive(self, message: Any, now: float) -> None: ...


class MissionIds(Protocol):
    """Ids of the stored mission, fence and rally points for telemetry."""

    @property
    def ids(self) -> tuple[int, int, int]: ...


class FlightControl(Protocol):
    """Steering as manoeuvres and missions use it (`flight.Flight`)."""

    guided_target_m: tuple[float, float, float] | None
    taking_off: bool

    @property
    def body(self) -> Body: ...

    @property
    def mission(self) -> Mission: ...

    @property
    def flight_parameters(self) -> FlightParameters: ...

    @property
    def behaviour(self) -> Behaviour: ...

    @property
    def armed(self) -> bool: ...

    @property
    def flying(self) -> bool: ...

    @property
    def cleared_for_takeoff(self) -> bool: ...

    @property
    def commanded_heading_rad(self) -> float: ...

    def landed(self, now: float) -> bool: ...

    def landing_speed_m_s(self) -> float: ...

    def home(self) -> GeodeticPosition: ...

    def return_place(self) -> GeodeticPosition: ...

    def ceiling_amsl_m(self) -> float: ...

    def altitude_amsl_m(self, frame: int, z_m: float) -> float: ...

    def remote_lost(self) -> bool: ...

    def go(self, target_m: tuple[float, float, float], pass_speed_m_s: float = ...) -> None: ...

    def turn(self, angle_deg: float, rate_deg_s: float, *, direction: int, relative: bool) -> bool: ...

    def change_speed(self, kind: int, speed_m_s: float) -> bool: ...

    def limit(self, **limits: float) -> None: ...

    def start_landing(self) -> bool: ...

    def disarm(self) -> None: ...

    def set_home(self, position: GeodeticPosition) -> None: ...

    def mission_over(self) -> None: ...

    def announce(self, event: str, **values: Any) -> None: ...

    def send(self, message: Any) -> None: ...
