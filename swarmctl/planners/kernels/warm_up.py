"""Compilation of all kernels before a flight, so that no vehicle waits for a compiler in the air."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from swarmctl.planners.kernels import bounds, buckets, descent, group_field, information, labels, lattice
from swarmctl.planners.kernels.compilation import compiled


def warm_up(report: Callable[[int, int], None] = lambda _done, _total: None) -> None:
    """Compile all kernels, or load them from numba's cache.

    `report` receives the numbers of compiled kernels and of all kernels, before each kernel and at the end.
    """
    calls = list(_calls())
    for done, (kernel, arguments) in enumerate(calls):
        report(done, len(calls))
        compiled(kernel)(*arguments)
    report(len(calls), len(calls))


def _calls() -> Iterator[tuple[Callable[..., object], tuple[Any, ...]]]:
    """Yield kernels with arguments of the right types, for an area of one cell.

    Some kernels that `descend` calls come before `descend`, so that each step is short.
    """
    exposure, label, length = np.zeros((1, 1)), np.full(9, math.inf), np.full(9, math.inf)
    straight = label.copy()
    label[4], straight[4], width, goal, cells = 0.0, 0.5, 3, 4, np.array([4])
    offsets, area = lattice.offsets_of(width), (1, 1)
    yield lattice.offsets_of, (width,)
    queue = (buckets.DIRECTIONS, *[np.zeros(buckets.SLOTS * buckets.LEVELS, dtype=np.int64)] * 6)
    yield buckets.spread, (label, straight, 0.2, width, 1.0, math.inf, False, *queue)
    field = (label, 0.5, 0.2, straight)
    yield descent.cost_of, (*field, offsets, goal)
    yield descent.costs, (*field, *area, False)
    yield descent.find_lengths, (*field, width, cells, goal, length)
    yield descent.descend, (*field, False, width, cells, goal, np.empty(0))
    yield bounds.compare, (exposure, 0.5, 0.5, straight, 1, 1)
    yield bounds.descend_roughly, (label, 0.2, width, cells, goal, 1)
    yield bounds.least_cost_outside, (label, *area, label, straight, width, 0, 0, 1, math.inf, 1.0)
    gain = (label, *[np.zeros(9)] * 3, np.zeros(3), 0.5, 0.5, 0.2, width, goal, cells, 1)
    yield information.value_of_knowing, gain
    goals = np.ones(9, dtype=np.bool_)
    yield labels.set_labels, (straight, width, goal, goals, label, label, label, 1.0, 3.0, 1.0, False, 0)
    group, start = _group_of_one(), np.array([goal])
    yield group_field.may_turn, (group.barrier, group.swept[0, 0], goal)
    yield group_field.may_move, (group.barrier, group.offsets, group.swept[0, 0], goal, 0)
    yield group_field.find_labels, (group, start)
    yield group_field.costs_ahead, (group, group.entry)
    yield group_field.descend, (group, np.zeros(9), start, 0.0)


def _group_of_one() -> group_field.GroupGraph:
    """Return the graph of one vehicle with one pose, which is at its goal."""
    offsets = lattice.offsets_of(3)
    return group_field.GroupGraph(
        barrier=np.zeros(9),
        near_barrier=np.zeros(9, dtype=np.uint8),
        entry=np.full(9, math.inf),
        turn=np.zeros((1, 1)),
        turn_length=np.zeros((1, 1)),
        swept=np.zeros((1, 1, 1, 1), dtype=np.int32),
        step=np.ones(1),
        step_length=np.ones(1),
        ahead=offsets[:1],
        offsets=offsets,
        goals=np.array([4]),
    )
