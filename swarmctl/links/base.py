"""`Link`: the interface to one vehicle, with its events and errors.

Cancelling a call cancels its conversation on the wire. One call runs at a time; a second call raises `Busy`,
except:
- `hold`, `return_home` and `land` interrupt the running call, as an operator needs them in an emergency.
- `upload` and the calls from `read_parameters` to `read_instruments` wait for each other.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Protocol

import msgspec

from swarmctl.core.geo import LatLon
from swarmctl.core.mission import FlightPlan, MissionItem
from swarmctl.core.setpoint import SetPoint
from swarmctl.core.vehicle import VehicleState
from swarmctl.mavlink.events import Identity, SessionEvent
from swarmctl.mavlink.procedures.recognise import Recognised
from swarmctl.mavlink.protocol.outcome import Swapped
from swarmctl.mavlink.telemetry.instruments import Instruments


class AddressChanged(msgspec.Struct, frozen=True):
    """New address of the vehicle, to which the link now sends; a reboot may change a UDP address."""

    address: str


class SystemIdConflict(msgspec.Struct, frozen=True):
    """Two senders with this system id at the same time; frames of the second sender are dropped."""

    address: str
    """address of the second sender"""


class FramesRefused(msgspec.Struct, frozen=True):
    """Refused frames with the vehicle's system id; for each reason at most one event a minute."""

    text: str
    """reason of the refusals, number of frames so far, last sender, and meaning for the operator"""


ChannelEvent = AddressChanged | SystemIdConflict | FramesRefused
"""event about one vehicle from the `FrontEnd`, the owner of the transports"""
LinkEvent = SessionEvent | ChannelEvent


class LinkError(Exception):
    """Failure of a link, a transport, forwarding or signing; the text names the subject."""


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
    """The vehicle answers, but its autopilot or its type is not supported."""


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
    """The geofence is not verified on the vehicle, not confirmed as enabled, or cannot be read."""


class UploadFailed(LinkError):
    """The plan is not verified on the vehicle."""


class LaunchFailed(LinkError):
    """The take-off is not confirmed; a vehicle that did not leave the ground may still be armed."""


class LaunchBlockedError(LaunchFailed):
    """Another vehicle blocked the take-off; the vehicle is disarmed."""

    def __init__(self, text: str, *, why: str, was_armed: bool) -> None:
        super().__init__(text)
        self.why = why
        """obstacle, as returned by `blocked_by`"""
        self.was_armed = was_armed
        """True if the vehicle was armed and has been disarmed again"""


class CommandFailed(LinkError):
    """A command in flight is not confirmed, or another command has interrupted it."""


class Busy(LinkError):
    """Another procedure runs on this vehicle."""


