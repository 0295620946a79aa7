"""Items of missions, fences and rally points, as a ground station sends them."""

from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

MISSION = int(mavlink.MAV_MISSION_TYPE_MISSION)
RELATIVE = int(mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)
FLOAT_FRAMES = {
    mavlink.MAV_FRAME_GLOBAL_INT: mavlink.MAV_FRAME_GLOBAL,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT: mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
    mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT: mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT,
}  # frame of an integer position -> frame of the same position in floating point


@dataclass(frozen=True, slots=True)
class PlanItem:
    """An outgoing item: x, y [1e-7 deg], z [m] in `frame` (MAV_FRAME)."""

    command: int
    x: int = 0
    y: int = 0
    z: float = 0.0
    frame: int = RELATIVE
    params: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)

    def message(
        self, target: tuple[int, int], seq: int, kind: int = MISSION, *, as_float: bool = False
    ) -> Any:
        """Return MISSION_ITEM_INT, or the legacy MISSION_ITEM; `kind` is the MAV_MISSION_TYPE."""
        # The field `current` is 0, because PX4 would start at an item with 1.
        if as_float:
            frame = FLOAT_FRAMES.get(self.frame, self.frame)
            head = (*target, seq, frame, self.command, 0, 1, *self.params)
            return mavlink.MAVLink_mission_item_message(*head, self.x / 1e7, self.y / 1e7, self.z, kind)
        head = (*target, seq, self.frame, self.command, 0, 1, *self.params)
        return mavlink.MAVLink_mission_item_int_message(*head, self.x, self.y, self.z, kind)
