"""Set-points of a ground station or companion computer: positions, velocities, accelerations and attitudes.

A vehicle in a guided mode obeys SET_POSITION_TARGET_LOCAL_NED, SET_POSITION_TARGET_GLOBAL_INT and
SET_ATTITUDE_TARGET. The vehicle flies to a position and holds that position. A velocity, an acceleration or
an attitude expires if no further set-point arrives.
"""

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.epoch import EPSILON_S
from sim_vehicle.vehicle.attitude_setpoints import AttitudeSetpoints
from sim_vehicle.vehicle.behaviour import Behaviour
from sim_vehicle.vehicle.commands import FRAMES_WITH_ALTITUDE
from sim_vehicle.vehicle.interface import Vehicle

IGNORE_POSITION, IGNORE_VELOCITY, IGNORE_ACCELERATION = 0x0007, 0x0038, 0x01C0
IGNORE_YAW, IGNORE_YAW_RATE = 0x0400, 0x0800
BODY_FRAMES = frozenset(
    {mavlink.MAV_FRAME_BODY_NED, mavlink.MAV_FRAME_BODY_OFFSET_NED, mavlink.MAV_FRAME_BODY_FRD}
)
RELATIVE_YAW_FRAMES = frozenset({mavlink.MAV_FRAME_BODY_NED, mavlink.MAV_FRAME_BODY_OFFSET_NED})
LOCAL_FRAMES = BODY_FRAMES | {mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_LOCAL_OFFSET_NED}
MAX_COORDINATE_M = 1e5
NEVER_S = -math.inf


def _usable(message: Any) -> bool:
    """Return True for an attitude, or for a known frame with a finite, unignored vector."""
    if message.get_type() == "SET_ATTITUDE_TARGET":
        return True
    is_global = message.get_type() == "SET_POSITION_TARGET_GLOBAL_INT"
    if message.coordinate_frame not in (FRAMES_WITH_ALTITUDE if is_global else LOCAL_FRAMES):
        return False
    position = (
        (message.lat_int, message.lon_int, message.alt) if is_global else (message.x, message.y, message.z)
    )
    vectors = (
        (IGNORE_POSITION, position),
        (IGNORE_VELOCITY, (message.vx, message.vy, message.vz)),
        (IGNORE_ACCELERATION, (message.afx, message.afy, message.afz)),
    )
    return any(
        not message.type_mask & ignored and all(map(math.isfinite, values)) for ignored, values in vectors
    )


