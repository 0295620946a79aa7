"""The landing pattern of a fixed wing: a circle to lose height, and a straight final. Pure.

Ground stations draw this pattern for fixed wings. The vehicle descends in a circle to the height at which the
final begins (MAV_CMD_NAV_LOITER_TO_ALT). It leaves the circle along a tangent and descends on a straight
slope (MAV_CMD_NAV_LAND). Points are in the area's plane, headings are clockwise from north [rad].
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise

import msgspec

from swarmctl.core.geo import LatLon, LocalFrame
from swarmctl.core.mission import Approach, Waypoint
from swarmctl.core.planar import PlanarPoint, stays_inside

N_HEADINGS = 16
"""number of landing directions that are compared"""
ROLL_OUT_M = 60.0
"""greatest roll-out, or float, beyond the touchdown [m]"""
CIRCLE_POINTS = 16
STEP_M = 10.0
"""distance between two points of the path to the circle [m]"""
MAX_STEPS = 400
EXPOSURE_TIE = 1e-9
"""difference in exposure that counts as none"""


class NoApproach(ValueError):
    """No landing direction has enough room."""


class FixedWing(msgspec.Struct, frozen=True):
    """The properties of a fixed wing on which plans depend."""

    loiter_radius_m: float
    """radius of the holding circles and of the descent circle [m]"""
    final_height_m: float
    """height above home at which the final begins [m]"""
    glide_deg: float
    """slope of the final [deg]"""
    min_speed_m_s: float
    """least speed that the agent commands [m/s]"""
    takeoff_height_m: float
    """height above home up to which the vehicle flies straight on after take-off [m]"""
    home: LatLon
    """place of take-off, and of the landing after a return"""
    landing_heading_deg: float | None = None
    """landing heading, clockwise from north [deg]; None: the plan chooses the heading"""

    @property
    def final_m(self) -> float:
        """Length of the final over ground [m]."""
        return self.final_height_m / math.tan(math.radians(self.glide_deg))

    @property
    def glide_from_circle_deg(self) -> float:
        """Slope of a straight glide from the exit of the circle to the touchdown [deg]."""
        return math.degrees(math.atan(self.final_height_m / (self.final_m + self.loiter_radius_m)))

    @property
    def reach_m(self) -> float:
        """Upper bound of the distance from the touchdown to any part of the pattern [m]."""
        return self.final_m + 4.0 * self.loiter_radius_m + ROLL_OUT_M


class Pose(msgspec.Struct, frozen=True):
    point: PlanarPoint
    heading_rad: float


class LandingPattern(msgspec.Struct, frozen=True):
    """A landing seen from above."""

    centre: PlanarPoint
    radius_m: float
    """radius of the circle [m]; negative: counter-clockwise"""
    circle_exit: PlanarPoint
    """exit of the circle, along its tangent"""
    final: PlanarPoint
    """start of the final"""
    touchdown: PlanarPoint
    heading_rad: float

    def circle(self) -> list[PlanarPoint]:
        """Return points once around the circle, from its exit to its exit."""
        exit_rad = math.atan2(self.circle_exit[0] - self.centre[0], self.circle_exit[1] - self.centre[1])
        step_rad = math.copysign(math.tau / CIRCLE_POINTS, self.radius_m)
        radius_m = abs(self.radius_m)
        return [_offset(self.centre, exit_rad + k * step_rad, radius_m) for k in range(CIRCLE_POINTS + 1)]

    def outline(self) -> list[PlanarPoint]:
        """Return the points of the flight from the circle on, with the roll-out."""
        return [
            *self.circle(),
            self.final,
            self.touchdown,
            _offset(self.touchdown, self.heading_rad, ROLL_OUT_M),
        ]


def landing_pattern(
    touchdown: PlanarPoint, heading_rad: float, fixed_wing: FixedWing, *, clockwise: bool
) -> LandingPattern:
    """Return the pattern with this touchdown, landing heading and direction of the circle."""
    radius_m = fixed_wing.loiter_radius_m
    final = _offset(touchdown, heading_rad, -fixed_wing.final_m)
    # One more radius to level the wings and to settle on the line.
    circle_exit = _offset(final, heading_rad, -radius_m)
    side_rad = math.pi / 2.0 if clockwise else -math.pi / 2.0
    centre = _offset(circle_exit, heading_rad + side_rad, radius_m)
    return LandingPattern(
        centre, radius_m if clockwise else -radius_m, circle_exit, final, touchdown, heading_rad % math.tau
    )


def choose_pattern(
    touchdown: PlanarPoint,
    fixed_wing: FixedWing,
    *,
    from_pose: Pose,
    with_path_to_circle: bool,
    turn_radius_m: float,
    fence: Sequence[PlanarPoint],
    exposure_under: Callable[[Sequence[PlanarPoint]], float],
) -> LandingPattern:
    """Return the pattern of least exposure whose legs all stay inside the fence.

    Among equal patterns, the result needs the least turn from `from_pose`. `with_path_to_circle`: the path
    from `from_pose` to the circle counts too. `exposure_under(path)` is the exposure of the cells under a
    path, infinite if a cell is forbidden. Raises NoApproach.
    """

    def cost(candidate: LandingPattern) -> float:
        path = candidate.outline()
        if with_path_to_circle:
            path = [*path_to_circle(from_pose, candidate, turn_radius_m), *path]
        if fence and not all(stays_inside(fence, a, b) for a, b in pairwise(path) if a != b):
            return math.inf
        return exposure_under(path)

    candidates = _candidates(touchdown, fixed_wing, from_pose.heading_rad)
    found = [(cost(candidate), candidate) for candidate in candidates]
    least = min(total for total, _ in found)
    if math.isinf(least):
        raise NoApproach(
            f"a final of {fixed_wing.final_m:.0f} m and a circle of radius {fixed_wing.loiter_radius_m:g} m "
            "leave the fence or cross no_fly in each direction tried; move the goal or widen the fence"
        )
    return next(pattern for total, pattern in found if total <= least + EXPOSURE_TIE)


def _candidates(touchdown: PlanarPoint, fixed_wing: FixedWing, along_rad: float) -> Iterator[LandingPattern]:
    """Yield the possible patterns; patterns with a smaller turn from `along_rad` are first."""
    headings = [along_rad]
    if fixed_wing.landing_heading_deg is not None:
        headings = [math.radians(fixed_wing.landing_heading_deg)]
    else:
        for k in range(1, N_HEADINGS // 2 + 1):
            headings += [along_rad + k * math.tau / N_HEADINGS, along_rad - k * math.tau / N_HEADINGS]
    for heading_rad in headings:
        for clockwise in (True, False):
            yield landing_pattern(touchdown, heading_rad, fixed_wing, clockwise=clockwise)


def path_to_circle(from_pose: Pose, pattern: LandingPattern, turn_radius_m: float) -> list[PlanarPoint]:
    """Return the approximate path to the circle, flown by turning towards the circle's centre."""
    (east, north), heading_rad = from_pose.point, from_pose.heading_rad
    most_rad = STEP_M / max(turn_radius_m, STEP_M)
    path = [from_pose.point]
    for _ in range(MAX_STEPS):
        if math.dist((east, north), pattern.centre) <= abs(pattern.radius_m):
            break
        bearing_rad = math.atan2(pattern.centre[0] - east, pattern.centre[1] - north)
        turn_rad = math.remainder(bearing_rad - heading_rad, math.tau)
        heading_rad += min(max(turn_rad, -most_rad), most_rad)
        east, north = _offset((east, north), heading_rad, STEP_M)
        path.append((east, north))
    return path


