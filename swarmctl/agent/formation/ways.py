"""Places of the members relative to the reference point: fixed in the shape, or on ways of a split. Pure.

On the stretch of a split each member has a way of its own. At the share x of the stretch the member's place
is at the share x of its way, so all arrive at the meeting together. Near the end the place passes from the
way to the shape.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import msgspec

from swarmctl.agent.formation.reference import LEAST_WINDOW_M, Pose, Reference
from swarmctl.agent.formation.shape import ShapePlace
from swarmctl.core.planar import PlanarPoint, by_heading
from swarmctl.core.records import replace
from swarmctl.core.split import SplitPlan

INTO_SHAPE_M = 30.0
"""Distance along the route, before the end of a split, on which the places pass into the shape [m]."""


class MemberWay(msgspec.Struct, frozen=True, eq=False):
    """The way of a member during a split, by the distance along the group's route."""

    begin_m: float
    end_m: float
    curve: Reference

    @property
    def ratio(self) -> float:
        """Length of the way for each metre of the route."""
        return self.curve.length_m / (self.end_m - self.begin_m)

    def shift(self, pose: Pose, away: PlanarPoint) -> tuple[PlanarPoint, PlanarPoint]:
        """Return the distance of the place from its place in the shape, and its change for each metre.

        away: the place in the shape minus the reference point
        """
        at = self.curve.at((pose.s_m - self.begin_m) * self.ratio)
        shift = (at.east_m - pose.east_m - away[0], at.north_m - pose.north_m - away[1])
        slope = (
            self.ratio * at.slope_east - pose.slope_east - pose.turn_rad_m * away[1],
            self.ratio * at.slope_north - pose.slope_north + pose.turn_rad_m * away[0],
        )
        length_m = min(INTO_SHAPE_M, self.end_m - self.begin_m)
        x = min((self.end_m - pose.s_m) / length_m, 1.0)
        share, change = x * x * (3.0 - 2.0 * x), -6.0 * x * (1.0 - x) / length_m
        moves = (share * slope[0] + change * shift[0], share * slope[1] + change * shift[1])
        return (share * shift[0], share * shift[1]), moves


def offset_of(
    pose: Pose, place: ShapePlace, way: MemberWay | None, speed_m_s: float = 0.0
) -> tuple[PlanarPoint, PlanarPoint]:
    """Return a place minus the reference point, (east, north) [m], and its velocity relative to it [m/s].

    The velocity is ω × offset, with ω the speed along the route times the turn for each metre; on a way there
    is added its own change.
    """
    east, north = by_heading(place[:2], pose.heading_rad)
    turn = speed_m_s * pose.turn_rad_m  # clockwise
    moves = (turn * north, -turn * east)
    if way is None or not way.begin_m <= pose.s_m < way.end_m:
        return (east, north), moves
    shift, slope = way.shift(pose, (east, north))
    return (
        (east + shift[0], north + shift[1]),
        (moves[0] + speed_m_s * slope[0], moves[1] + speed_m_s * slope[1]),
    )


class SplitStretch(msgspec.Struct, frozen=True, eq=False):
    """A stretch of a group's route on which the members fly apart."""

    begin_m: float
    end_m: float
    curves: Mapping[int, Reference]
    """the way of each member but the leader"""
    plan: SplitPlan | None = None
    """the leader's alone"""

    @classmethod
    def of(
        cls,
        begin_m: float,
        end_m: float,
        points_m: Mapping[int, Sequence[PlanarPoint]],
        plan: SplitPlan | None = None,
    ) -> SplitStretch:
        """Return a split with ways along `points_m`, (east, north) [m]."""
        curves = {uav: Reference.over(tuple(points), LEAST_WINDOW_M) for uav, points in points_m.items()}
        return cls(begin_m, end_m, curves, plan)

    def way_of(self, uav: int) -> MemberWay | None:
        """Return a member's own way; None for the leader, and for a vehicle that has none."""
        return MemberWay(self.begin_m, self.end_m, self.curves[uav]) if uav in self.curves else None

    def is_at(self, s_m: float) -> bool:
        """Return whether the group is apart at a distance along the route."""
        return self.begin_m <= s_m < self.end_m

    def moved(self, by_m: float) -> SplitStretch:
        """Return the split on a route whose distances are greater by `by_m`."""
        return replace(self, begin_m=self.begin_m + by_m, end_m=self.end_m + by_m)
