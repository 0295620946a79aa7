"""Set-points of a ground station or companion: positions, velocities and attitudes, and how long they hold.

SET_POSITION_TARGET_LOCAL_NED, SET_POSITION_TARGET_GLOBAL_INT and SET_ATTITUDE_TARGET, obeyed in guided modes.
A position is flown to and kept; a velocity or an attitude holds only as long as new ones come.
"""

import math
from typing import TYPE_CHECKING, Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.commands import FRAMES_WITH_ALTITUDE
from sim_vehicle.motion import GRAVITY_M_S2
from sim_vehicle.personalities.base import Behaviour

if TYPE_CHECKING:
    from sim_vehicle.autopilot import Autopilot

IGNORE_POSITION, IGNORE_VELOCITY, IGNORE_YAW, IGNORE_YAW_RATE = 0x0007, 0x0038, 0x0400, 0x0800
ATTITUDE_IGNORED = mavlink.ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE
BODY_FRAMES = frozenset(
    {mavlink.MAV_FRAME_BODY_NED, mavlink.MAV_FRAME_BODY_OFFSET_NED, mavlink.MAV_FRAME_BODY_FRD}
)
LOCAL_FRAMES = BODY_FRAMES | {mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_LOCAL_OFFSET_NED}
FAR_M = 1e5
HOVER_THRUST = 0.5
NEVER_S = -math.inf


class Setpoints:
    """The latest set-point of one vehicle, and when it came."""

    def __init__(self, vehicle: "Autopilot") -> None:
        self._vehicle = vehicle
        self._heard_s = NEVER_S
        self._expires = False  # the one in force ends when no other follows
        self._velocity_m_s = (0.0, 0.0, 0.0)

    def reset(self) -> None:
        """Forget it: the mode changed or the vehicle rebooted."""
        self._expires = False

    def streaming(self, now: float) -> bool:
        """Whether one came so recently that a mode that lives on them may be entered."""
        return now - self._heard_s < self._vehicle.tuning.setpoint_timeout_s

    def deadline_s(self, timeout_s: float) -> float:
        """When the one in force ends, if none follows; inf if it holds for ever."""
        return self._heard_s + timeout_s if self._expires else math.inf

    @property
    def heard_s(self) -> float:
        return self._heard_s

    def receive(self, message: Any, now: float) -> None:
        """Take one set-point message at `now` [s]."""
        self._heard_s = now
        vehicle = self._vehicle
        # Only a mode made for set-points takes off by one.
        ready = vehicle.armed if vehicle.mode.setpoints_only else vehicle.flight.flying
        if vehicle.mode.behaviour is not Behaviour.GUIDED or not ready:
            return
        if message.get_type() == "SET_ATTITUDE_TARGET":
            self._attitude(message)
        elif not message.type_mask & IGNORE_POSITION:
            self._position(message)
        elif not message.type_mask & IGNORE_VELOCITY:
            self._velocity(message)

    def _position(self, message: Any) -> None:
        flight, body = self._vehicle.flight, self._vehicle.body
        frame = message.coordinate_frame
        if message.get_type() == "SET_POSITION_TARGET_GLOBAL_INT":
            lat_deg, lon_deg = message.lat_int * 1e-7, message.lon_int * 1e-7
            if frame not in FRAMES_WITH_ALTITUDE or abs(lat_deg) > 90 or abs(lon_deg) > 180:
                return
            if not abs(message.alt) < FAR_M:  # also true for NaN
                return
            target_m = (*body.locate(lat_deg, lon_deg), flight.altitude_amsl_m(frame, message.alt))
        else:
            if frame not in LOCAL_FRAMES or not all(
                abs(v) < FAR_M for v in (message.x, message.y, message.z)
            ):
                return
            target_m = self._local_m(frame, message.x, message.y, message.z)
        self._expires = False
        flight.taking_off = False
        flight.go(target_m)
        self._yaw(message)

    def _local_m(self, frame: int, x: float, y: float, z: float) -> tuple[float, float, float]:
        """North/forward, east/right, down [m] in a local frame -> east, north, up in the fleet's."""
        body = self._vehicle.body
        if frame in BODY_FRAMES:
            x, y = self._turned(x, y)
        if frame == mavlink.MAV_FRAME_LOCAL_NED:
            east_m, north_m, up_m = self._vehicle.origin_m
        else:
            east_m, north_m, up_m = body.position_m
        return east_m + y, north_m + x, up_m - z

    def _turned(self, forward: float, right: float) -> tuple[float, float]:
        heading = self._vehicle.body.heading_rad
        north = forward * math.cos(heading) - right * math.sin(heading)
        return north, forward * math.sin(heading) + right * math.cos(heading)

    def _velocity(self, message: Any) -> None:
        north, east, down = message.vx, message.vy, message.vz
        if not all(math.isfinite(v) for v in (north, east, down)):
            return
        if message.coordinate_frame in BODY_FRAMES:
            north, east = self._turned(north, east)
        self._move((east, north, -down), message)

    def _move(self, velocity_m_s: tuple[float, float, float], message: Any) -> None:
        self._velocity_m_s, self._expires = velocity_m_s, True
        mask = message.type_mask
        yaw_rad = None if mask & IGNORE_YAW or not math.isfinite(message.yaw) else message.yaw
        rate = None if mask & IGNORE_YAW_RATE or not math.isfinite(message.yaw_rate) else message.yaw_rate
        self._vehicle.flight.taking_off = False
        self._vehicle.body.move(velocity_m_s, yaw_rad=yaw_rad, yaw_rate_rad_s=rate)

    def _yaw(self, message: Any) -> None:
        if message.type_mask & IGNORE_YAW or not math.isfinite(message.yaw):
            self._vehicle.body.face(None)
        else:
            self._vehicle.body.face(message.yaw)

    def _attitude(self, message: Any) -> None:
        """Lean angles push the vehicle: their acceleration adds to the velocity until the next message."""
        if message.type_mask & ATTITUDE_IGNORED or not all(math.isfinite(q) for q in message.q):
            return
        w, x, y, z = message.q
        roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
        pitch = math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x))))
        yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        tuning, body = self._vehicle.tuning, self._vehicle.body
        # A lean that is held reaches the speed at which drag balances it: about full speed at 30 degrees.
        scale = tuning.speed_m_s / (GRAVITY_M_S2 * math.tan(math.radians(30.0)))
        forward = -GRAVITY_M_S2 * math.tan(pitch) * scale
        right = GRAVITY_M_S2 * math.tan(roll) * scale
        north = forward * math.cos(yaw) - right * math.sin(yaw)
        east = forward * math.sin(yaw) + right * math.cos(yaw)
        thrust = min(max(message.thrust, 0.0), 1.0) - HOVER_THRUST
        climbs = tuning.climb_m_s if thrust > 0 else tuning.descent_m_s
        self._velocity_m_s, self._expires = (east, north, 2 * thrust * climbs), True
        body.move(self._velocity_m_s, yaw_rad=yaw)
