"""Sticks: a pilot's input from a remote control or a joystick, and its limits."""

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Sticks:
    """Positions of the sticks: roll right, pitch forward, yaw clockwise in [-1, 1], throttle in [0, 1]."""

    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0
    throttle: float = 0.5


@dataclass(frozen=True, slots=True)
class PilotLimits:
    """Full deflections of the sticks, and the shape of their response."""

    lean_deg: float = 30.0  # plane: bank
    yaw_rate_deg_s: float = 150.0
    climb_m_s: float = 2.5
    descent_m_s: float = 2.5
    vertical_acceleration_m_s2: float = 2.5
    speed_m_s: float = 10.0  # horizontal, in a position mode
    acceleration_m_s2: float = 5.0
    throttle_deadzone: float = 0.1  # on both sides of the middle, where a copter keeps its altitude
    deadzone: float = 0.0  # of the other sticks
    expo: float = 0.0  # share of the third power in the response of a position or altitude mode
    hover_throttle: float = 0.5  # output that carries the weight; the middle of the stick
    idle_throttle: float = 0.0  # output at the lowest position of the stick
    throttle_curve: bool = False  # the output follows a cubic curve through hover_throttle, else two lines
    lean_keeps_lift: bool = False  # the autopilot adds thrust while the copter leans
    # plane
    pitch_up_deg: float = 20.0
    pitch_down_deg: float = 25.0

    def response(self, stick: float) -> float:
        """Return a stick's position in [-1, 1] after deadzone and expo."""
        size = max(abs(stick) - self.deadzone, 0.0) / (1.0 - self.deadzone)
        return math.copysign((1.0 - self.expo) * size + self.expo * size**3, stick)

    def climb_rate_m_s(self, throttle: float) -> float:
        """Return the climb rate for a throttle stick in [0, 1]; 0 in the deadzone around the middle."""
        offset = 2.0 * throttle - 1.0
        zone = 2.0 * self.throttle_deadzone
        size = max(abs(offset) - zone, 0.0) / (1.0 - zone)
        size = (1.0 - self.expo) * size + self.expo * size**3
        return size * (self.climb_m_s if offset > 0 else -self.descent_m_s)

    def lift(self, throttle: float) -> float:
        """Return the thrust for a throttle stick in [0, 1], as a multiple of the weight."""
        hover, idle = self.hover_throttle, self.idle_throttle
        if self.throttle_curve:  # Mode::get_pilot_desired_throttle
            expo = min(max(-(hover - 0.5) / 0.375, -0.5), 1.0)
            output = throttle * (1.0 - expo) + expo * throttle**3
        elif throttle < 0.5:
            output = idle + (hover - idle) * 2.0 * throttle
        else:
            output = hover + (1.0 - hover) * (2.0 * throttle - 1.0)
        return output / hover
