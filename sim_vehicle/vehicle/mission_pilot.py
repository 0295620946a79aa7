"""Execution of mission items by a vehicle: targets, completion, do and condition commands."""

import math

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.physics.geodesy import GeodeticPosition
from sim_vehicle.vehicle.interface import FlightControl
from sim_vehicle.vehicle.manoeuvres import CircleToAltitude, Circling, Landing, Manoeuvre, Return
from sim_vehicle.vehicle.mission import LANDINGS, TAKEOFFS, Item
from sim_vehicle.vehicle.numbers import finite, to_int

LocalPoint = tuple[float, float, float]
AHEAD_M = 50_000.0  # length of a straight leg that ends once the vehicle reaches an altitude
NO_ITEM = 65_535
MIN_DIRECTION_M = 0.1  # shortest distance that gives a direction
CLIMB_MARGIN_M = 10.0  # height of a plane's target above the take-off altitude
ALTITUDE_REACHED_M = 5.0  # altitude tolerance at the end of a leg to an altitude
LEG_START_SPEED_M_S = 1.0  # horizontal speed at which a leg begins after braking
YAW_REACHED_RAD = math.radians(2.0)
FLOWN_THROUGH = frozenset(
    {mavlink.MAV_CMD_NAV_WAYPOINT, mavlink.MAV_CMD_NAV_SPLINE_WAYPOINT, mavlink.MAV_CMD_CONDITION_GATE}
)
TIMED_COMMANDS = FLOWN_THROUGH | {mavlink.MAV_CMD_NAV_LOITER_TIME, mavlink.MAV_CMD_NAV_DELAY}
REPORTED_COMMANDS = FLOWN_THROUGH | {mavlink.MAV_CMD_NAV_LOITER_TIME, mavlink.MAV_CMD_NAV_LOITER_TURNS}
SHORT_NAMES = {
    mavlink.MAV_CMD_NAV_TAKEOFF: "Takeoff",
    mavlink.MAV_CMD_NAV_WAYPOINT: "WP",
    mavlink.MAV_CMD_NAV_SPLINE_WAYPOINT: "SplineWP",
    mavlink.MAV_CMD_NAV_LOITER_UNLIM: "LoitUnlim",
    mavlink.MAV_CMD_NAV_LOITER_TURNS: "LoitTurns",
    mavlink.MAV_CMD_NAV_LOITER_TIME: "LoitTime",
    mavlink.MAV_CMD_NAV_LOITER_TO_ALT: "LoitAltitude",
    mavlink.MAV_CMD_NAV_CONTINUE_AND_CHANGE_ALT: "ChangeAlt",
    mavlink.MAV_CMD_NAV_DELAY: "Delay",
    mavlink.MAV_CMD_NAV_LAND: "Land",
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: "RTL",
    mavlink.MAV_CMD_CONDITION_DELAY: "CondDelay",
    mavlink.MAV_CMD_CONDITION_DISTANCE: "CondDist",
    mavlink.MAV_CMD_CONDITION_YAW: "CondYaw",
    mavlink.MAV_CMD_DO_CHANGE_SPEED: "ChangeSpeed",
    mavlink.MAV_CMD_DO_SET_HOME: "SetHome",
    mavlink.MAV_CMD_DO_LAND_START: "LandStart",
}


