"""Manoeuvres as state machines: landing, return to launch, climb after take-off, circles.

The constructor begins a manoeuvre. `update(now)` continues the manoeuvre and returns True at its end.
"""

import math
from typing import Protocol

from sim_vehicle.vehicle.behaviour import Behaviour
from sim_vehicle.vehicle.flight_parameters import RallyAltitude
from sim_vehicle.vehicle.interface import FlightControl

HOVER_TOLERANCE_M = 1.0  # height above the hover height that needs no descent
TAKEOFF_TOLERANCE_M = 0.3  # altitude error at the end of a take-off
ALIGNED_RAD = math.radians(10.0)  # largest heading error of a plane that leaves a circle
INSIDE_RADII = 1.05  # largest distance from the centre, in radii, that counts as inside a circle


class Manoeuvre(Protocol):
    """A manoeuvre in progress."""

    def update(self, now: float) -> bool:
        """Continue the manoeuvre at `now` [s]; return True at its end."""
        ...


class Landing:
    """Landing: level flight, descent, and a short time on the ground.

    place_deg: latitude and longitude; None: the present position.
    circles: a plane spirals down around the position, else the plane glides to the position.
    """

    def __init__(
        self, flight: FlightControl, place_deg: tuple[float, float] | None, *, circles: bool = False
    ) -> None:
        self._flight = flight
        self._descends = place_deg is None
        self._glides = flight.body.plane and place_deg is not None and not circles
        if place_deg is None:
            flight.body.stop()
        elif flight.body.plane and circles:
            flight.body.loiter(*flight.body.locate(*place_deg), flight.body.alt_amsl_m)
        elif flight.body.plane:
            flight.body.land_at(*flight.body.locate(*place_deg))
        else:
            flight.body.fly_to(*flight.body.locate(*place_deg), flight.body.alt_amsl_m)

    def update(self, now: float) -> bool:
        flight = self._flight
        if flight.body.airborne:
            self._descends = self._descends or flight.body.reached
            if self._descends and not self._glides:
                flight.body.move_vertically(-flight.landing_speed_m_s())
        else:
            flight.body.rest()
        return flight.landed(now)


