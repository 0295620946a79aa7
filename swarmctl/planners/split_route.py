"""The route of a group that may split and meet again: together, or apart up to a meeting, by the lesser cost.

`meeting` compares both with the price a of flying apart. The route found is the leader's: its own way to the
meeting, and the group's route from there on. `Route.split` has the ways of all members.

A split under way is kept: its members are not at their places. Then the plan is the best meeting from where
they are, and `measure` is the cost of the present ways with the group's cost from their meeting on.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np

from swarmctl.core.grid import Cell
from swarmctl.core.records import replace
from swarmctl.core.route import ends_and_turns
from swarmctl.core.split import MAX_WAY_POINTS, SplitPlan
from swarmctl.planners import formation
from swarmctl.planners.base import Problem, Route, Unreachable, eq5_cost, is_open, route_of
from swarmctl.planners.meeting import split

USES_W = True
NEEDS_MACHINE_CODE = True
KEEPS_LONGEST = False
KEEPS_SHORTEST = False

MOST_TIMES_AS_LONG = 3.0
"""Greatest length of a member's own way, in lengths of the leader's: the leader flies so much slower."""
POINTS_ADDED = 4
"""Greatest number of points that a way has besides the turns of its route."""
_LOOKS = 129


class UnderWay(msgspec.Struct, frozen=True):
    """The rest of a split that the group flies."""

    routes: tuple[tuple[Cell, ...], ...]
    """rest of each other member's own route, from its start on"""
    n_onward: int
    """number of cells of the leader's route from the meeting to the goal"""
    shape: int


class Params(msgspec.Struct, frozen=True):
    """A group, its members' cells at the start of the problem, and the price of flying apart."""

    group: formation.Params = msgspec.field(default_factory=formation.Params)
    members: tuple[int, ...] = (0,)
    """system ids in the order of the places, the leader first"""
    starts: tuple[Cell, ...] = ((0, 0),)
    factor: float = 1.0
    """a of `meeting`"""
    reach_cells: float = math.inf
    """greatest distance between two members [cells]"""
    under_way: UnderWay | None = None


def plan(problem: Problem, params: Params) -> Route:
    """Return the leader's route of least cost, with a split if it is cheaper. Raises Unreachable."""
    is_apart = params.under_way is not None
    found = split(problem, params.group, params.starts, params.factor, is_apart=is_apart)
    if found.meeting is not None and found.is_cheaper:
        made = SplitPlan(params.members, found.routes, found.onward[1], found.meeting.shape)
        if _can_be_flown(made, params.reach_cells):
            route = route_of(problem, (*found.routes[0], *found.onward[1:]), found.apart)
            return replace(route, split=made)
    if is_apart:
        raise Unreachable("the members of the split group find no place where all can meet")
    return formation.plan(problem, params.group)


def measure(problem: Problem, cells: Sequence[Cell], params: Params) -> float:
    """Return the cost of the group with its leader on these cells; infinite if a wall is in its way."""
    rest = params.under_way
    if rest is None:
        return formation.measure(problem, cells, params.group)
    n_own = len(cells) - rest.n_onward + 1
    if n_own < 1:
        return math.inf
    ways = (cells[:n_own], *rest.routes)
    if not all(is_open(problem, way) for way in ways):
        return math.inf
    together = replace(params.group, start_heading_deg=None, start_shape=rest.shape)
    onward = formation.measure(replace(problem, start=cells[n_own - 1]), cells[n_own - 1 :], together)
    return params.factor * sum(eq5_cost(problem, way) for way in ways) + onward


def _can_be_flown(plan: SplitPlan, reach_cells: float) -> bool:
    """Return whether the members stay near enough to each other, and the leader need not be too slow.

    All members have flown the same share of their ways at each time.
    """
    if sum(len(ends_and_turns(way)) + POINTS_ADDED for way in plan.extended) > MAX_WAY_POINTS:
        return False
    places, lengths = [], []
    for way in plan.extended:
        points = np.array(way, dtype=np.float64)
        at = np.concatenate([[0.0], np.hypot(*np.diff(points, axis=0).T).cumsum()])
        looks = np.linspace(0.0, at[-1], _LOOKS)
        places.append(np.column_stack([np.interp(looks, at, points[:, axis]) for axis in (0, 1)]))
        lengths.append(at[-1])
    apart = np.array(places)[:, np.newaxis] - np.array(places)[np.newaxis]
    is_near = np.hypot(apart[..., 0], apart[..., 1]).max() <= reach_cells
    return bool(is_near and max(lengths) <= MOST_TIMES_AS_LONG * lengths[0])