class MissionPilot:
    """The flight of one vehicle's mission: `Mission` has the order of the items, this class flies an item."""

    def __init__(self, flight: FlightControl) -> None:
        self._flight = flight
        self._manoeuvre: Manoeuvre | None = None
        self._wait_until_s: float | None = None
        self._target_m: LocalPoint = (0.0, 0.0, 0.0)
        self._wanted_heading_rad: float | None = None
        self._under_way = False  # on a leg to a waypoint
        self._braking = False  # before a leg
        self._following: Item | None = None
        self._climbing = False  # in place, before the leg to the current item
        self.item_reached = NO_ITEM  # index of the item reached last since the boot

    # -- state --------------------------------------------------------------------------------------------

    def reboot(self) -> None:
        """Forget the item that was reached last."""
        self.item_reached = NO_ITEM

    @property
    def busy(self) -> bool:
        """True while a wait, braking or a manoeuvre is in progress."""
        waiting = self._wait_until_s is not None or self._braking or self._climbing
        return self._manoeuvre is not None or waiting

    @property
    def landing(self) -> bool:
        return isinstance(self._manoeuvre, Landing)

    def forget(self) -> None:
        """Forget the current command."""
        self._manoeuvre, self._wait_until_s, self._wanted_heading_rad = None, None, None
        self._under_way, self._braking, self._climbing = False, False, False

    # -- navigation commands ------------------------------------------------------------------------------

    def start_navigation(self, item: Item, following: Item | None) -> None:
        """Begin a navigation command; `following` is the next navigation command, if known."""
        flight = self._flight
        interrupted = self._under_way
        self.forget()
        self._following = following
        self._target_m = flight.guided_target_m = self._goal_m(item)
        self._climbing = self._climbs_first(item)
        if flight.body.airborne:
            flight.mission.climbs_first = False
        flight.taking_off = item.command in TAKEOFFS or (self._climbing and not flight.body.airborne)
        if not flight.flying:
            return
        if self._climbing:
            self._begin_climb()
        else:
            self._begin(item, interrupted=interrupted)

    def _climbs_first(self, item: Item) -> bool:
        """Return True if the vehicle climbs in place before it flies to `item` (`checkClimbRequired`)."""
        flight = self._flight
        climbs = flight.mission.climbs_first and item.command not in (*TAKEOFFS, *LANDINGS)
        tolerance_m = flight.flight_parameters.mission.waypoint_height_m
        return climbs and self._target_m[2] - flight.body.alt_amsl_m > tolerance_m

    def _begin_climb(self) -> None:
        """Climb to the target's altitude; a plane climbs straight ahead from the ground, else in circles."""
        body = self._flight.body
        east_m, north_m, _ = body.position_m
        if body.plane and not body.airborne:
            self._climb_toward(self._straight_ahead(body.heading_rad))
        else:
            self._flight.go((east_m, north_m, self._target_m[2]))

    def _climb_toward(self, place_m: tuple[float, float]) -> None:
        """Climb a plane straight toward a place, to a height above the target's altitude."""
        up_m = self._target_m[2] + CLIMB_MARGIN_M
        self._flight.go((*place_m, up_m), self._flight.flight_parameters.limits.speed_m_s)

    def _climb_done(self, item: Item) -> bool:
        """Continue the climb; at its end begin the leg to `item` and return True."""
        flight = self._flight
        flight.limit_climb()
        if not flight.body.airborne:
            self._begin_climb()
            return False
        tolerance_m = flight.flight_parameters.mission.waypoint_height_m
        if flight.body.alt_amsl_m < self._target_m[2] - tolerance_m:
            return False
        self._climbing = flight.taking_off = flight.mission.climbs_first = False
        self._begin(item, interrupted=False)
        return True

    def _begin(self, item: Item, *, interrupted: bool) -> None:
        flight, following = self._flight, self._following
        flight.apply_limits()  # the slow climb of a take-off is over
        if item.command in LANDINGS:
            # Without an approach line a plane spirals down.
            self._manoeuvre = Landing(flight, item.place_deg, circles=flight.mission.without_approach)
        elif item.command == mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH:
            self._manoeuvre = Return(flight)
        elif item.command == mavlink.MAV_CMD_NAV_LOITER_TURNS:
            radius_m = item.param3 or flight.flight_parameters.limits.loiter_radius_m
            self._manoeuvre = Circling(flight, self._target_m, finite(radius_m), finite(item.param1))
        elif item.command == mavlink.MAV_CMD_NAV_DELAY:
            flight.body.stop()
        elif item.command == mavlink.MAV_CMD_NAV_LOITER_TO_ALT and flight.body.plane:
            self._manoeuvre = circle_to_altitude(flight, item, following)
        else:
            flight.body.limit(acceptance_radius_m=self._radius_m(item))
            self._under_way = not flight.taking_off
            from_rest = flight.flight_parameters.mission.begins_legs_at_rest
            self._braking = interrupted and self._under_way and from_rest
            if self._braking:
                flight.body.stop()
            else:
                self._begin_leg(item)

    def _begin_leg(self, item: Item) -> None:
        jerk_m_s3 = self._jerk_m_s3(item) if self._under_way else math.inf
        self._flight.go(self._target_m, self._pass_speed_m_s(item, self._following), jerk_m_s3=jerk_m_s3)

    def _jerk_m_s3(self, item: Item) -> float:
        """Return the jerk that limits the speed on the leg to an item [m/s³]; a spline has no such limit."""
        is_spline = item.command == mavlink.MAV_CMD_NAV_SPLINE_WAYPOINT
        return math.inf if is_spline else self._flight.flight_parameters.mission.leg_jerk_m_s3

    def _radius_m(self, item: Item) -> float:
        """Return the acceptance radius of an item [m]; only a plane obeys the radius in an item."""
        flight_parameters = self._flight.flight_parameters
        item_radius_m = finite(item.param2) if item.command == mavlink.MAV_CMD_NAV_WAYPOINT else 0.0
        sets_radius = (
            self._flight.body.plane and flight_parameters.mission.items_set_radius and item_radius_m > 0.0
        )
        return item_radius_m if sets_radius else flight_parameters.limits.acceptance_radius_m

    def _goal_m(self, item: Item) -> LocalPoint:
        flight = self._flight
        east_m, north_m, up_m = flight.body.position_m
        if item.command in TAKEOFFS:
            place_m = self._takeoff_toward(item) if self._takes_off_straight else (east_m, north_m)
            return *place_m, max(flight.altitude_amsl_m(item.frame, item.z), up_m)
        if item.command == mavlink.MAV_CMD_NAV_CONTINUE_AND_CHANGE_ALT:
            body = flight.body
            place_m = self._straight_ahead(body.heading_rad) if body.plane else (east_m, north_m)
            return *place_m, flight.altitude_amsl_m(item.frame, item.z)
        return target_of(flight, item)

    @property
    def _takes_off_straight(self) -> bool:
        return self._flight.body.plane and self._flight.flight_parameters.takeoff.straight

    def _takeoff_toward(self, item: Item) -> tuple[float, float]:
        """Return east, north [m] of a point far ahead, towards the item's position or straight ahead."""
        body = self._flight.body
        east_m, north_m, _ = body.position_m
        heading_rad = body.heading_rad
        if item.place_deg is not None:
            ahead_m = body.locate(*item.place_deg)
            if math.dist(ahead_m, (east_m, north_m)) > MIN_DIRECTION_M:
                heading_rad = math.atan2(ahead_m[0] - east_m, ahead_m[1] - north_m)
        return self._straight_ahead(heading_rad)

    def _straight_ahead(self, heading_rad: float) -> tuple[float, float]:
        east_m, north_m, _ = self._flight.body.position_m
        return east_m + AHEAD_M * math.sin(heading_rad), north_m + AHEAD_M * math.cos(heading_rad)

    def _pass_speed_m_s(self, item: Item, following: Item | None) -> float:
        """Return the speed at the end of an item [m/s]; 0: stop, or circle (plane)."""
        through = item.command in FLOWN_THROUGH and item.param1 == 0
        if self._flight.body.plane:  # a plane circles only on request or at the end
            through = through and following is not None
            through = through or item.command == mavlink.MAV_CMD_NAV_CONTINUE_AND_CHANGE_ALT
            return self._flight.flight_parameters.limits.speed_m_s if through else 0.0
        if not through or following is None or following.command not in FLOWN_THROUGH:
            return 0.0
        target_m, here_m = self._target_m, self._flight.body.position_m
        next_m = target_of(self._flight, following)
        inbound = math.atan2(target_m[0] - here_m[0], target_m[1] - here_m[1])
        outbound = math.atan2(next_m[0] - target_m[0], next_m[1] - target_m[1])
        turn_rad = abs(math.remainder(outbound - inbound, 2 * math.pi))
        body, next_leg_m = self._flight.body, math.dist(target_m[:2], next_m[:2])
        next_leg_m_s = body.leg_speed_m_s(next_leg_m, self._jerk_m_s3(following))
        return min(body.corner_speed_m_s(turn_rad), next_leg_m_s)

    def navigation_done(self, now: float) -> bool:
        """Return True once the current navigation command (`Mission.current_item`) is done."""
        item = self._flight.mission.current_item
        if item is None:
            return False
        if self._climbing and not self._climb_done(item):
            return False
        if item.command in TAKEOFFS:
            return self._takeoff_done()
        if item.command in LANDINGS or item.command == mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH:
            return self._landing_done(item, now)
        if self._manoeuvre is not None:
            return self._manoeuvre.update(now)
        if self._brake(item):
            return False
        done = self._waypoint_done(item, now)
        self._under_way = self._under_way and not done
        return done

    def _brake(self, item: Item) -> bool:
        """Return True while braking before the leg to `item`; begin it once the vehicle is slow."""
        if self._braking and math.hypot(*self._flight.body.velocity_m_s[:2]) <= LEG_START_SPEED_M_S:
            self._braking = False
            self._begin_leg(item)
        return self._braking

    def _takeoff_done(self) -> bool:
        flight = self._flight
        cleared = flight.cleared_for_takeoff or flight.flight_parameters.mission.takes_off
        if not (flight.armed and cleared):
            return False
        if self._takes_off_straight:
            if not flight.body.airborne:
                self._climb_toward(self._target_m[:2])
                return False
            return flight.body.alt_amsl_m >= self._target_m[2]
        flight.limit_climb()
        if not flight.body.airborne:
            flight.go(self._target_m)
            return False
        reached_m = flight.flight_parameters.takeoff.reached_m
        if reached_m is None:
            return flight.body.reached
        return flight.body.alt_amsl_m >= self._target_m[2] - reached_m

    def _landing_done(self, item: Item, now: float) -> bool:
        flight = self._flight
        done = self._manoeuvre.update(now) if self._manoeuvre is not None else flight.landed(now)
        if item.command in LANDINGS and flight.vehicle.personality.mission.stays_landed:
            return False
        if done and flight.armed and flight.vehicle.personality.arming.landing_disarms:
            # A landing ends the mission. Disarming resets the mission, so the landing item is not reported.
            flight.mission.end()
            flight.disarm()
            return False
        return done

    def _waypoint_done(self, item: Item, now: float) -> bool:
        flight = self._flight
        if item.command == mavlink.MAV_CMD_NAV_DELAY:
            reached = True
        elif item.command == mavlink.MAV_CMD_NAV_CONTINUE_AND_CHANGE_ALT and flight.body.plane:
            reached = abs(flight.body.alt_amsl_m - self._target_m[2]) < ALTITUDE_REACHED_M
        elif flight.body.airborne:
            reached = flight.body.reached
        else:  # a vehicle on the ground can be at its target
            reached = (
                math.dist(self._target_m, flight.body.position_m)
                <= flight.flight_parameters.limits.acceptance_radius_m
            )
        if not reached or item.command == mavlink.MAV_CMD_NAV_LOITER_UNLIM:
            return False
        if self._is_too_high_or_low(item):
            self._manoeuvre = circle_to_altitude(
                flight, item, self._following, flight.flight_parameters.mission.waypoint_height_m
            )
            return False
        if self._wait_until_s is None:
            self._wait_until_s = now + (finite(item.param1) if item.command in TIMED_COMMANDS else 0.0)
        return now >= self._wait_until_s

    def _is_too_high_or_low(self, item: Item) -> bool:
        """Return True if a plane's altitude error at a waypoint exceeds `waypoint_height_m`."""
        flight = self._flight
        off_m = abs(flight.body.alt_amsl_m - self._target_m[2])
        through = item.command in FLOWN_THROUGH and flight.body.plane and flight.body.airborne
        return through and off_m > flight.flight_parameters.mission.waypoint_height_m

    # -- do and condition commands ------------------------------------------------------------------------

    def do(self, item: Item) -> None:
        """Carry out a do command, or begin the turn of CONDITION_YAW."""
        flight = self._flight
        if item.command == mavlink.MAV_CMD_DO_CHANGE_SPEED:
            flight.change_speed(to_int(item.param1), item.param2)
        elif item.command == mavlink.MAV_CMD_CONDITION_YAW:
            relative = item.param4 == 1
            direction = to_int(item.param3)
            heading_rad = flight.turn(item.param1, item.param2, direction=direction, relative=relative)
            if heading_rad is not None:
                self._wanted_heading_rad = heading_rad
        elif item.command == mavlink.MAV_CMD_DO_SET_HOME:
            vehicle, place = flight.vehicle, flight.vehicle.here()
            if item.param1 != 1 and item.place_deg is not None:
                place = GeodeticPosition(*item.place_deg, flight.altitude_amsl_m(item.frame, item.z))
            vehicle.home_and_rally.set_home(place, vehicle.now, locked=True)

    def condition_met(self, item: Item) -> bool:
        """Return True once CONDITION_DISTANCE (param1 [m] from the target) or CONDITION_YAW is met."""
        body = self._flight.body
        if item.command == mavlink.MAV_CMD_CONDITION_DISTANCE:
            east_m, north_m, _ = body.position_m
            return math.hypot(self._target_m[0] - east_m, self._target_m[1] - north_m) <= finite(item.param1)
        if self._wanted_heading_rad is None:
            return True
        error_rad = math.remainder(body.heading_rad - self._wanted_heading_rad, 2 * math.pi)
        return abs(error_rad) < YAW_REACHED_RAD

    # -- reports ------------------------------------------------------------------------------------------

    def mission_item_started(self, index: int, item: Item) -> None:
        name = SHORT_NAMES.get(item.command, str(item.command))
        self._flight.vehicle.announce("item_started", index=index, name=name)

    def mission_item_reached(self, index: int, item: Item) -> None:
        self.item_reached = index
        self._flight.vehicle.send(mavlink.MAVLink_mission_item_reached_message(index))
        if item.command in REPORTED_COMMANDS:
            self._flight.vehicle.announce("item_reached", index=index)

    def mission_ended(self) -> None:
        self._leave_mission("mission_ended")

    def no_mission(self) -> None:
        """React to the mission mode if no mission can be flown (PX4)."""
        self._leave_mission("no_mission")

    def _leave_mission(self, event: str) -> None:
        flight = self._flight
        self.forget()
        flight.vehicle.announce(event if flight.flying else f"{event}_landed")
        if flight.flying:
            flight.body.stop()
        elif flight.armed:
            flight.disarm()
        flight.vehicle.modes.mission_over()