class Link(Protocol):
    """Interface to one vehicle."""

    async def connect(self, timeout_s: float) -> Identity:
        """Wait for a heartbeat and `identify`. Raises TransportError, NoAnswer, UnsupportedVehicle."""

    async def identify(self, timeout_s: float) -> Identity:
        """Request the identity of a connected vehicle again: another vehicle may have taken the address.

        This changes nothing on the vehicle. Raises NoAnswer.
        """

    async def prepare(self, timeout_s: float, on_waiting: Callable[[tuple[str, ...]], None]) -> None:
        """Request streams, set hold mode and wait until the vehicle is ready to arm.

        `on_waiting` gets the reasons for waiting about once a second. Raises NotReady
        with the last reasons, PrepareFailed.
        """

    async def upload(self, plan: FlightPlan) -> float:
        """Upload a plan on the ground, read it back and compare; return the expected time of a swap [s].

        Raises UploadFailed.
        """

    async def read_parameters(self, names: Collection[str]) -> dict[str, float]:
        """Return the parameters that the vehicle knows, by name. Raises LinkError after an interruption."""

    async def set_parameters(self, values: Mapping[str, float]) -> None:
        """Set the parameters that differ, on the ground, and confirm them. Raises ParametersFailed."""

    async def put_fence(self, polygon: Sequence[LatLon]) -> None:
        """Upload the inclusion polygon on the ground and verify it. Raises FenceFailed, ValueError."""

    async def read_fence(self) -> tuple[MissionItem, ...]:
        """Return the items of the fence on the vehicle. Raises FenceFailed."""

    async def enable_fence(self) -> None:
        """Enable the fences of FENCE_TYPE on a disarmed ArduPilot. Raises FenceFailed."""

    async def count_rally_points(self) -> int:
        """Return the number of rally points on the vehicle. Raises LinkError if it is unknown."""

    async def read_instruments(self) -> Instruments:
        """Return readings of GPS receiver and clock; also renew home and battery in `state`."""

    async def launch(self, blocked_by: Callable[[], str] = lambda: "") -> None:
        """Arm and start the mission; return when the vehicle climbs. THIS ARMS THE VEHICLE.

        `blocked_by` returns the current obstacle to the take-off as text, or "". The link calls `blocked_by`
        right before arming and right before the take-off. No command follows once another party has chosen a
        mode or armed the vehicle. Raises LaunchFailed, and LaunchBlockedError for an obstacle.
        """

    async def swap(self, plan: FlightPlan) -> Swapped:
        """Upload and verify `plan` in flight and fly it, without hold mode if possible.

        If the plan first follows the old plan (`leaves_ahead`), the vehicle continues at its next item. No
        command follows once another party has chosen a mode.
        """

    async def recognise(self, plans: Mapping[int, FlightPlan], candidates: Sequence[int]) -> Recognised:
        """Find out which of this program's plans a vehicle in flight stores and flies; change nothing.

        A recognised mission counts as verified. `plans`, `candidates`: see `procedures.recognise`. Raises
        LinkError if the vehicle cannot be read.
        """

    async def hold(self, *, check_mode_first: bool = False) -> None:
        """Set hold mode; a vehicle that follows set-points in this mode stops. Raises CommandFailed.

        The first command is sent at once in any mode; repetitions stop once another party has chosen a mode.
        If `check_mode_first`, a mode that has just changed stops the first command too; use this for commands
        that no operator has given. The same applies to `return_home` and `land`.
        """

    async def follow_setpoints(self) -> None:
        """Make a vehicle that flies its mission follow set-points. Raises CommandFailed.

        No command follows once another party has chosen a mode. The caller sends
        set-points from before this call on: PX4 refuses the mode without them.
        """

    def send_setpoint(self, setpoint: SetPoint) -> bool:
        """Send a set-point now, also during another call, without an answer; return whether it was sent.

        False: the vehicle is not connected, or does not follow set-points, such as a fixed wing. A vehicle in
        another mode ignores set-points, but PX4 returns to OFFBOARD if it left OFFBOARD for want of them.
        Raises ValueError for a set-point that is incomplete or not finite.
        """

    async def set_speed(self, speed_m_s: float) -> None:
        """Set the speed until the mode changes. Raises CommandFailed, also outside of mission mode."""

    async def return_home(self, *, check_mode_first: bool = False) -> None:
        """Set return mode. Raises CommandFailed."""

    async def land(self, *, check_mode_first: bool = False) -> None:
        """Land at the current position; a fixed wing lands at a landing of its mission. Raises CommandFailed.

        A fixed wing on the ground is disarmed. Before a command that disarms or may arm, the mode is always
        checked.
        """

    def state(self) -> VehicleState:
        """Return the last known state."""

    def age_s(self) -> float:
        """Return the time since the last heartbeat, by the event loop's clock [s]; inf before the first."""

    def items(self) -> tuple[MissionItem, ...]:
        """Return the mission items last verified on the vehicle, with item 0.

        Empty if none was verified, or if the mission on the vehicle has possibly changed since.
        """

    def close(self) -> None:
        """Stop timers, leave the front end, close the tlog. Idempotent."""
