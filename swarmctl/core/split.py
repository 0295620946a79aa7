"""The split of a group in formation, as planned and as the leader tells it. Pure."""

from __future__ import annotations

from typing import Annotated

import msgspec

from swarmctl.core.geo import LatLon, check_position
from swarmctl.core.grid import Cell
from swarmctl.core.observation import Id

MAX_WAY_POINTS = 1024
"""most points of all ways together; a split that needs more is not flown"""
MAX_WAYS = 254
MAX_DISTANCE_M = 1e7


class SplitPlan(msgspec.Struct, frozen=True):
    """The members' own routes to the place where they meet again, and the shape in which they fly on."""

    members: tuple[int, ...]
    """system ids, the leader's first"""
    routes: tuple[tuple[Cell, ...], ...]
    """neighbouring cells of each member, the last one its place in the meeting"""
    ahead: Cell
    """the leader's next cell after the meeting; all members go one step in this direction"""
    shape: int
    """number of the shape in the meeting"""

    @property
    def extended(self) -> tuple[tuple[Cell, ...], ...]:
        """The routes with the step after the meeting."""
        row, col = self.routes[0][-1]
        north, east = self.ahead[0] - row, self.ahead[1] - col
        return tuple((*cells, (cells[-1][0] + north, cells[-1][1] + east)) for cells in self.routes)


class SplitShared(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """A stretch of a group's route on which the members fly ways of their own."""

    begin_m: float
    """distance along the route [m]; below 0 if a new route begins behind it"""
    end_m: float
    ways: Annotated[
        tuple[tuple[Id, Annotated[tuple[LatLon, ...], msgspec.Meta(min_length=1)]], ...],
        msgspec.Meta(max_length=MAX_WAYS),
    ]
    """points of each member's way [deg]; the leader's is the route"""

    def __post_init__(self) -> None:
        if not -MAX_DISTANCE_M <= self.begin_m < self.end_m <= MAX_DISTANCE_M:
            raise ValueError(f"a split from {self.begin_m} m to {self.end_m} m: expected a begin and an end")
        if sum(len(points) for _, points in self.ways) > MAX_WAY_POINTS:
            raise ValueError(f"the ways of a split have more than {MAX_WAY_POINTS} points")
        for _, points in self.ways:
            for point in points:
                check_position(*point)
