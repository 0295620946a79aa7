"""What every link offers, what it reports, and how it fails.

A `Link` is one vehicle as the runner sees it. All waits have time-outs; cancelling a call cancels what it
was doing on the wire. Only one of connect/identify/prepare/upload/launch/swap/hold/return_home/land runs at
a time; `hold`, `return_home` and `land` interrupt whatever else runs, because they are what an operator needs
when something goes wrong; any other second call raises `Busy`.
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
    """The vehicle speaks from another address now (a reboot over UDP does that) and was followed."""

    address: str


@dataclass(frozen=True, slots=True)
class SystemIdConflict:
    """Two senders use this system id at once; the second one's frames are dropped."""

    address: str
    """of the second sender"""


@dataclass(frozen=True, slots=True)
class FramesRefused:
    """Frames in this vehicle's name are not taken; told at the first of a kind, and while it goes on."""

    text: str
    """why, how many, and what that means"""


ChannelEvent = AddressChanged | SystemIdConflict | FramesRefused
"""what the front end tells of a vehicle"""
LinkEvent = SessionEvent | ChannelEvent


class LinkError(Exception):
    """Something about one vehicle's link; the text names the vehicle and where it was looked for."""


class TransportError(LinkError):
    """A port that is taken, a device that is missing, an address that cannot be reached."""


class NoAnswer(LinkError):
    """No heartbeat of this system id came."""

    def __init__(self, text: str, *, url: str, sysid: int, tried_s: float) -> None:
        super().__init__(text)
        self.url = url
        self.sysid = sysid
        self.tried_s = tried_s


class UnsupportedVehicle(LinkError):
    """It answers, but this ground station cannot fly such a vehicle."""


class PrepareFailed(LinkError):
    """It answers, but refuses what it needs before a flight (streams, mode)."""


class NotReady(LinkError):
    """It did not become ready to arm in time."""

    def __init__(self, text: str, *, reasons: tuple[str, ...]) -> None:
        super().__init__(text)
        self.reasons = reasons


class ParametersFailed(LinkError):
    """A parameter is not what it was set to."""


class FenceFailed(LinkError):
    """The geofence is not verified to be on the vehicle or in force, or cannot be read."""


class UploadFailed(LinkError):
    """The plan is not verified to be on the vehicle."""


class LaunchFailed(LinkError):
    """It did not arm, start or leave the ground."""


class LaunchBlockedError(LaunchFailed):
    """Somebody came into its way before it took off; it is not armed."""

    def __init__(self, text: str, *, why: str, was_armed: bool) -> None:
        super().__init__(text)
        self.why = why
        """as it was told"""
        self.was_armed = was_armed
        """and has been disarmed again"""


class SwapFailed(LinkError):
    """The new plan is not being flown; `flying` says what is.

    "old": the plan from before, verified; "hold": it stands still in the air; "theirs": somebody else took
    the vehicle over; "unknown": nobody knows (the link went away in the middle).
    """

    def __init__(
        self, text: str, *, flying: FlyingAfterFailure, stood_still_s: float = 0.0, is_late: bool = False
    ) -> None:
        super().__init__(text)
        self.flying = flying
        self.stood_still_s = stood_still_s
        """for how long it held or stood still for it, by its own clock"""
        self.is_late = is_late
        """it was past where the plan leaves the old one"""


class CommandFailed(LinkError):
    """hold, return_home or land was refused, or was not seen to happen."""


class Busy(LinkError):
    """Another procedure runs on this vehicle."""


class Link(Protocol):
    """One vehicle. Times are those of the running loop [s]."""

    async def connect(self, timeout_s: float) -> Identity:
        """Hear its heartbeat and `identify` it. Raises NoAnswer, UnsupportedVehicle."""

    async def identify(self, timeout_s: float) -> Identity:
        """Ask a vehicle that is connected who it is, also again: an address may have changed hands.

        Nothing else is sent to it. Raises NoAnswer.
        """

    async def prepare(self, timeout_s: float, on_waiting: Callable[[tuple[str, ...]], None]) -> None:
        """Streams on, in its hold mode, ready to arm; reports whenever the reasons for waiting change.

        Raises NotReady with the last reasons, PrepareFailed.
        """

    async def upload(self, plan: FlightPlan) -> float:
        """On the ground: upload, read back, compare. Returns how long a change in flight will take over this
        link [s]. Raises UploadFailed."""

    async def read_parameters(self, names: Collection[str]) -> dict[str, float]:
        """Those of the names that the vehicle knows, in the units of the parameters.

        This and the six below may be called while `upload` runs, and the other way round: one waits for the
        other. Raises LinkError where an order has interrupted it.
        """

    async def set_parameters(self, wanted: Mapping[str, float]) -> None:
        """On the ground: set what is not as wanted, hear it back. Raises ParametersFailed."""

    async def put_fence(self, polygon: Sequence[LatLon]) -> None:
        """On the ground: upload the polygon to stay inside of, read back, compare. Raises FenceFailed."""

    async def read_fence(self) -> tuple[MissionItem, ...]:
        """The items of the fence that is on the vehicle. Raises FenceFailed."""

    async def enforce_fence(self) -> None:
        """On the ground: an ArduPilot keeps to the limits that FENCE_TYPE names from now on, whatever was in
        force before. Raises FenceFailed."""

    async def count_rally_points(self) -> int:
        """How many it has, and might return to. Raises LinkError where that is not known."""

    async def read_instruments(self) -> Instruments:
        """GPS receiver and clock; the vehicle's home and battery in `state` are young afterwards."""

    async def launch(self, blocked_by: Callable[[], str] = lambda: "") -> None:
        """Arm and start the mission; returns when it climbs. Raises LaunchFailed. THIS ARMS THE VEHICLE.

        `blocked_by`: who is in the way of its take-off just now, in words; asked right before it is armed and
        right before it takes off. Raises LaunchPutOff where somebody is.
        Nothing is commanded any more once somebody else has chosen a mode or armed it.
        """

    async def swap(self, plan: FlightPlan) -> Swapped:
        """In flight: upload, verify, fly `plan` from its first waypoint, or from what of it lies ahead
        (`leaves_ahead`), without a stop where the autopilot allows it. Raises SwapFailed.

        Nothing is commanded any more once somebody else has chosen a mode.
        """

    async def hold(self, *, check_mode_first: bool = False) -> None:
        """Stand still in the air. Raises CommandFailed.

        As `return_home` and `land`: sent at once whatever its mode, and again only while nobody else has
        chosen one since. `check_mode_first`: also the first time; for whatever no person has ordered just now.
        """

    async def set_speed(self, speed_m_s: float) -> None:
        """Another speed over ground for its mission, which it flies, until that is changed [m/s]. Raises
        CommandFailed; nothing is sent where somebody else has chosen another mode."""

    async def return_home(self, *, check_mode_first: bool = False) -> None:
        """Return to launch. Raises CommandFailed."""

    async def land(self, *, check_mode_first: bool = False) -> None:
        """Land where it is. Raises CommandFailed."""

    def state(self) -> VehicleState:
        """Its last known state."""

    def age_s(self) -> float:
        """Since its last heartbeat [s]; infinite before the first."""

    def items(self) -> tuple[MissionItem, ...]:
        """The mission items last verified on the vehicle, item 0 included; empty if none or in doubt."""

    def close(self) -> None:
        """Stop timers, leave the front end, close its tlog. Idempotent."""
