"""The target that an autopilot takes from SET_POSITION_TARGET_LOCAL_NED or SET_POSITION_TARGET_GLOBAL_INT."""

import math
from dataclasses import dataclass
from typing import Any

from sim_vehicle.vehicle.interface import Vehicle

IGNORE_POSITION, IGNORE_VELOCITY, IGNORE_ACCELERATION = 0x0007, 0x0038, 0x01C0
FORCE, IGNORE_YAW, IGNORE_YAW_RATE = 0x0200, 0x0400, 0x0800
MAX_COORDINATE_M = 1e5
Vector = tuple[float, float, float]
NOTHING: Vector = (math.nan, math.nan, math.nan)


@dataclass(frozen=True, slots=True)
class Target:
    """East, north, up in the fleet's frame; nan: this axis has none."""

    position_m: Vector = NOTHING
    velocity_m_s: Vector = NOTHING
    acceleration_m_s2: Vector = NOTHING
    yaw_rad: float | None = None  # from north
    yaw_rate_rad_s: float | None = None

    @property
    def has_position(self) -> bool:
        return any(map(math.isfinite, self.position_m))

    @property
    def has_velocity(self) -> bool:
        return any(map(math.isfinite, self.velocity_m_s))


STOP = Target(velocity_m_s=(0.0, 0.0, 0.0))


def rotated(vehicle: Vehicle, forward: float, right: float) -> tuple[float, float]:
    """Return north and east of a vector forward and right of the vehicle."""
    heading_rad = vehicle.body.heading_rad
    sin, cos = math.sin(heading_rad), math.cos(heading_rad)
    return forward * cos - right * sin, forward * sin + right * cos


def east_north_up(north: float, east: float, down: float) -> Vector:
    return east, north, -down


def yaw(message: Any) -> tuple[float | None, float | None]:
    """Return the yaw [rad] and the yaw rate [rad/s] of a message, each or None."""
    has_yaw = not message.type_mask & IGNORE_YAW and math.isfinite(message.yaw)
    has_rate = not message.type_mask & IGNORE_YAW_RATE and math.isfinite(message.yaw_rate)
    return float(message.yaw) if has_yaw else None, float(message.yaw_rate) if has_rate else None
