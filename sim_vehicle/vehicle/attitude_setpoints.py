"""Set-points of attitude and body rates.

The tilt accelerates the vehicle horizontally. The vehicle climbs above hover thrust and sinks below it.
"""

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.physics.attitude import angles_rad
from sim_vehicle.physics.copter import MAX_LEAN_RAD, lean_acceleration_m_s2
from sim_vehicle.vehicle.interface import Vehicle

HOVER_THRUST = 0.5
RATE_IGNORE_BITS = (
    mavlink.ATTITUDE_TARGET_TYPEMASK_BODY_ROLL_RATE_IGNORE,
    mavlink.ATTITUDE_TARGET_TYPEMASK_BODY_PITCH_RATE_IGNORE,
    mavlink.ATTITUDE_TARGET_TYPEMASK_BODY_YAW_RATE_IGNORE,
)
MAX_RATE_TIME_S = 0.5  # longest time over which the previous rates are integrated


class AttitudeSetpoints:
    """SET_ATTITUDE_TARGET messages of one vehicle."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._angles_rad: tuple[float, float] | None = None  # roll and pitch integrated from rates
        self._rates_rad_s = (0.0, 0.0)

    def reset(self) -> None:
        """Forget the attitude integrated from body rates."""
        self._angles_rad, self._rates_rad_s = None, (0.0, 0.0)

    def apply(self, message: Any, since_s: float) -> bool:
        """Apply a message `since_s` [s] after the previous message; return False for unusable values."""
        if message.type_mask & mavlink.ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE:
            return self._apply_rates(message, since_s)
        self.reset()
        if not all(math.isfinite(q) for q in message.q) or not any(message.q):
            return False
        roll, pitch, yaw = angles_rad(message.q)
        self._apply(roll, pitch, yaw, message.thrust, None)
        return True

    def _apply_rates(self, message: Any, since_s: float) -> bool:
        commanded = (message.body_roll_rate, message.body_pitch_rate, message.body_yaw_rate)
        ignored = [bool(message.type_mask & bit) for bit in RATE_IGNORE_BITS]
        if all(ignored) or not all(math.isfinite(rate) for rate in commanded):
            return False
        attitude_rad = self._vehicle.body.attitude_rad
        angles = self._angles_rad or attitude_rad[:2]
        duration_s = min(since_s, MAX_RATE_TIME_S)
        integrated = [
            angle + rate * duration_s for angle, rate in zip(angles, self._rates_rad_s, strict=True)
        ]
        roll, pitch = (max(-MAX_LEAN_RAD, min(angle, MAX_LEAN_RAD)) for angle in integrated)
        self._angles_rad = roll, pitch
        rates = [0.0 if is_ignored else rate for is_ignored, rate in zip(ignored, commanded, strict=True)]
        self._rates_rad_s = rates[0], rates[1]
        self._apply(roll, pitch, attitude_rad[2], message.thrust, rates[2])
        return True

    def _apply(self, roll: float, pitch: float, yaw: float, thrust: float, yaw_rate: float | None) -> None:
        """Fly with angles [rad] and thrust in [0, 1]; `yaw_rate` [rad/s] replaces the turn to `yaw`."""
        flight_parameters, body = self._vehicle.flight_parameters, self._vehicle.body
        excess = min(max(thrust, 0.0), 1.0) - HOVER_THRUST if math.isfinite(thrust) else 0.0
        max_climb_m_s = (
            flight_parameters.limits.climb_m_s if excess > 0 else flight_parameters.limits.descent_m_s
        )
        climb_m_s = 2 * excess * max_climb_m_s
        east, north = lean_acceleration_m_s2(roll, pitch, yaw)
        yaw_rad = yaw if yaw_rate is None else None
        if body.plane:
            # The target of a plane is its velocity after 1 s of this acceleration.
            velocity_m_s = body.velocity_m_s
            target_m_s = (velocity_m_s[0] + east, velocity_m_s[1] + north, climb_m_s)
            body.move(target_m_s, yaw_rad=yaw_rad, yaw_rate_rad_s=yaw_rate)
            return
        body.tilt((east, north), climb_m_s, yaw_rad=yaw_rad, yaw_rate_rad_s=yaw_rate)