def planned_approach(pattern: LandingPattern, frame: LocalFrame, height_m: float) -> Approach:
    """Return the pattern as a part of a plan; `height_m`: height above home at which the final begins."""

    def place(point: PlanarPoint, up_m: float) -> Waypoint:
        return Waypoint(*frame.to_geodetic(*point), up_m)

    return Approach(
        place(pattern.centre, height_m),
        pattern.radius_m,
        place(pattern.final, height_m),
        place(pattern.touchdown, 0.0),
    )


def pattern_from(approach: Approach, frame: LocalFrame) -> LandingPattern:
    """Return the pattern of a plan's approach."""
    centre, final, touchdown = (
        frame.to_local(p.lat_deg, p.lon_deg) for p in (approach.centre, approach.final, approach.touchdown)
    )
    heading_rad = math.atan2(touchdown[0] - final[0], touchdown[1] - final[1])
    side_rad = -math.pi / 2.0 if approach.radius_m > 0.0 else math.pi / 2.0
    circle_exit = _offset(centre, heading_rad + side_rad, abs(approach.radius_m))
    return LandingPattern(centre, approach.radius_m, circle_exit, final, touchdown, heading_rad)


def _offset(point: PlanarPoint, heading_rad: float, metres: float) -> PlanarPoint:
    return point[0] + metres * math.sin(heading_rad), point[1] + metres * math.cos(heading_rad)