class Return:
    """Return to launch: climb, flight to home or to the nearest rally point, wait, landing.

    With `final_height_m` and remote control, the vehicle stays at this height instead of landing
    (`ModeRTL::run`).
    """

    def __init__(self, flight: FlightControl) -> None:
        self._flight = flight
        body, parameters = flight.body, flight.flight_parameters.returning
        self._place = flight.vehicle.home_and_rally.return_place()
        east_m, north_m, up_m = body.position_m
        self._up_m = self._travel_altitude_m(up_m)
        flight.limit(speed_m_s=parameters.speed_m_s)
        if body.plane and parameters.loiter_radius_m:
            flight.limit(loiter_radius_m=parameters.loiter_radius_m)
        self._hover_descent_is_past = False
        self._flies_home = body.plane  # a plane climbs on its way
        if body.plane:
            self._fly_home()
        else:
            body.fly_to(east_m, north_m, self._up_m)
        self._land_at_s: float | None = None
        self._landing: Landing | None = None
        self._stays_in_air = False
        # The landing sequence of the mission replaces the landing of the return.
        mission_lands = parameters.lands in (1, 2)
        self._mission_lands = flight.behaviour is Behaviour.RETURN and mission_lands

    def _travel_altitude_m(self, up_m: float) -> float:
        """Return the travel altitude for a start at `up_m` [m above mean sea level]."""
        home, parameters = self._flight.home(), self._flight.flight_parameters.returning
        rally_altitude = self._flight.flight_parameters.rally.altitude
        place_amsl_m = self._place.alt_amsl_m
        if self._place == home or rally_altitude is RallyAltitude.GROUND:
            travel_amsl_m = place_amsl_m + self._travel_height_m()
        elif rally_altitude is RallyAltitude.EXACT:
            return place_amsl_m
        else:
            travel_amsl_m = max(place_amsl_m, home.alt_amsl_m + self._travel_height_m())
        if parameters.under_fence:
            travel_amsl_m = min(travel_amsl_m, self._flight.vehicle.fence_watch.ceiling_amsl_m)
        return travel_amsl_m if parameters.descends else max(up_m, travel_amsl_m)

    def _travel_height_m(self) -> float:
        """Return the travel height above the destination or home [m]."""
        body, parameters = self._flight.body, self._flight.flight_parameters.returning
        if parameters.height_at is None:
            return parameters.height_m
        east_m, north_m, up_m = body.position_m
        place_m = body.locate(*self._place.lat_lon_deg)
        distance_m = math.dist((east_m, north_m), place_m)
        return parameters.height_at(distance_m, up_m - self._place.alt_amsl_m)

    def _descend(self) -> bool:
        """Begin a descent to the hover height; return False if no descent is needed."""
        hover_m = self._flight.flight_parameters.returning.hover_height_m
        self._hover_descent_is_past = True
        if (
            hover_m is None
            or self._flight.body.alt_amsl_m <= self._place.alt_amsl_m + hover_m + HOVER_TOLERANCE_M
        ):
            return False
        self._up_m = self._place.alt_amsl_m + hover_m
        self._fly_home()
        return True

    def _end(self) -> None:
        flight = self._flight
        final_height_m = flight.flight_parameters.returning.final_height_m
        if final_height_m is None or flight.vehicle.failsafes.rc_lost:
            self._landing = Landing(flight, None)
            return
        self._stays_in_air = True
        self._up_m = flight.home().alt_amsl_m + final_height_m
        self._fly_home()

    def _fly_home(self) -> None:
        body, jerk_m_s3 = self._flight.body, self._flight.flight_parameters.mission.leg_jerk_m_s3
        self._flight.go((*body.locate(*self._place.lat_lon_deg), self._up_m), jerk_m_s3=jerk_m_s3)

    def update(self, now: float) -> bool:
        flight = self._flight
        if self._mission_lands and (flight.flight_parameters.returning.lands == 2 or flight.body.reached):
            self._mission_lands = False
            start_landing = flight.vehicle.personality.mission.start_landing
            if start_landing is not None and start_landing(flight.vehicle, now):
                return False  # the mode has changed
        if self._landing is not None:
            return self._landing.update(now)
        if not flight.body.airborne:
            self._landing = Landing(flight, None)
        elif self._land_at_s is not None:
            if now >= self._land_at_s and not self._stays_in_air:
                self._end()
        elif flight.body.reached:
            if self._flies_home:
                if self._hover_descent_is_past or not self._descend():
                    self._land_at_s = now + flight.flight_parameters.returning.wait_s
            else:
                self._fly_home()
                self._flies_home = True
        return False


class Takeoff:
    """Climb to an altitude [m above mean sea level] over the present position."""

    def __init__(self, flight: FlightControl, alt_amsl_m: float) -> None:
        self._flight = flight
        east_m, north_m, _ = flight.body.position_m
        self._alt_amsl_m = alt_amsl_m
        flight.go((east_m, north_m, alt_amsl_m))

    def update(self, _now: float) -> bool:
        self._flight.limit_climb()
        body = self._flight.body
        at_altitude = body.plane or abs(body.alt_amsl_m - self._alt_amsl_m) < TAKEOFF_TOLERANCE_M
        is_done = body.airborne and body.reached and at_altitude
        if is_done:
            self._flight.apply_limits()
        return is_done


