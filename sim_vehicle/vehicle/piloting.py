"""Flight by sticks: the set-points of the pilot's modes, ten times a second.

A copter leans within its limit, and climbs by its throttle or by a rate. Without a lean in a position mode it
brakes and holds its place. A plane banks, and climbs by its throttle and pitch or at a rate.
"""

import math

from sim_vehicle.physics.copter import lean_acceleration_m_s2
from sim_vehicle.vehicle.behaviour import Behaviour
from sim_vehicle.vehicle.interface import FlightControl
from sim_vehicle.vehicle.sticks import PilotLimits, Sticks

TAKEOFF_LIFT = 1.0  # thrust, as a multiple of the weight, above which a copter leaves the ground


class Piloting:
    """The sticks of one vehicle in a pilot's mode; `begin` enters the mode."""

    def __init__(self, flight: FlightControl) -> None:
        self._flight = flight
        self._limits: PilotLimits | None = None  # limits in force
        self._holds_place = self._climbs = False

    def begin(self) -> None:
        self._limits, self._holds_place, self._climbs = None, False, False

    def run(self, sticks: Sticks) -> None:
        """Fly as the sticks say until the next call."""
        flight = self._flight
        limits = flight.flight_parameters.pilot
        if limits is not self._limits:
            self._limits = limits
            self._apply_limits(limits)
        if flight.body.plane:
            self._fly_plane(sticks, limits)
        elif not flight.body.airborne and not self._takes_off(sticks, limits):
            flight.body.rest()
            self._holds_place = False
        elif flight.vehicle.remote.missing(flight.vehicle.now):
            self._fly_without_pilot()
        elif flight.behaviour is Behaviour.MANUAL:
            self._fly_by_thrust(sticks, limits)
        elif flight.behaviour is Behaviour.POSITION:
            self._fly_by_velocity(sticks, limits)
        else:
            yaw_rate = self._yaw_rate_rad_s(sticks, limits)
            climb_m_s = limits.climb_rate_m_s(sticks.throttle)
            flight.body.tilt(self._lean_m_s2(sticks, limits)[0], climb_m_s, yaw_rate_rad_s=yaw_rate)

    def _fly_without_pilot(self) -> None:
        """Fly level, as PX4 does without manual control; a position or an altitude mode sinks."""
        flight = self._flight
        manual = flight.behaviour is Behaviour.MANUAL
        flight.body.tilt((0.0, 0.0), 0.0 if manual else -flight.flight_parameters.landing.speed_m_s)
        self._holds_place = False

    def _apply_limits(self, limits: PilotLimits) -> None:
        flight = self._flight
        if flight.body.plane:
            flight.limit(bank_limit_deg=limits.lean_deg)
            return
        flight.limit(
            yaw_rate_deg_s=limits.yaw_rate_deg_s,
            climb_m_s=limits.climb_m_s,
            descent_m_s=limits.descent_m_s,
            vertical_acceleration_m_s2=limits.vertical_acceleration_m_s2,
            speed_m_s=limits.speed_m_s,
            acceleration_m_s2=limits.acceleration_m_s2,
        )

    # -- copter -------------------------------------------------------------------------------------------

    def _takes_off(self, sticks: Sticks, limits: PilotLimits) -> bool:
        if not self._flight.armed:
            return False
        if self._flight.behaviour is Behaviour.MANUAL:
            return limits.lift(sticks.throttle) > TAKEOFF_LIFT
        return limits.climb_rate_m_s(sticks.throttle) > 0

    def _yaw_rate_rad_s(self, sticks: Sticks, limits: PilotLimits) -> float:
        return math.radians(limits.yaw_rate_deg_s) * limits.response(sticks.yaw)

    def _lean_m_s2(self, sticks: Sticks, limits: PilotLimits) -> tuple[tuple[float, float], float]:
        """Return the acceleration east, north by the lean, and the cosine of the lean."""
        size = math.hypot(sticks.roll, sticks.pitch)
        scale = math.radians(limits.lean_deg) / max(size, 1.0)
        roll, pitch = sticks.roll * scale, -sticks.pitch * scale
        heading_rad = self._flight.body.heading_rad
        return lean_acceleration_m_s2(roll, pitch, heading_rad), math.cos(roll) * math.cos(pitch)

    def _fly_by_thrust(self, sticks: Sticks, limits: PilotLimits) -> None:
        (east, north), vertical_share = self._lean_m_s2(sticks, limits)
        lift = limits.lift(sticks.throttle)
        upward = lift if limits.lean_keeps_lift else lift * vertical_share
        yaw_rate = self._yaw_rate_rad_s(sticks, limits)
        self._flight.body.thrust((east * upward, north * upward), upward, yaw_rate_rad_s=yaw_rate)

    def _fly_by_velocity(self, sticks: Sticks, limits: PilotLimits) -> None:
        body = self._flight.body
        forward, right = limits.response(sticks.pitch), limits.response(sticks.roll)
        climb_m_s = limits.climb_rate_m_s(sticks.throttle)
        yaw_rate = self._yaw_rate_rad_s(sticks, limits)
        size = math.hypot(forward, right)
        if size > 0:
            speed_m_s = limits.speed_m_s / max(size, 1.0)
            sin, cos = math.sin(body.heading_rad), math.cos(body.heading_rad)
            east, north = forward * sin + right * cos, forward * cos - right * sin
            velocity_m_s = (east * speed_m_s, north * speed_m_s, climb_m_s)
            body.move(velocity_m_s, yaw_rate_rad_s=yaw_rate)
            self._holds_place = False
            return
        body.turn(None, yaw_rate)
        if not self._holds_place or (self._climbs and climb_m_s == 0):
            body.stop()
        self._holds_place, self._climbs = True, climb_m_s != 0
        if self._climbs:
            body.move_vertically(climb_m_s)

    # -- plane --------------------------------------------------------------------------------------------

    def _fly_plane(self, sticks: Sticks, limits: PilotLimits) -> None:
        flight = self._flight
        if not flight.armed:
            flight.body.rest()
            return
        bank_rad = math.radians(limits.lean_deg) * sticks.roll
        if flight.behaviour is Behaviour.MANUAL:
            range_deg = limits.pitch_up_deg if sticks.pitch < 0 else limits.pitch_down_deg
            pitch_rad = math.radians(range_deg) * -sticks.pitch
            flight.body.bank(bank_rad, pitch_rad=pitch_rad, throttle=sticks.throttle)
            return
        airframe = flight.flight_parameters.limits
        lowest, highest = airframe.airspeed_min_m_s, airframe.airspeed_max_m_s
        flight.limit(speed_m_s=lowest + (highest - lowest) * sticks.throttle)
        climb = -limits.response(sticks.pitch)
        flight.body.bank(bank_rad, climb_m_s=climb * (limits.climb_m_s if climb > 0 else limits.descent_m_s))
