"""Set-points of a ground station or companion computer: positions, velocities, accelerations and attitudes.

A vehicle in a guided mode obeys SET_POSITION_TARGET_LOCAL_NED, SET_POSITION_TARGET_GLOBAL_INT and
SET_ATTITUDE_TARGET. The personality reads the target of a message. The vehicle flies to a position and holds
that position. A velocity, an acceleration or an attitude expires if no further set-point arrives.
"""

import math
from typing import Any

from sim_vehicle.epoch import EPSILON_S
from sim_vehicle.vehicle.attitude_setpoints import AttitudeSetpoints
from sim_vehicle.vehicle.behaviour import Behaviour, Mode
from sim_vehicle.vehicle.interface import Vehicle
from sim_vehicle.vehicle.setpoint_target import NOTHING, STOP, Target

NEVER_S = -math.inf


class Setpoints:
    """The set-points of one vehicle and their expiry."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._last_received_s = NEVER_S
        self._expires = False  # the current set-point is a velocity, an acceleration or an attitude
        self._moving: Target | None = None  # the current set-point has a position
        self._lost: tuple[Mode, Mode] | None = None  # mode without its set-points, mode of the failsafe
        self._attitude = AttitudeSetpoints(vehicle)

    def reset(self) -> None:
        """Forget the current set-point; the time of the last message stays."""
        self._expires, self._moving = False, None
        self._attitude.reset()

    def mode_chosen(self) -> None:
        """Forget the mode of lost set-points, because a ground station has chosen a mode."""
        self._lost = None

    def streaming(self, now: float) -> bool:
        """Return True if the latest set-point is younger than `setpoints.timeout_s`."""
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
        vehicle, moving = self._vehicle, self._moving
        self.reset()
        if vehicle.mode.setpoints_only:
            self._act(now)
        elif vehicle.mode.behaviour is Behaviour.GUIDED and vehicle.flight.flying:
            if moving is None:
                vehicle.body.stop()
            else:
                self._rest(moving)

    def _act(self, now: float) -> None:
        vehicle = self._vehicle
        lost, parameters = vehicle.mode, vehicle.flight_parameters.setpoints
        vehicle.announce("setpoints_lost")
        # PX4 enters a pilot's mode also without a pilot: then a copter sinks (`Piloting`).
        if parameters.mode is not None and not (vehicle.body.plane and vehicle.remote.missing(now)):
            vehicle.announce("failsafe")
            vehicle.modes.enter(parameters.mode)
        else:
            vehicle.failsafes.act(parameters.action, now, at_once=True)
        if vehicle.personality.setpoints.resumes and not vehicle.mode.terminates:
            self._lost = lost, vehicle.mode

    def _rest(self, moving: Target) -> None:
        """Stop turning, at the place to which a position has moved."""
        vehicle = self._vehicle
        following = vehicle.flight_parameters.setpoints.following
        if following is not None:
            velocity_m_s = STOP.velocity_m_s if moving.has_velocity else NOTHING
            vehicle.body.follow(vehicle.body.target_m, velocity_m_s, NOTHING, following)
            if moving.yaw_rate_rad_s is not None:
                vehicle.body.turn(moving.yaw_rad, 0.0)

    def receive(self, message: Any, now: float) -> None:
        """Process one set-point message at `now` [s]."""
        vehicle = self._vehicle
        attitude, target = message.get_type() == "SET_ATTITUDE_TARGET", None
        if not attitude:
            target = vehicle.personality.setpoints.read(vehicle, message)
            if target is None:
                return
        since_s = now - self._last_received_s
        self._last_received_s = now
        self._resume()
        # In a `setpoints_only` mode a set-point can start the take-off.
        ready = vehicle.armed if vehicle.mode.setpoints_only else vehicle.flight.flying
        if vehicle.mode.behaviour is not Behaviour.GUIDED or not ready:
            return
        if target is not None:
            self._attitude.reset()
            self._fly(target, since_s)
        elif self._attitude.apply(message, since_s):
            self._expires, self._moving, vehicle.flight.taking_off = True, None, False

    def _resume(self) -> None:
        """Return into the mode whose set-points were lost, if the vehicle still flies the failsafe."""
        if self._lost is None:
            return
        (lost, entered), self._lost = self._lost, None
        if self._vehicle.mode is entered and self._vehicle.flight.flying:
            self._vehicle.modes.enter(lost.number)

    def _fly(self, target: Target, since_s: float) -> None:
        vehicle = self._vehicle
        flight, body, following = vehicle.flight, vehicle.body, vehicle.flight_parameters.setpoints.following
        flight.taking_off = False
        rests = target.has_position and not target.has_velocity
        self._expires = not rests or target.yaw_rate_rad_s is not None
        if following is None or not (target.has_position or target.has_velocity):
            self._moving = None
            self._fly_simply(target, since_s)
            return
        self._moving = target if target.has_position else None
        flight.guided_target_m = target.position_m if rests and _complete(target.position_m) else None
        body.follow(target.position_m, target.velocity_m_s, target.acceleration_m_s2, following)
        self._turn(target)

    def _fly_simply(self, target: Target, since_s: float) -> None:
        """Fly a plane to a position or at a velocity, or accelerate."""
        body = self._vehicle.body
        if target.has_position:
            if _complete(target.position_m):
                self._vehicle.flight.go(target.position_m)
                body.face(target.yaw_rad)
        elif target.has_velocity:
            body.move(target.velocity_m_s, yaw_rad=target.yaw_rad, yaw_rate_rad_s=target.yaw_rate_rad_s)
        else:
            self._accelerate(target, since_s)

    def _accelerate(self, target: Target, since_s: float) -> None:
        """Apply an acceleration: a copter tilts and climbs or sinks, a plane integrates the velocity."""
        body = self._vehicle.body
        east, north, up = target.acceleration_m_s2
        duration_s = since_s if since_s < self._vehicle.flight_parameters.setpoints.timeout_s else 0.0
        velocity_m_s = body.velocity_m_s
        climb_m_s = velocity_m_s[2] + up * duration_s
        yaw_rad, rate_rad_s = target.yaw_rad, target.yaw_rate_rad_s
        if body.plane:
            horizontal_m_s = (velocity_m_s[0] + east * duration_s, velocity_m_s[1] + north * duration_s)
            body.move((*horizontal_m_s, climb_m_s), yaw_rad=yaw_rad, yaw_rate_rad_s=rate_rad_s)
            return
        body.tilt((east, north), climb_m_s, yaw_rad=yaw_rad, yaw_rate_rad_s=rate_rad_s)

    def _turn(self, target: Target) -> None:
        """Turn to the yaw or at the yaw rate of a set-point, else along the course or not at all."""
        vehicle = self._vehicle
        body, following = vehicle.body, vehicle.flight_parameters.setpoints.following
        if target.yaw_rad is not None or target.yaw_rate_rad_s is not None:
            body.turn(target.yaw_rad, target.yaw_rate_rad_s)
        elif following is not None and following.faces_course:
            body.face(None)
        else:
            body.face(body.heading_rad)


def _complete(position_m: tuple[float, float, float]) -> bool:
    return all(map(math.isfinite, position_m))