class CircleToAltitude:
    """Circle of a plane to an altitude; the plane leaves the circle when it heads for the next position.

    Parameters
    ----------
    centre_m: east, north, up [m].
    radius_m: counter-clockwise if negative.
    next_m: east, north of the next position [m]; None: the circle ends at the altitude.
    tolerance_m: altitude tolerance [m]; None: the tolerance of the body.
    """

    def __init__(
        self,
        flight: FlightControl,
        centre_m: tuple[float, float, float],
        radius_m: float,
        next_m: tuple[float, float] | None,
        tolerance_m: float | None = None,
    ) -> None:
        self._flight, self._at_altitude = flight, False
        self._centre_m, self._radius_m, self._tolerance_m = centre_m, radius_m, tolerance_m
        # A plane on the circle cannot head for a position inside the circle.
        inside = next_m is not None and math.dist(next_m, centre_m[:2]) <= INSIDE_RADII * abs(radius_m)
        self._next_m = None if inside else next_m
        self._approaching = flight.flight_parameters.mission.circles_first
        up_m = flight.body.alt_amsl_m if self._approaching else centre_m[2]
        flight.body.loiter(*centre_m[:2], up_m, radius_m)

    def _is_at_altitude(self) -> bool:
        """Return True at the altitude; with `circles_first`, begin the climb or descent on the circle."""
        body = self._flight.body
        if self._approaching:
            if body.reached:
                self._approaching = False
                body.loiter(*self._centre_m, self._radius_m)
            return False
        if self._tolerance_m is None:
            return body.reached
        return abs(body.alt_amsl_m - self._centre_m[2]) <= self._tolerance_m

    def update(self, _now: float) -> bool:
        body = self._flight.body
        self._at_altitude = self._at_altitude or self._is_at_altitude()
        if not self._at_altitude or self._next_m is None:
            return self._at_altitude
        east_m, north_m, _ = body.position_m
        bearing_rad = math.atan2(self._next_m[0] - east_m, self._next_m[1] - north_m)
        return abs(math.remainder(bearing_rad - body.heading_rad, 2 * math.pi)) <= ALIGNED_RAD


class Circling:
    """Circles around a centre; a plane loiters, a copter flies POINTS_PER_TURN straight legs per circle.

    Parameters
    ----------
    centre_m: east, north, up [m].
    radius_m: counter-clockwise if negative; 0: a copter stays over the centre, a plane takes its own radius.
    turns: number of circles.
    """

    POINTS_PER_TURN = 16

    def __init__(
        self, flight: FlightControl, centre_m: tuple[float, float, float], radius_m: float, turns: float
    ) -> None:
        self._flight, self._centre_m, self._radius_m = flight, centre_m, radius_m
        east_m, north_m, _ = flight.body.position_m
        self._bearing_rad = math.atan2(east_m - centre_m[0], north_m - centre_m[1])
        self._points_left = math.ceil(turns * self.POINTS_PER_TURN) if radius_m else 0
        self._turns = turns
        self._flown_rad = 0.0
        self._last_bearing_rad: float | None = None
        if flight.body.plane:
            flight.body.loiter(*centre_m, radius_m or flight.flight_parameters.limits.loiter_radius_m)
        else:
            self._fly_to_point()

    def _flown_angle_rad(self) -> float:
        """Return the angle that a plane has flown on the circle [rad]."""
        east_m, north_m, _ = self._flight.body.position_m
        bearing_rad = math.atan2(east_m - self._centre_m[0], north_m - self._centre_m[1])
        if self._last_bearing_rad is not None:
            self._flown_rad += math.remainder(bearing_rad - self._last_bearing_rad, 2 * math.pi)
        self._last_bearing_rad = bearing_rad
        return abs(self._flown_rad)

    def _fly_to_point(self) -> None:
        radius_m = abs(self._radius_m)
        east_m = self._centre_m[0] + radius_m * math.sin(self._bearing_rad)
        north_m = self._centre_m[1] + radius_m * math.cos(self._bearing_rad)
        speed_m_s = self._flight.body.corner_speed_m_s(2 * math.pi / self.POINTS_PER_TURN)
        self._flight.body.fly_to(east_m, north_m, self._centre_m[2], speed_m_s if self._points_left else 0.0)

    def update(self, _now: float) -> bool:
        body = self._flight.body
        if not body.reached:
            return False
        if body.plane:
            return self._flown_angle_rad() >= 2 * math.pi * self._turns
        if self._points_left == 0:
            return True
        self._points_left -= 1
        step_rad = 2 * math.pi / self.POINTS_PER_TURN
        self._bearing_rad += step_rad if self._radius_m >= 0 else -step_rad
        self._fly_to_point()
        return False
