"""One MAV_CMD command, independent of the message that carried it."""

from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

MAX_ALTITUDE_M = 83_000.0  # limit of the absolute altitude, as in the mission storage of ArduPilot


def sender_of(message: Any) -> tuple[int, int]:
    """Return the system and component id of the sender."""
    return message.get_srcSystem(), message.get_srcComponent()


@dataclass(frozen=True, slots=True)
class Command:
    """One command; `lat_deg` and `lon_deg` are parameters 5 and 6, `z` [m] is parameter 7."""

    command: int
    param1: float
    param2: float
    param3: float
    param4: float
    lat_deg: float
    lon_deg: float
    z: float
    frame: int
    as_int: bool  # carried by COMMAND_INT
    sender: tuple[int, int]  # system and component id

    @classmethod
    def from_message(cls, message: Any) -> "Command":
        """Read COMMAND_LONG or COMMAND_INT."""
        as_int = message.get_type() == "COMMAND_INT"
        return cls(
            command=message.command,
            param1=message.param1,
            param2=message.param2,
            param3=message.param3,
            param4=message.param4,
            lat_deg=message.x * 1e-7 if as_int else message.param5,
            lon_deg=message.y * 1e-7 if as_int else message.param6,
            z=message.z if as_int else message.param7,
            frame=message.frame if as_int else mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
            as_int=as_int,
            sender=sender_of(message),
        )

    def place(self) -> tuple[float, float] | None:
        """Return latitude and longitude [deg]; None at 0, 0, or if a coordinate or z is out of range."""
        if not (abs(self.lat_deg) <= 90 and abs(self.lon_deg) <= 180 and abs(self.z) < MAX_ALTITUDE_M):
            return None
        return (self.lat_deg, self.lon_deg) if self.lat_deg or self.lon_deg else None
