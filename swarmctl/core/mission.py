"""What a vehicle is asked to fly, free of any autopilot's habits.

A `FlightPlan` is what an agent decides; the autopilot dialects in `swarmctl.mavlink` turn it into the
`MissionItem`s of one firmware (home placeholder, frames, which sequence number comes first).
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Waypoint:
    """A point to fly over: WGS-84 degrees, altitude above home [m]."""

    lat_deg: float
    lon_deg: float
    alt_rel_m: float


@dataclass(frozen=True, slots=True)
class Approach:
    """How a fixed wing comes down: round a circle to the height of `final`, out of the circle straight on to
    `final`, and from there down a straight slope to `touchdown`."""

    centre: Waypoint
    """of the circle; its altitude is that of `final`"""
    radius_m: float
    """negative: it is flown counter-clockwise"""
    final: Waypoint
    touchdown: Waypoint


@dataclass(frozen=True, slots=True)
class FlightPlan:
    """Take off where the vehicle stands, fly `track` in order, land at `landing`.

    `landing.alt_rel_m` is the altitude from which the vehicle comes down. A plan for a vehicle that flies
    already still has its take-off, because some firmwares refuse a mission without one; it is then started
    at the first waypoint.
    """

    takeoff_alt_m: float
    track: tuple[Waypoint, ...]
    landing: Waypoint
    turn_radius_m: float = 0.0
    """it turns off before a waypoint, on an arc that touches both legs; 0: over it"""
    approach: Approach | None = None
    """to `landing`, of a fixed wing; None: it comes down on the spot"""
    home_approach: Approach | None = None
    """to where it took off, for when it returns"""
    begins: Waypoint | None = None
    """where the vehicle is when it is made, in flight"""
    leaves_ahead: bool = False
    """`track` begins as the plan goes that is flown then, and leaves that farther on"""
    from_hold: bool = False
    """the vehicle stands in its hold mode then, because its agent has had it hold"""

    @property
    def waypoints(self) -> tuple[Waypoint, ...]:
        """All that is flown over, before it comes down."""
        return self.track if self.begins is None else (self.begins, *self.track)


@dataclass(frozen=True, slots=True)
class MissionItem:
    """One MISSION_ITEM_INT without its address: positions in degrees × 1e7 as on the wire.

    A parameter that is no number leaves something to the vehicle; items are equal that both do.
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
                # Equal to itself alone: so it is always the same one.
                object.__setattr__(self, name, math.nan)
