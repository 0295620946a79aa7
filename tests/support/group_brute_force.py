"""The cheapest flight of a group through a small area, by a plain search over every state."""

from __future__ import annotations

import functools
import heapq
import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from swarmctl.core.grid import Cell
from swarmctl.planners import Problem
from swarmctl.planners.formation import Params

STEPS = {
    0: (1, 0), 45: (1, 1), 90: (0, 1), 135: (-1, 1), 180: (-1, 0), 225: (-1, -1), 270: (0, -1), 315: (1, -1)
}  # fmt: skip
"""(rows north, columns east) of one step by heading [deg]"""
Pose = tuple[int, int]
"""(heading [deg], shape)"""
State = tuple[Cell, Pose]
Place = tuple[float, float]


@dataclass(frozen=True)
class Group:
    """A group over the area of a problem."""

    problem: Problem
    params: Params

    @property
    def poses(self) -> list[Pose]:
        return list(itertools.product(STEPS, range(len(self.params.shapes))))

    def start_poses(self) -> list[Pose]:
        heading, shape = self.params.start_heading_deg, self.params.start_shape
        return [pose for pose in self.poses if heading in (None, pose[0]) and shape in (None, pose[1])]

    def places(self, pose: Pose) -> list[Place]:
        """Return (north, east) of each member from the leader; eighths of a circle without rounding."""
        heading, shape = pose
        north, east = (part * (math.sqrt(0.5) if heading % 90 else 1.0) for part in STEPS[heading])
        return [(f * north - r * east, f * east + r * north) for f, r in self.params.shapes[shape]]

    def cells(self, leader: Cell, pose: Pose) -> list[Cell]:
        return [_at(leader, place) for place in self.places(pose)]

    def ahead(self, leader: Cell, pose: Pose) -> Cell:
        return leader[0] + STEPS[pose[0]][0], leader[1] + STEPS[pose[0]][1]

    def is_wall(self, cell: Cell) -> bool:
        return self.is_inside(cell) and math.isinf(self.problem.passable[cell])

    def is_inside(self, cell: Cell) -> bool:
        rows, cols = self.problem.exposure.shape
        return 0 <= cell[0] < rows and 0 <= cell[1] < cols

    def outside_by(self, cell: Cell) -> int:
        rows, cols = self.problem.exposure.shape
        return max(-cell[0], cell[0] - rows + 1, -cell[1], cell[1] - cols + 1, 0)

    def is_open(self, cell: Cell) -> bool:
        return self.is_inside(cell) and not self.is_wall(cell)

    def turn_cost(self, leader: Cell, old: Pose, new: Pose) -> float:
        """Return the cost of a change of pose; infinite if it is not allowed."""
        problem, params = self.problem, self.params
        if abs((new[0] - old[0] + 180) % 360 - 180) > params.max_turn_deg:
            return math.inf
        ways = list(zip(self.places(old), self.places(new), strict=True))
        n_points = math.ceil(4.0 * self.longest_way) + 1
        for a, b in ways:
            before, after = _at(leader, a), _at(leader, b)
            if self.is_open(before):
                shares = [k / (n_points - 1) for k in range(n_points - 1)]
                passed = [(a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t) for t in shares]
                is_allowed = all(self.is_open(_at(leader, place)) for place in [*passed, b])
            elif self.is_wall(before) or self.is_open(after):
                is_allowed = True
            else:
                is_allowed = not self.is_wall(after) and self.outside_by(after) <= self.outside_by(before)
            if not is_allowed:
                return math.inf
        distance = (1.0 - problem.w) * problem.psi_per_cell * sum(math.dist(a, b) for a, b in ways)
        return distance + (params.change_cost if old[1] != new[1] != 0 else 0.0)

    @functools.cached_property
    def longest_way(self) -> float:
        return max(
            math.dist(a, b)
            for old, new in itertools.product(self.poses, self.poses)
            if abs((new[0] - old[0] + 180) % 360 - 180) <= self.params.max_turn_deg
            for a, b in zip(self.places(old), self.places(new), strict=True)
        )

    def step_cost(self, leader: Cell, pose: Pose) -> float:
        """Return the cost of one step ahead; infinite if a member cannot go."""
        problem = self.problem
        north, east = STEPS[pose[0]]
        if not self.is_inside(self.ahead(leader, pose)):
            return math.inf
        exposures = []
        for here in self.cells(leader, pose):
            there = here[0] + north, here[1] + east
            if self.is_wall(there) or (
                not self.is_inside(there)
                and (self.is_inside(here) or self.outside_by(there) >= self.outside_by(here))
            ):
                return math.inf
            beside = (here[0] + north, here[1]), (here[0], here[1] + east)
            if north and east and not self.is_wall(here) and any(self.is_wall(cell) for cell in beside):
                return math.inf
            exposures.append(float(problem.exposure[there]) if self.is_inside(there) else 0.0)
        distance = (1.0 - problem.w) * problem.psi_per_cell * math.hypot(north, east) * len(exposures)
        if pose[1] > 0:
            distance += self.params.other_shape_cost * math.hypot(north, east)
        if self.params.exposure == "sum":
            return distance + problem.w * math.fsum(exposures)
        return distance + problem.w * (1.0 - math.prod(max(1.0 - p, 0.0) for p in exposures))

    def onward(self, state: State) -> Iterator[tuple[State, float]]:
        """Yield the states after one step, with the cost."""
        leader, old = state
        for new in self.poses:
            step = self.step_cost(leader, new)
            cost = step if math.isinf(step) else self.turn_cost(leader, old, new) + step
            if not math.isinf(cost):
                yield (self.ahead(leader, new), new), cost

    def least_costs(self, starts: Sequence[State], goals: Sequence[Cell] = ()) -> dict[State, float]:
        """Return the least cost from one of `starts` to each state reached, without a step beyond `goals`."""
        best = dict.fromkeys(starts, 0.0)
        heap = [(0.0, state) for state in starts]
        while heap:
            cost, state = heapq.heappop(heap)
            if cost > best[state] or state[0] in goals:
                continue
            for after, step in self.onward(state):
                if cost + step < best.get(after, math.inf):
                    best[after] = cost + step
                    heapq.heappush(heap, (cost + step, after))
        return best

    def cost_to_go(self, starts: Sequence[State]) -> float:
        found = self.least_costs(starts, self.problem.goals)
        return min(
            (cost for (cell, _), cost in found.items() if cell in self.problem.goals), default=math.inf
        )

    def costs_to_go(self) -> dict[State, float]:
        """Return the least cost from each state to a goal, by Bellman and Ford."""
        rows, cols = self.problem.exposure.shape
        edges = {
            state: list(self.onward(state))
            for state in itertools.product(itertools.product(range(rows), range(cols)), self.poses)
        }
        best = {state: 0.0 if state[0] in self.problem.goals else math.inf for state in edges}
        while True:
            better = {
                state: min([best[state], *(best[after] + cost for after, cost in edges[state])])
                for state in edges
            }
            if better == best:
                return best
            best = better

    def cost_along(self, cells: Sequence[Cell]) -> float:
        """Return the least cost of the leader's cells over all poses."""
        sums = {(cells[0], pose): 0.0 for pose in self.start_poses()}
        for there in cells[1:]:
            reached: dict[State, float] = {}
            for state, cost in sums.items():
                for after, step in self.onward(state):
                    if after[0] == there:
                        reached[after] = min(reached.get(after, math.inf), cost + step)
            sums = reached
        return min(sums.values(), default=math.inf)


def _at(leader: Cell, place: Place) -> Cell:
    return leader[0] + round(place[0]), leader[1] + round(place[1])
