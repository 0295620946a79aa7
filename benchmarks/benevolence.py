"""The estimate of benevolence against exact values: `python benchmarks/benevolence.py` (half a minute).

1. The value of knowing a cell, V_u(j), against planning again for both outcomes, for every unobserved cell.
2. The route of a benevolent vehicle (b = 1) against the best of many routes. A route costs its Eq. 5, and the
   expected route cost of the other vehicle after it has been told all cells seen from the route. The mean is
   over worlds drawn from the belief, the same for all routes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from tables import make_table

from swarmctl.core.belief import Belief
from swarmctl.core.exposure import exposure, prior_inner_exposure
from swarmctl.core.grid import Cell
from swarmctl.core.observation import Observation
from swarmctl.core.threat import FiringStrength
from swarmctl.planners import Problem, cost_to_go, plan
from swarmctl.planners.base import eq5_cost
from swarmctl.planners.benevolence import OtherVehicle, cell_gains, value_of_knowing

STRENGTH = FiringStrength(0.6, 0.3, 0.1)
AREAS = ((8, 5), (10, 8), (20, 24))
WEIGHTS = (0.2, 0.5, 0.9)
N_BELIEFS, N_LOOKS, N_CASES, N_DRAWN = 4, 4, 20, 60


def around(side: int, cell: Cell) -> list[Cell]:
    rows, cols = (range(max(i - 1, 0), min(i + 2, side)) for i in cell)
    return [(r, c) for r in rows for c in cols]


def belief_of(rng: np.random.Generator, side: int, hostiles: int) -> Belief:
    """Return a belief after N_LOOKS looks at random places of a random world."""
    truth = np.zeros(side * side, dtype=bool)
    truth[rng.choice(side * side, hostiles, replace=False)] = True
    belief = Belief.prior(side, side, hostiles)
    for seq, (row, col) in enumerate(rng.integers(0, side, (N_LOOKS, 2)).tolist()):
        seen = tuple((r, c, bool(truth[r * side + c])) for r, c in around(side, (row, col)))
        belief = belief.merge([Observation(1, seq + 1, 0.0, seen)])
    return belief


def drawn_other(rng: np.random.Generator, side: int) -> OtherVehicle:
    start, end = rng.integers(0, side, 2).tolist()
    return OtherVehicle((start, 0), ((end, side - 1),))


def route_cost(belief: Belief, other: OtherVehicle, w: float, psi: float) -> float:
    return float(cost_to_go(exposure(belief.occupancy(), STRENGTH), other.goals, w, psi).cost[other.cell])


def exact_values(belief: Belief, other: OtherVehicle, w: float, psi: float) -> NDArray[np.float64]:
    p, now = belief.occupancy(), route_cost(belief, other, w, psi)
    values = np.zeros(p.shape)
    for row, col in np.argwhere(belief.looks == 0).tolist():
        for occupied, chance in ((True, p[row, col]), (False, 1.0 - p[row, col])):
            known = belief.merge([Observation(9, 1, 0.0, ((row, col, occupied),))])
            values[row, col] += chance * (now - route_cost(known, other, w, psi))
    return values


def compare_values(console: Console) -> None:
    table = make_table("Value of a cell", "cells", "hostiles", "w", "correlation", "sum / exact sum")
    for side, hostiles in AREAS:
        psi = prior_inner_exposure(side, side, hostiles, STRENGTH)
        for w in WEIGHTS:
            rng, correlations, ratios = np.random.default_rng(1), [], []
            for _ in range(N_BELIEFS):
                belief, other = belief_of(rng, side, hostiles), drawn_other(rng, side)
                p, unseen = belief.occupancy(), belief.looks == 0
                exact = exact_values(belief, other, w, psi)[unseen]
                found = value_of_knowing(p, exposure(p, STRENGTH), STRENGTH, other, w, psi)[unseen]
                correlations.append(np.corrcoef(exact, found)[0, 1])
                ratios.append(found.sum() / exact.sum())
            ranges = (f"{min(found):.3f} to {max(found):.3f}" for found in (correlations, ratios))
            table.add_row(f"{side} × {side}", str(hostiles), f"{w:g}", *ranges)
    console.print(table)


def drawn_worlds(rng: np.random.Generator, belief: Belief) -> list[NDArray[np.bool_]]:
    known, unseen = belief.hits.ravel() > 0, np.flatnonzero(belief.looks == 0)
    n_hidden = belief.count.greatest - int(known.sum())
    worlds = []
    for _ in range(N_DRAWN):
        world = known.copy()
        world[rng.choice(unseen, n_hidden, replace=False)] = True
        worlds.append(world.reshape(belief.looks.shape))
    return worlds


def compare_routes(console: Console, side: int = 8, hostiles: int = 5, w: float = 0.5) -> None:
    rng, psi, rows = np.random.default_rng(2), prior_inner_exposure(side, side, hostiles, STRENGTH), []
    for _ in range(N_CASES):
        belief, other, own = belief_of(rng, side, hostiles), drawn_other(rng, side), drawn_other(rng, side)
        worlds, p = drawn_worlds(rng, belief), belief.occupancy()
        p_s = exposure(p, STRENGTH)
        gain = cell_gains(p, p_s, STRENGTH, [other], w, psi)
        problem = Problem(p_s, own.cell, own.goals, w, psi)

        def total(cells: tuple[Cell, ...]) -> float:
            """Return the own cost, and the mean cost of the other after it was told what the route sees."""
            seen = {cell for over in cells for cell in around(side, cell=over)}
            costs = []
            for world in worlds:  # noqa: B023 - called in this iteration only
                looked = tuple((r, c, bool(world[r, c])) for r, c in sorted(seen) if not belief.looks[r, c])  # noqa: B023
                told = belief.merge([Observation(9, 1, 0.0, looked)])  # noqa: B023
                costs.append(route_cost(told, other, w, psi))  # noqa: B023
            return eq5_cost(problem, cells) + float(np.mean(costs))  # noqa: B023

        selfish = plan(problem).cells
        benevolent = plan(Problem(p_s, own.cell, own.goals, w, psi, gain=gain)).cells
        to_goal, to_start = cost_to_go(p_s, own.goals, w, psi), cost_to_go(p_s, [own.cell], w, psi)
        over_cells = {
            (*reversed(to_start.cells_from(cell)), *to_goal.cells_from(cell)[1:])
            for cell in np.ndindex(side, side)
        }
        candidates = {cells: total(cells) for cells in over_cells | {selfish, benevolent}}
        rows.append((candidates[selfish], candidates[benevolent], min(candidates.values())))
    alone, kind, best = np.array(rows).T
    open_to_gain = alone - best > 1e-9
    table = make_table("Route cost of both vehicles, mean over cases", "selfish", "benevolent", "best known")
    table.add_row(f"{alone.mean():.4f}", f"{kind.mean():.4f}", f"{best.mean():.4f}")
    console.print(table)
    n_better, n_worse = (kind < alone - 1e-9).sum(), (kind > alone + 1e-9).sum()
    share = (alone - kind).sum() / (alone - best).sum()
    console.print(
        f"{N_CASES} cases; a better route exists in {open_to_gain.sum()}; the benevolent route beats "
        f"the selfish one in {n_better}, and is worse in {n_worse}; share of the possible gain: {share:.0%}"
    )


if __name__ == "__main__":
    compare_values(Console(width=100))
    compare_routes(Console(width=100))