class Setpoints:
    """The set-points of one vehicle and their expiry."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._last_received_s = NEVER_S
        self._expires = False  # the current set-point is a velocity, an acceleration or an attitude
        self._attitude = AttitudeSetpoints(vehicle)

    def reset(self) -> None:
        """Forget the current set-point; the time of the last message stays."""
        self._expires = False
        self._attitude.reset()

    def streaming(self, now: float) -> bool:
        """Return True if the latest set-point is younger than `setpoint_timeout_s`."""
        return now - self._last_received_s < self._vehicle.flight_parameters.setpoints.timeout_s

    @property
    def next_deadline_s(self) -> float:
        """Time at which the set-point, or a required stream of set-points, expires [s]; inf: never."""
        vehicle = self._vehicle
        expires = vehicle.flight.flying if vehicle.mode.setpoints_only else self._expires
        return self._last_received_s + vehicle.flight_parameters.setpoints.timeout_s if expires else math.inf

    def expire(self, now: float) -> None:
        """End an expired set-point: act on a lost stream, or stop in guided flight."""
        if now + EPSILON_S < self.next_deadline_s:
            return
        vehicle = self._vehicle
        self.reset()
        if vehicle.mode.setpoints_only:
            vehicle.announce("setpoints_lost")
            mode = vehicle.flight_parameters.setpoints.mode
            if mode is not None and not vehicle.remote.missing(now):
                vehicle.modes.enter(mode)
                return
            vehicle.failsafes.act(vehicle.flight_parameters.setpoints.action, now, at_once=True)
        elif vehicle.mode.behaviour is Behaviour.GUIDED and vehicle.flight.flying:
            vehicle.body.stop()

    def receive(self, message: Any, now: float) -> None:
        """Process one set-point message at `now` [s]."""
        if not _usable(message):
            return
        since_s = now - self._last_received_s
        self._last_received_s = now
        vehicle = self._vehicle
        # In a `setpoints_only` mode a set-point can start the take-off.
        ready = vehicle.armed if vehicle.mode.setpoints_only else vehicle.flight.flying
        if vehicle.mode.behaviour is not Behaviour.GUIDED or not ready:
            return
        if message.get_type() == "SET_ATTITUDE_TARGET":
            if self._attitude.apply(message, since_s):
                self._expires, vehicle.flight.taking_off = True, False
            return
        self._attitude.reset()
        if not message.type_mask & IGNORE_POSITION:
            self._position(message)
        elif not message.type_mask & IGNORE_VELOCITY:
            self._velocity(message)
        elif not message.type_mask & IGNORE_ACCELERATION:
            self._acceleration(message, since_s)

    def _position(self, message: Any) -> None:
        flight, body = self._vehicle.flight, self._vehicle.body
        frame = message.coordinate_frame
        if message.get_type() == "SET_POSITION_TARGET_GLOBAL_INT":
            lat_deg, lon_deg = message.lat_int * 1e-7, message.lon_int * 1e-7
            if frame not in FRAMES_WITH_ALTITUDE or abs(lat_deg) > 90 or abs(lon_deg) > 180:
                return
            if not abs(message.alt) < MAX_COORDINATE_M:  # also excludes NaN
                return
            target_m = (*body.locate(lat_deg, lon_deg), flight.altitude_amsl_m(frame, message.alt))
        else:
            if frame not in LOCAL_FRAMES or not all(
                abs(v) < MAX_COORDINATE_M for v in (message.x, message.y, message.z)
            ):
                return
            target_m = self._local_m(frame, message.x, message.y, message.z)
        self._expires = False
        flight.taking_off = False
        flight.go(target_m)
        self._vehicle.body.face(self._yaw_rad(message))

    def _local_m(self, frame: int, x: float, y: float, z: float) -> tuple[float, float, float]:
        """Convert x, y, z in `frame` to east, north, up in the fleet's frame [m]."""
        body = self._vehicle.body
        if frame in BODY_FRAMES:
            x, y = self._north_east(x, y)
        if frame == mavlink.MAV_FRAME_LOCAL_NED:
            east_m, north_m, up_m = self._vehicle.home_and_rally.origin_m
        else:
            east_m, north_m, up_m = body.position_m
        return east_m + y, north_m + x, up_m - z

    def _north_east(self, forward: float, right: float) -> tuple[float, float]:
        heading_rad = self._vehicle.body.heading_rad
        north = forward * math.cos(heading_rad) - right * math.sin(heading_rad)
        return north, forward * math.sin(heading_rad) + right * math.cos(heading_rad)

    def _velocity(self, message: Any) -> None:
        north, east, down = message.vx, message.vy, message.vz
        if not all(math.isfinite(v) for v in (north, east, down)):
            return
        if message.coordinate_frame in BODY_FRAMES:
            north, east = self._north_east(north, east)
        self._move((east, north, -down), message)

    def _move(self, velocity_m_s: tuple[float, float, float], message: Any) -> None:
        self._expires, self._vehicle.flight.taking_off = True, False
        yaw_rad, rate_rad_s = self._turning(message)
        self._vehicle.body.move(velocity_m_s, yaw_rad=yaw_rad, yaw_rate_rad_s=rate_rad_s)

    def _acceleration(self, message: Any, since_s: float) -> None:
        """Apply an acceleration: a copter tilts and climbs or sinks, a plane integrates the velocity."""
        north, east, down = message.afx, message.afy, message.afz
        if not all(math.isfinite(a) for a in (north, east, down)):
            return
        if message.coordinate_frame in BODY_FRAMES:
            north, east = self._north_east(north, east)
        body = self._vehicle.body
        duration_s = since_s if since_s < self._vehicle.flight_parameters.setpoints.timeout_s else 0.0
        velocity_m_s = body.velocity_m_s
        climb_m_s = velocity_m_s[2] - down * duration_s
        if body.plane:
            horizontal_m_s = (velocity_m_s[0] + east * duration_s, velocity_m_s[1] + north * duration_s)
            self._move((*horizontal_m_s, climb_m_s), message)
            return
        self._expires, self._vehicle.flight.taking_off = True, False
        yaw_rad, rate_rad_s = self._turning(message)
        body.tilt((east, north), climb_m_s, yaw_rad=yaw_rad, yaw_rate_rad_s=rate_rad_s)

    def _turning(self, message: Any) -> tuple[float | None, float | None]:
        """Return the commanded yaw from north [rad] and the commanded yaw rate [rad/s], each or None."""
        ignored = message.type_mask & IGNORE_YAW_RATE or not math.isfinite(message.yaw_rate)
        return self._yaw_rad(message), None if ignored else message.yaw_rate

    def _yaw_rad(self, message: Any) -> float | None:
        if message.type_mask & IGNORE_YAW or not math.isfinite(message.yaw):
            return None
        yaw_rad = float(message.yaw)
        relative = message.coordinate_frame in RELATIVE_YAW_FRAMES
        if relative and self._vehicle.personality.messages.body_yaw_relative:
            return self._vehicle.body.heading_rad + yaw_rad
        return yaw_rad