def target_of(flight: FlightControl, item: Item) -> LocalPoint:
    """Return the target of an item: east, north, up [m]; by default the vehicle's position."""
    body = flight.body
    east_m, north_m, up_m = body.position_m
    keeps_altitude = item.z == 0 and (
        item.place_deg is None or flight.flight_parameters.mission.zero_keeps_altitude
    )
    if item.place_deg is not None:
        east_m, north_m = body.locate(*item.place_deg)
    return east_m, north_m, up_m if keeps_altitude else flight.altitude_amsl_m(item.frame, item.z)


def circle_to_altitude(
    flight: FlightControl, item: Item, following: Item | None, near_m: float | None = None
) -> CircleToAltitude:
    """Begin a circle to the item's altitude; `near_m` (tolerance [m]) implies an exit towards `following`."""
    aligned = flight.flight_parameters.mission.loiter_leaves_aligned or item.param1 == 1 or near_m is not None
    place_deg = following.place_deg if following is not None and aligned else None
    next_m = None if place_deg is None else flight.body.locate(*place_deg)
    item_radius_m = finite(item.param2) if item.command == mavlink.MAV_CMD_NAV_LOITER_TO_ALT else 0.0
    radius_m = item_radius_m or flight.flight_parameters.limits.loiter_radius_m
    return CircleToAltitude(flight, target_of(flight, item), radius_m, next_m, near_m)
