"""The progress of a vehicle on its mission, in metres along the flight from lift-off to touchdown. Pure.

`step` computes the progress once for each telemetry message with a position. Planning, splicing, time
bounds, arrival and traffic ask for it here, and so does the display.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from itertools import pairwise

import msgspec

from swarmctl.core.geo import LatLon
from swarmctl.core.grid import Cell, Grid
from swarmctl.core.mission import FlightPlan
from swarmctl.core.planar import PlanarPoint
from swarmctl.core.planned_mission import PlannedMission
from swarmctl.core.track_position import StraightLegs, TrackPosition
from swarmctl.core.vehicle import VehicleState

ON_ROUTE_M = 15.0
"""Greatest distance from the flight at which a vehicle counts as on its route, in small cells [m]."""
ON_ROUTE_CELLS = 0.75
"""The same distance in cells from 20 m on [cells]; a centre under a straight track is up to 0.71 away."""
BACK_M = 10.0
"""Distance before the greatest distance reached from which on the next place is looked for [m]."""
AHEAD_M = 20.0
"""Distance ahead in which the next place is looked for, beside the distance moved [m]; more than BACK_M,
because a slow vehicle that turns back at a corner seems to go back on the leg before the corner."""
CUT_CORNERS = 1.5
"""Distance ahead in which the next place is looked for, in units of the distance moved."""
MOVES_M_S, EQUALLY_NEAR_M, CORNER_M = 1.0, 1.0, 3.0
"""Speed from which on a vehicle's direction of flight counts [m/s], distance within which two legs count as
equally near [m], and distance before a corner from which a vehicle may turn to the next leg [m]."""
OVERHEAD_M = 1.0
"""Greatest distance before a centre at which a vehicle counts as over the centre [m]."""


class PlannedFlight(msgspec.Struct, frozen=True):
    """A mission over ground: from the take-off or the begin in the air over the waypoints to the landing."""

    mission: PlannedMission
    takeoff: LatLon | None
    """place of take-off [deg]; None: unknown"""
    legs: StraightLegs
    centres_m: tuple[float, ...]
    """distance along the flight to the centre of each cell of the route, or to the place beside it [m]"""
    borders_m: tuple[float, ...]
    """distance along the flight to the end of each cell of the route but the last [m]"""
    on_route_m: float
    """greatest distance from the flight at which a vehicle counts as on its route [m]"""

    @classmethod
    def of(cls, mission: PlannedMission, grid: Grid, vehicle: VehicleState) -> PlannedFlight:
        """Return the flight of a mission; without a known begin it starts at the vehicle's position."""
        takeoff = _takeoff(vehicle)
        legs = planned_legs(grid, mission.plan, takeoff or vehicle.lat_lon)
        centres_m: list[float] = []
        for cell in mission.cells:
            # A route may pass a place twice, so a centre is looked for from the previous centre on.
            at = legs.locate(grid.centre_m(cell), centres_m[-1] if centres_m else 0.0)
            centres_m.append(at.along_m)
        on_route_m = max(ON_ROUTE_M, ON_ROUTE_CELLS * grid.cell_size_m)
        borders_m = tuple(0.5 * (a + b) for a, b in pairwise(centres_m))
        return cls(mission, takeoff, legs, tuple(centres_m), borders_m, on_route_m + _turn_inside_m(mission))

    def is_of(self, mission: PlannedMission, vehicle: VehicleState) -> bool:
        """Return whether this is still the flight of a mission; a vehicle may set its home at its launch."""
        return mission is self.mission and (not vehicle.armed or _takeoff(vehicle) in (None, self.takeoff))


class Progress(msgspec.Struct, frozen=True):
    """The position of a vehicle on its planned flight."""

    flight: PlannedFlight
    here: PlanarPoint
    """the vehicle's position, (east, north) [m]"""
    at: TrackPosition
    """place of the flight nearest to the vehicle"""
    reached_m: float
    """greatest distance along the flight so far [m]"""

    @property
    def along_m(self) -> float:
        """Distance along the flight from its begin [m]."""
        return self.at.along_m

    @property
    def is_on_route(self) -> bool:
        return self.at.cross_track_m <= self.flight.on_route_m

    @property
    def cell_index(self) -> int:
        """Index of the route's cell that is nearest along the flight; before the first centre: 0."""
        return bisect_right(self.flight.borders_m, self.along_m)

    @property
    def cell(self) -> Cell:
        """The route's cell that is nearest along the flight."""
        return self.flight.mission.cells[self.cell_index]

    @property
    def is_centre_passed(self) -> bool:
        """True if the vehicle is over or past the centre of `cell`."""
        return self.to_centre_m(self.cell_index) <= OVERHEAD_M

    @property
    def waypoint(self) -> int:
        """Index of the next waypoint in the plan's track; the number of waypoints before the landing."""
        return self.at.leg

    @property
    def points_ahead(self) -> tuple[PlanarPoint, ...]:
        """The waypoints ahead and the landing spot, (east, north) [m]."""
        return self.flight.legs.points[self.at.leg + 1 :]

    @property
    def waypoints_ahead(self) -> tuple[PlanarPoint, ...]:
        """The waypoints ahead, (east, north) [m]; at least the last one."""
        points = self.flight.legs.points
        return points[min(self.at.leg + 1, len(points) - 2) : -1]

    @property
    def to_last_waypoint_m(self) -> float:
        """Distance along the flight to the last waypoint, before the landing [m]; negative past it."""
        return self.flight.legs.at_m[-2] - self.along_m

    @property
    def to_landing_m(self) -> float:
        """Distance along the flight to its landing spot [m]."""
        return self.flight.legs.at_m[-1] - self.along_m

    def points_within(self, distance_m: float) -> tuple[PlanarPoint, ...]:
        """Return the waypoints within a distance ahead [m], and the point of the flight at that distance."""
        legs, end_m = self.flight.legs, self.along_m + distance_m
        ahead = zip(legs.points, legs.at_m, strict=True)
        between = (point for point, at_m in ahead if self.along_m < at_m < end_m)
        return (*between, legs.point_at(end_m))

    def to_centre_m(self, index: int) -> float:
        """Return the distance along the flight to the centre of a cell of the route [m]; negative behind."""
        return self.flight.centres_m[index] - self.along_m


