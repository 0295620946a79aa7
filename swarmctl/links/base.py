"""`Link`: the interface of one vehicle, with its events and errors.

All waits have time-outs; cancelling a call cancels its conversation on the wire. Only one of
connect/identify/prepare/upload/launch/swap/hold/return_home/land runs at a time. `hold`, `return_home` and
`land` interrupt the running call, because an operator needs these commands in an emergency. Any other second
call raises `Busy`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

from swarmctl.core.geo import LatLon
from swarmctl.core.mission import FlightPlan, MissionItem
from swarmctl.core.vehicle import VehicleState
from swarmctl.mavlink.events import (
    FirstHeartbeat,
    Identity,
    ProcedureDone,
    SessionEvent,
    StateChanged,
    StatusText,
    VehicleLost,
    VehicleRebooted,
    VehicleRestored,
)
from swarmctl.mavlink.protocol.outcome import Swapped
from swarmctl.mavlink.telemetry.instruments import Instruments
from swarmctl.mavlink.telemetry.streams import Streaming

__all__ = [
    "AddressChanged",
    "Busy",
    "ChannelEvent",
    "CommandFailed",
    "FenceFailed",
    "FirstHeartbeat",
    "FlyingAfterFailure",
    "FramesRefused",
    "Identity",
    "Instruments",
    "LaunchBlockedError",
    "LaunchFailed",
    "Link",
    "LinkError",
    "LinkEvent",
    "NoAnswer",
    "NotReady",
    "ParametersFailed",
    "PrepareFailed",
    "ProcedureDone",
    "StateChanged",
    "StatusText",
    "Streaming",
    "SwapFailed",
    "SystemIdConflict",
    "TransportError",
    "UnsupportedVehicle",
    "UploadFailed",
    "VehicleLost",
    "VehicleRebooted",
    "VehicleRestored",
]

FlyingAfterFailure = Literal["old", "hold", "theirs", "unknown"]


@dataclass(frozen=True, slots=True)
class AddressChanged:
    """A new address of the vehicle, as after a reboot over UDP; the link sends there from now on."""

    address: str


@dataclass(frozen=True, slots=True)
class SystemIdConflict:
    """Two senders with this system id at once; frames of the second sender are dropped."""

    address: str
    """address of the second sender"""


@dataclass(frozen=True, slots=True)
class FramesRefused:
    """Refused frames with the vehicle's system id, reported at once and then at most once a minute."""

    text: str
    """reason, number and meaning"""


ChannelEvent = AddressChanged | SystemIdConflict | FramesRefused
"""event of the front end about one vehicle"""
LinkEvent = SessionEvent | ChannelEvent


class LinkError(Exception):
    """Failure of one vehicle's link; the text names the vehicle and its endpoint."""


class TransportError(LinkError):
    """A port in use, a missing device or an unreachable address."""


class NoAnswer(LinkError):
    """No heartbeat, or no AUTOPILOT_VERSION, has arrived from this system id."""

    def __init__(self, text: str, *, url: str, sysid: int, tried_s: float) -> None:
        super().__init__(text)
        self.url = url
        self.sysid = sysid
        self.tried_s = tried_s


class UnsupportedVehicle(LinkError):
    """The vehicle answers, but its type is not supported."""


class PrepareFailed(LinkError):
    """The vehicle is already armed, or another command has interrupted the preparation."""


class NotReady(LinkError):
    """The vehicle did not become ready to arm in time."""

    def __init__(self, text: str, *, reasons: tuple[str, ...]) -> None:
        super().__init__(text)
        self.reasons = reasons


class ParametersFailed(LinkError):
    """A parameter cannot be set, or its new value is not confirmed."""


class FenceFailed(LinkError):
    """The geofence is not verified on the vehicle, may not be in force, or cannot be read."""


class UploadFailed(LinkError):
    """The plan is not verified on the vehicle."""


class LaunchFailed(LinkError):
    """The vehicle did not arm, start or leave the ground."""


class LaunchBlockedError(LaunchFailed):
    """Another vehicle blocked the take-off; the vehicle is disarmed."""

    def __init__(self, text: str, *, why: str, was_armed: bool) -> None:
        super().__init__(text)
        self.why = why
        """obstacle, as returned by `blocked_by`"""
        self.was_armed = was_armed
        """True if the vehicle was armed and has been disarmed again"""


class SwapFailed(LinkError):
    """The new plan is not flown; the vehicle flies the mission or mode `flying` instead.

    old: the previous plan, verified
    hold: hold in the air
    theirs: a mode set by the pilot, a failsafe or another station
    unknown: neither the mission nor the mode is certain
    """

    def __init__(
        self, text: str, *, flying: FlyingAfterFailure, stood_still_s: float = 0.0, is_late: bool = False
    ) -> None:
        super().__init__(text)
        self.flying = flying
        self.stood_still_s = stood_still_s
        """time in hold or without motion in the air, by the vehicle's clock [s]"""
        self.is_late = is_late
        """True if the vehicle had passed the splice point, where the new plan leaves the old plan"""


