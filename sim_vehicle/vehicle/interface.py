"""Types between the parts of one vehicle, and the protocol of its remote control.

The vehicle imports its parts. The parts know the vehicle's type only, so at run time they do not import it.
"""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

from sim_vehicle.vehicle.command import Command
from sim_vehicle.vehicle.sticks import Sticks

if TYPE_CHECKING:
    from sim_vehicle.vehicle.autopilot import Autopilot
    from sim_vehicle.vehicle.flight import Flight

Vehicle: TypeAlias = "Autopilot"
FlightControl: TypeAlias = "Flight"
CommandHandler = Callable[[Vehicle, Command, float], int]  # vehicle, command, time [s] -> MAV_RESULT
OneShotMessage = Callable[[Vehicle, float], Sequence[Any]]  # vehicle, param2 of the request -> messages


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
