"""Flight plans that are the same for every autopilot, and the mission items on the wire.

An agent decides on a `FlightPlan`. The autopilot dialects in `swarmctl.mavlink` turn the plan into the
`MissionItem`s of one firmware (home placeholder, frames, first sequence number).
"""

from __future__ import annotations

import math

import msgspec
from msgspec.structs import force_setattr

MAX_OVERSHOOT_M = 8.0
"""Default of `FlightPlan.max_overshoot_m` [m]."""


class Waypoint(msgspec.Struct, frozen=True):
    """A point to fly over: WGS-84 degrees, altitude above home [m]."""

    lat_deg: float
    lon_deg: float
    alt_rel_m: float


class Approach(msgspec.Struct, frozen=True):
    """The landing of a fixed wing.

    The vehicle descends in a circle to the height of `final`, and leaves the circle straight to `final`. From
    `final` it descends on a straight slope to `touchdown`.
    """

    centre: Waypoint
    """centre of the circle, at the altitude of `final`"""
    radius_m: float
    """radius of the circle [m]; negative: counter-clockwise"""
    final: Waypoint
    touchdown: Waypoint


class FlightPlan(msgspec.Struct, frozen=True):
    """A take-off, a flight along `track`, and a landing at `landing`.

    `landing.alt_rel_m` is the altitude at which the descent begins. Some firmwares refuse a mission without a
    take-off, so a plan made in flight has a take-off, too. A flying vehicle skips the take-off.
    """

    takeoff_alt_m: float
    track: tuple[Waypoint, ...]
    landing: Waypoint
    turn_radius_m: float = 0.0
    """radius of the arc that touches both legs of a waypoint [m]; 0: the vehicle turns over the waypoint"""
    approach: Approach | None = None
    """landing of a fixed wing at `landing`; None: vertical descent"""
    home_approach: Approach | None = None
    """landing of a fixed wing at its place of take-off, for a return"""
    begins: Waypoint | None = None
    """position at the time of planning; None on the ground"""
    leaves_ahead: bool = False
    """True if the plan first follows the plan being flown, and leaves it at a splice point ahead"""
    max_overshoot_m: float = MAX_OVERSHOOT_M
    """greatest distance past the splice point at which a copter may stop for this plan [m]"""
    from_hold: bool = False
    """True if the vehicle is in hold mode by its agent's order at the time of planning"""

    @property
    def height_m(self) -> float:
        """Height of the flight above home [m]."""
        return self.landing.alt_rel_m

    @property
    def waypoints(self) -> tuple[Waypoint, ...]:
        """All points of the flight before the descent, from the position at the time of planning if known."""
        return self.track if self.begins is None else (self.begins, *self.track)


class MissionItem(msgspec.Struct, frozen=True):
    """One MISSION_ITEM_INT without its address: positions in degrees × 1e7 as on the wire.

    The vehicle chooses the value of a NaN parameter. Items with NaN in the same parameters are equal.
    """

    command: int
    """MAV_CMD"""
    frame: int
    """MAV_FRAME"""
    x: int
    """latitude [degE7]"""
    y: int
    """longitude [degE7]"""
    z: float
    """altitude [m] in `frame`"""
    param1: float = 0.0
    param2: float = 0.0
    param3: float = 0.0
    param4: float = 0.0
    autocontinue: int = 1

    def __post_init__(self) -> None:
        for name in ("param1", "param2", "param3", "param4"):
            if math.isnan(getattr(self, name)):
                # Records with NaN are equal only if both hold the same NaN object, so all items share one.
                force_setattr(self, name, math.nan)