class CommandFailed(LinkError):
    """The vehicle has refused hold, return_home, land or set_speed, or telemetry shows no effect."""


class Busy(LinkError):
    """Another procedure runs on this vehicle."""


class Link(Protocol):
    """One vehicle. Times are by the event loop's clock [s]."""

    async def connect(self, timeout_s: float) -> Identity:
        """Wait for a heartbeat and `identify` the vehicle. Raises NoAnswer, UnsupportedVehicle."""

    async def identify(self, timeout_s: float) -> Identity:
        """Request the identity of a connected vehicle again: another vehicle may have taken the address.

        No other message is sent. Raises NoAnswer.
        """

    async def prepare(self, timeout_s: float, on_waiting: Callable[[tuple[str, ...]], None]) -> None:
        """Request streams, set hold mode and wait until the vehicle is ready to arm.

        `on_waiting` gets the reasons for waiting whenever they change. Raises NotReady with the last reasons,
        PrepareFailed.
        """

    async def upload(self, plan: FlightPlan) -> float:
        """Upload a plan on the ground, read it back and compare; return the expected time of a swap [s].

        Raises UploadFailed.
        """

    async def read_parameters(self, names: Collection[str]) -> dict[str, float]:
        """Return the parameters that the vehicle knows, by name, each in its unit.

        The calls from here to `read_instruments`, and `upload`, wait for each other. Raises LinkError after
        an interruption by an urgent command.
        """

    async def set_parameters(self, wanted: Mapping[str, float]) -> None:
        """Set the parameters that differ, on the ground, and confirm them. Raises ParametersFailed."""

    async def put_fence(self, polygon: Sequence[LatLon]) -> None:
        """Upload the inclusion polygon on the ground, read it back and compare. Raises FenceFailed."""

    async def read_fence(self) -> tuple[MissionItem, ...]:
        """Return the items of the fence on the vehicle. Raises FenceFailed."""

    async def enforce_fence(self) -> None:
        """Enable on the ground the fences that an ArduPilot's FENCE_TYPE names. Raises FenceFailed."""

    async def count_rally_points(self) -> int:
        """Return the number of rally points on the vehicle. Raises LinkError if it is unknown."""

    async def read_instruments(self) -> Instruments:
        """Return readings of GPS receiver and clock; home and battery in `state` are renewed too."""

    async def launch(self, blocked_by: Callable[[], str] = lambda: "") -> None:
        """Arm and start the mission; return when the vehicle climbs. THIS ARMS THE VEHICLE.

        `blocked_by` returns the current obstacle to the take-off as text, or "". The link calls `blocked_by`
        right before arming and right before the take-off. No command follows once another party has chosen a
        mode or armed the vehicle. Raises LaunchFailed, and LaunchBlockedError for an obstacle.
        """

    async def swap(self, plan: FlightPlan) -> Swapped:
        """Upload and verify `plan` in flight and fly it, without a stop if the autopilot allows it.

        The vehicle begins at the first waypoint; a plan with `leaves_ahead` begins at the item ahead of the
        vehicle. No command follows once another party has chosen a mode. Raises SwapFailed.
        """

    async def hold(self, *, check_mode_first: bool = False) -> None:
        """Hold in the air. Raises CommandFailed.

        The first command is sent at once in any mode; repetitions stop once another party has chosen a mode.
        `check_mode_first` also checks the mode before the first command; use it for commands that no operator
        has given. The same applies to `return_home` and `land`.
        """

    async def set_speed(self, speed_m_s: float) -> None:
        """Set the speed for the rest of the flown mission [m/s].

        Raises CommandFailed; nothing is sent if another party has chosen another mode.
        """

    async def return_home(self, *, check_mode_first: bool = False) -> None:
        """Return to launch. Raises CommandFailed."""

    async def land(self, *, check_mode_first: bool = False) -> None:
        """Land at the current position, or at the mission's landing. Raises CommandFailed."""

    def state(self) -> VehicleState:
        """Return the last known state."""

    def age_s(self) -> float:
        """Return the time since the last heartbeat [s]; infinite before the first."""

    def items(self) -> tuple[MissionItem, ...]:
        """Return the mission items last verified on the vehicle, with item 0.

        Empty if none, or if the vehicle may store another mission.
        """

    def close(self) -> None:
        """Stop timers, leave the front end, close its tlog. Idempotent."""
