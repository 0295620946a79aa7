"""A ground station for tests with one PX4 vehicle."""

import math
from collections.abc import Sequence
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import ALT_M, Station, fleet_of, item

from sim_vehicle.personalities import personality_of
from sim_vehicle.station.messages import to_wire

ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED, FAILED = 0, 1, 2, 3, 4
MODES = {  # name: main and sub mode
    "Manual": (1, 0), "Altitude": (2, 0), "Position": (3, 0), "Acro": (5, 0), "Offboard": (6, 0),
    "Stabilized": (7, 0), "Takeoff": (4, 2), "Hold": (4, 3), "Mission": (4, 4), "Return": (4, 5),
    "Land": (4, 6), "Follow Target": (4, 8),
}  # fmt: skip
NAN = math.nan


def command_item(command: int, **fields: float) -> dict[str, Any]:
    """Return a mission command without a position, in PX4's frame for it."""
    return item(command, frame=mavlink.MAV_FRAME_MISSION, x=0, y=0, **fields)


class Px4Station(Station):
    """A station with the modes of PX4, and missions without a home placeholder."""

    def __init__(self, kind: str = "copter", **options: Any) -> None:
        super().__init__(fleet_of(kind, personality="px4", **options))

    def set_mode(self, name: str) -> int:
        return self.command(mavlink.MAV_CMD_DO_SET_MODE, 1, *MODES[name])

    def reposition(self, north_m: float, height_m: float, *params: float) -> int:
        return super().reposition(north_m, ALT_M + height_m, *(params or (-1, 1, 0, NAN)))

    def ask(self, message_id: int) -> Any:
        """Request a message and return it; MISSION_CURRENT, which PX4 only streams, is the latest one."""
        if message_id != mavlink.MAVLINK_MSG_ID_MISSION_CURRENT:
            return super().ask(message_id)
        if not self.of("MISSION_CURRENT"):
            self.stream(message_id, hz=10)
            self.wait(0.2)
        return self.of("MISSION_CURRENT")[-1]

    def upload_and_wait(self, items: Sequence[dict[str, Any]]) -> None:
        """Upload and wait for the vehicle's check of the mission."""
        assert self.upload(items) == 0
        self.wait(1.0)

    def fly_mission(self, items: Sequence[dict[str, Any]]) -> None:
        """Upload, and arm in the mission mode."""
        self.upload_and_wait(items)
        assert self.set_mode("Mission") == 0
        assert self.arm() == 0

    def fly(self, height_m: float = 20.0) -> None:
        """Arm, take off and hold at a height."""
        assert self.arm() == 0
        nowhere = (NAN, NAN, NAN, NAN, NAN, NAN)
        assert self.command(mavlink.MAV_CMD_NAV_TAKEOFF, *nowhere, ALT_M + height_m) == 0
        self.until(lambda: self.mode == "Hold", 60)
        assert abs(self.height_m - height_m) < 1.0

    def set_parameter(self, name: str, value: float | int) -> Any:
        """Send PARAM_SET, integers as their bytes; return the PARAM_VALUE."""
        kind = mavlink.MAV_PARAM_TYPE_INT32 if isinstance(value, int) else mavlink.MAV_PARAM_TYPE_REAL32
        return self._set(name, to_wire(value, kind, byte_wise=True), kind)


class QuietPx4Station(Px4Station):
    """A station of a vehicle without a log and default streams: a flight takes a third of the time."""

    def __init__(
        self, kind: str = "copter", *, params: dict[str, float] | None = None, **options: Any
    ) -> None:
        super().__init__(kind, params={"SDLOG_MODE": -1} | (params or {}), **options)
        before = len(self.received)
        for message_id in personality_of("px4", kind).telemetry.default_rates_hz:
            self.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, message_id, -1)
        del self.received[before:]