def progress_on(
    mission: PlannedMission, before: Progress | None, grid: Grid, vehicle: VehicleState
) -> Progress | None:
    """Return the progress on a mission, after the progress `before`; None while the position is unknown."""
    if (lat_lon := vehicle.lat_lon) is None:
        return None
    here = grid.frame.to_local(*lat_lon)
    if before is None or not before.flight.is_of(mission, vehicle):
        flight = PlannedFlight.of(mission, grid, vehicle)
        at = flight.legs.locate(here)
        return Progress(flight, here, at, at.along_m)
    flight, since_m = before.flight, max(before.reached_m - BACK_M, 0.0)
    # Where a flight comes back over itself, the vehicle is not far from its last place along the flight.
    until_m = before.reached_m + AHEAD_M + CUT_CORNERS * math.dist(before.here, here)
    at = flight.legs.locate(here, since_m, until_m)
    if at.cross_track_m > flight.on_route_m:
        at = flight.legs.locate(here, since_m)
    elif _leads_against(flight.legs, at.leg, vehicle):
        reachable_m = before.reached_m + CUT_CORNERS * math.dist(before.here, here) + CORNER_M
        at = _after_turning_back(flight.legs, at, here, reachable_m, vehicle)
    return Progress(flight, here, at, max(before.reached_m, at.along_m))


def points_ahead_on(
    mission: PlannedMission, grid: Grid, vehicle: VehicleState
) -> tuple[PlanarPoint, ...] | None:
    """Return `Progress.points_ahead` at the begin of a mission; None while the position is unknown."""
    if (lat_lon := vehicle.lat_lon) is None:
        return None
    legs = planned_legs(grid, mission.plan, _takeoff(vehicle) or lat_lon)
    return legs.points[legs.locate(grid.frame.to_local(*lat_lon)).leg + 1 :]


def _after_turning_back(
    legs: StraightLegs, at: TrackPosition, here: PlanarPoint, reachable_m: float, vehicle: VehicleState
) -> TrackPosition:
    """Return the place on the leg back, of two legs over the same ground; `at` is on the leg out.

    A vehicle that moves back before it can have reached the corner stays on the leg out.
    """
    corner_m = legs.at_m[at.leg + 1]
    if corner_m >= min(reachable_m, legs.at_m[-1]):
        return at
    back = legs.locate(here, corner_m, corner_m + AHEAD_M)
    is_beside = back.cross_track_m <= at.cross_track_m + EQUALLY_NEAR_M
    return back if is_beside and not _leads_against(legs, back.leg, vehicle) else at


def _leads_against(legs: StraightLegs, leg: int, vehicle: VehicleState) -> bool:
    """Return whether a leg leads against the vehicle's direction of flight."""
    (ax, ay), (bx, by) = legs.points[leg : leg + 2]
    along_m = (bx - ax) * vehicle.east_m_s + (by - ay) * vehicle.north_m_s
    return along_m < 0.0 and vehicle.ground_speed_m_s > MOVES_M_S


def planned_legs(grid: Grid, plan: FlightPlan, takeoff: LatLon | None) -> StraightLegs:
    """Return the legs of a plan's flight: its begin or the take-off, its waypoints, its landing."""
    points = [(p.lat_deg, p.lon_deg) for p in (*plan.waypoints, plan.landing)]
    if plan.begins is None and takeoff is not None:
        points.insert(0, takeoff)
    return StraightLegs.over([grid.frame.to_local(*point) for point in points])


def _takeoff(vehicle: VehicleState) -> LatLon | None:
    """Return the place of take-off [deg]; None for an armed vehicle whose home is unknown."""
    return vehicle.home_lat_lon if vehicle.armed else vehicle.lat_lon


def _turn_inside_m(mission: PlannedMission) -> float:
    """Return how far a fixed wing is inside a corner when it turns by 90° [m]."""
    return (math.sqrt(2.0) - 1.0) * mission.plan.turn_radius_m
