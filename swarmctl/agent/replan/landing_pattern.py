"""How a fixed wing comes to its landing: a circle to lose height in, and a straight final. Pure.

The pattern is the one that ground stations of fixed wings draw: down to the height of the final in a circle
(MAV_CMD_NAV_LOITER_TO_ALT), out of it along its tangent, and down a straight slope (MAV_CMD_NAV_LAND). Points
are (east, north) [m] in the area's plane, headings clockwise from north [rad].
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

from swarmctl.core.geo import LatLon, LocalFrame
from swarmctl.core.mission import Approach, Waypoint
from swarmctl.core.planar import PlanarPoint, stays_inside

HEADINGS = 16
"""from how many sides a landing is looked for"""
ROLL_OUT_M = 60.0
"""so far it may roll, or float, beyond its touch-down"""
CIRCLE_POINTS = 16
STEP_M = 10.0
"""between two points of the way to the circle"""
MAX_STEPS = 400
SAME = 1e-9
"""less exposure than this is none"""


class NoApproach(ValueError):
    """From no side there is room to land."""


@dataclass(frozen=True, slots=True)
class FixedWing:
    """What a plan for a fixed wing has to know of it."""

    loiter_radius_m: float
    """of the circles it holds in, and loses its height in"""
    final_height_m: float
    """above home, at which its last slope begins"""
    glide_deg: float
    """that slope is so steep"""
    min_speed_m_s: float
    """it is not told to fly slower"""
    takeoff_height_m: float
    """above home: it flies straight on until it is up there"""
    home: LatLon
    """where it takes off, and lands when it returns"""
    landing_heading_deg: float | None = None
    """into which it lands, clockwise from north; None: where it comes over the fewest cells of the area"""

    @property
    def final_m(self) -> float:
        """From where its last slope begins to the touch-down, over ground."""
        return self.final_height_m / math.tan(math.radians(self.glide_deg))

    @property
    def glide_from_circle_deg(self) -> float:
        """How steep its way down is where it glides from where it leaves the circle on."""
        return math.degrees(math.atan(self.final_height_m / (self.final_m + self.loiter_radius_m)))

    @property
    def reach_m(self) -> float:
        """No part of its pattern is farther from the touch-down; ways around the circle included."""
        return self.final_m + 4.0 * self.loiter_radius_m + ROLL_OUT_M


@dataclass(frozen=True, slots=True)
class Pose:
    """Where it is, and where it flies to."""

    point: PlanarPoint
    heading_rad: float


@dataclass(frozen=True, slots=True)
class LandingPattern:
    """A landing, seen from above."""

    centre: PlanarPoint
    radius_m: float
    """negative: counter-clockwise"""
    leaves: PlanarPoint
    """where the circle is left, along its tangent"""
    final: PlanarPoint
    touchdown: PlanarPoint
    heading_rad: float

    def circle(self) -> list[PlanarPoint]:
        """Once around, from where it is left and back."""
        out = math.atan2(self.leaves[0] - self.centre[0], self.leaves[1] - self.centre[1])
        turn = math.copysign(math.tau / CIRCLE_POINTS, self.radius_m)
        return [_ahead(self.centre, out + k * turn, abs(self.radius_m)) for k in range(CIRCLE_POINTS + 1)]

    def outline(self) -> list[PlanarPoint]:
        """All that is flown over from the circle on, and what it may roll."""
        return [
            *self.circle(),
            self.final,
            self.touchdown,
            _ahead(self.touchdown, self.heading_rad, ROLL_OUT_M),
        ]


def landing_pattern(
    touchdown: PlanarPoint, heading_rad: float, wings: FixedWing, *, clockwise: bool
) -> LandingPattern:
    """Land at `touchdown` flying into `heading_rad`, out of a circle on one side of the way."""
    radius_m = wings.loiter_radius_m
    final = _ahead(touchdown, heading_rad, -wings.final_m)
    # As far again as its radius to come out of the bank, and onto the line.
    leaves = _ahead(final, heading_rad, -radius_m)
    side_rad = math.pi / 2.0 if clockwise else -math.pi / 2.0
    centre = _ahead(leaves, heading_rad + side_rad, radius_m)
    return LandingPattern(
        centre, radius_m if clockwise else -radius_m, leaves, final, touchdown, heading_rad % math.tau
    )


def choose_pattern(
    touchdown: PlanarPoint,
    wings: FixedWing,
    *,
    comes: Pose,
    is_flown_to: bool,
    turn_radius_m: float,
    fence: Sequence[PlanarPoint],
    exposure_under: Callable[[Sequence[PlanarPoint]], float],
) -> LandingPattern:
    """The landing over the least threat whose every leg stays inside the fence; of equal ones that which
    turns least from where it `comes`. `is_flown_to`: it comes to the circle from there, which counts as well.

    `exposure_under`: of the cells under a way; infinite where one of them may not be entered. Raises
    NoApproach.
    """

    def cost(candidate: LandingPattern) -> float:
        way = candidate.outline()
        if is_flown_to:
            way = [*path_to_circle(comes, candidate, turn_radius_m), *way]
        if fence and not all(stays_inside(fence, a, b) for a, b in pairwise(way) if a != b):
            return math.inf
        return exposure_under(way)

    candidates = _candidates(touchdown, wings, comes.heading_rad)
    found = [(cost(candidate), candidate) for candidate in candidates]
    least = min(total for total, _ in found)
    if math.isinf(least):
        raise NoApproach(
            f"there is no room to land: a final of {wings.final_m:.0f} m and a circle of "
            f"{wings.loiter_radius_m:g} m would leave the fence, or come over no_fly, from every side"
        )
    return next(one for total, one in found if total <= least + SAME)


def _candidates(touchdown: PlanarPoint, wings: FixedWing, along_rad: float) -> Iterator[LandingPattern]:
    """Those that turn least first."""
    headings = [along_rad]
    if wings.landing_heading_deg is not None:
        headings = [math.radians(wings.landing_heading_deg)]
    else:
        for k in range(1, HEADINGS // 2 + 1):
            headings += [along_rad + k * math.tau / HEADINGS, along_rad - k * math.tau / HEADINGS]
    for heading_rad in headings:
        for clockwise in (True, False):
            yield landing_pattern(touchdown, heading_rad, wings, clockwise=clockwise)


def path_to_circle(comes: Pose, there: LandingPattern, turn_radius_m: float) -> list[PlanarPoint]:
    """About how it flies from where it comes to the circle: turning toward its middle until it is on it."""
    (east, north), heading = comes.point, comes.heading_rad
    most_rad = STEP_M / max(turn_radius_m, STEP_M)
    way = [comes.point]
    for _ in range(MAX_STEPS):
        if math.dist((east, north), there.centre) <= abs(there.radius_m):
            break
        wanted = math.atan2(there.centre[0] - east, there.centre[1] - north)
        turn = math.remainder(wanted - heading, math.tau)
        heading += min(max(turn, -most_rad), most_rad)
        east, north = _ahead((east, north), heading, STEP_M)
        way.append((east, north))
    return way


def planned_approach(found: LandingPattern, frame: LocalFrame, height_m: float) -> Approach:
    """As a part of a plan; `height_m` above home is that of the final."""

    def place(point: PlanarPoint, up_m: float) -> Waypoint:
        return Waypoint(*frame.to_geodetic(*point), up_m)

    return Approach(
        place(found.centre, height_m),
        found.radius_m,
        place(found.final, height_m),
        place(found.touchdown, 0.0),
    )


def pattern_from(there: Approach, frame: LocalFrame) -> LandingPattern:
    """A plan's approach, seen from above."""
    centre, final, touchdown = (
        frame.to_local(p.lat_deg, p.lon_deg) for p in (there.centre, there.final, there.touchdown)
    )
    heading_rad = math.atan2(touchdown[0] - final[0], touchdown[1] - final[1])
    side_rad = -math.pi / 2.0 if there.radius_m > 0.0 else math.pi / 2.0
    leaves = _ahead(centre, heading_rad + side_rad, abs(there.radius_m))
    return LandingPattern(centre, there.radius_m, leaves, final, touchdown, heading_rad)


def _ahead(point: PlanarPoint, heading_rad: float, metres: float) -> PlanarPoint:
    return point[0] + metres * math.sin(heading_rad), point[1] + metres * math.cos(heading_rad)
