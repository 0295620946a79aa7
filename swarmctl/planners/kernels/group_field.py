"""The least cost of a group from every cell and pose to a goal, and the cheapest route.

A pose is a shape with a heading; `planners.poses` has the costs. A state is a cell of the leader with the
pose in which the group arrived there; its index is cell · poses + pose. The cost to go of a state is

    label[c, k] = min over poses j of (turn[k, j] + step[j] + entry[c + j, j] + label[c + j, j])

with c + j the neighbour of c in the heading of pose j. The group first takes pose j at c, then moves.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from swarmctl.planners.kernels.descent import REL_TIE, is_goal
from swarmctl.planners.kernels.lattice import Bytes, Floats, Int32s, Ints, cuts_corner, pop_least, push


class GroupGraph(NamedTuple):
    """The graph of a group's states; cells are flat indices of an area padded by more than a place's reach.

    A barrier is 0 in an open cell, infinite in a wall, and outside the area the distance to it [cells].
    """

    barrier: Floats
    near_barrier: Bytes
    """1 for a cell of the leader from which a member can come near a barrier"""
    entry: Floats
    """cost of the members' exposure on arrival in each state; infinite in a wall and in the padding"""
    turn: Floats
    """(poses, poses): cost of a change of pose; infinite if it is not allowed"""
    turn_length: Floats
    """(poses, poses): sum of the ways of the members [cells]"""
    swept: Int32s
    """(poses, poses, members, points): offsets of the cells on a member's way from pose to pose"""
    step: Floats
    """(poses,): cost of a step in the heading of each pose, without exposure"""
    step_length: Floats
    """(poses,): sum of the ways of the members [cells]"""
    ahead: Ints
    """(poses,): offset of the cell one step ahead"""
    offsets: Ints
    """offsets of the eight neighbours"""
    goals: Ints
    """sorted"""


def may_turn(barrier: Floats, swept: Int32s, m: int) -> bool:
    """Return whether all members may take their new places while the leader stays in m.

    `swept` has the offsets of the cells on each member's way, (members, points).
    """
    last = swept.shape[1] - 1
    for i in range(swept.shape[0]):
        old, new = barrier[m + swept[i, 0]], barrier[m + swept[i, last]]
        if old == 0.0:
            for point in range(last + 1):
                if barrier[m + swept[i, point]] != 0.0:
                    return False
        elif old < np.inf and new > old:
            return False
    return True


def may_move(barrier: Floats, offsets: Ints, swept: Int32s, m: int, h: int) -> bool:
    """Return whether all members may go one step in the direction h, with the leader in m.

    A member enters only open cells. A member outside the area may stay outside if it comes nearer.
    """
    for i in range(swept.shape[0]):
        here = m + swept[i, 0]
        old, new = barrier[here], barrier[here + offsets[h]]
        if new > 0.0 and not new < old < np.inf:
            return False
        if h >= 4 and cuts_corner(barrier, offsets, here, h):
            return False
    return True


def find_labels(graph: GroupGraph, starts: Ints) -> tuple[Floats, float]:
    """Return the labels of all states up to the least label of the states `starts`, and this label.

    The labels of other states are greater, and upper bounds only. Infinite: no route.
    """
    n_poses = graph.turn.shape[0]
    label = np.full(graph.entry.size, np.inf)
    is_start = np.zeros(graph.entry.size, dtype=np.bool_)
    for start in starts:
        is_start[start] = True
    heap, keys, size = np.empty(4096, dtype=np.int64), np.empty(4096), 0
    for m in graph.goals:
        for k in range(n_poses):
            label[m * n_poses + k] = 0.0
            heap, keys, size = push(heap, keys, size, m * n_poses + k, 0.0)
    until = np.inf
    while size > 0:
        state, key = heap[0], keys[0]
        size = pop_least(heap, keys, size)
        if key > until * (1.0 + REL_TIE):
            break
        if key > label[state]:
            continue
        if is_start[state]:
            until = min(until, key)
        if graph.entry[state] == np.inf:
            continue
        k = state % n_poses
        m = state // n_poses - graph.ahead[k]
        if graph.barrier[m] > 0.0 and graph.barrier[m] < np.inf:  # the leader never is outside
            continue
        is_near = graph.near_barrier[m] != 0
        if is_near and not may_move(graph.barrier, graph.offsets, graph.swept[k, k], m, k & 7):
            continue
        onward = key + graph.entry[state] + graph.step[k]
        for j in range(n_poses):
            before = m * n_poses + j
            better = onward + graph.turn[j, k]
            if better < label[before] and (not is_near or may_turn(graph.barrier, graph.swept[j, k], m)):
                label[before] = better
                heap, keys, size = push(heap, keys, size, before, better)
    return label, until


def costs_ahead(graph: GroupGraph, label: Floats) -> Floats:
    """Return the cost to go from each state if the next step is straight ahead; infinite if it is closed."""
    n_poses = graph.turn.shape[0]
    cost = np.full(label.size, np.inf)
    for state in range(label.size):
        if graph.entry[state] == np.inf or label[state] == np.inf:
            continue
        k = state % n_poses
        m = state // n_poses - graph.ahead[k]
        if may_move(graph.barrier, graph.offsets, graph.swept[k, k], m, k & 7):
            cost[m * n_poses + k] = label[state] + graph.entry[state] + graph.step[k]
    return cost


def descend(graph: GroupGraph, label: Floats, starts: Ints, cost: float) -> Ints:
    """Return the states of the cheapest route from one of `starts`, of finite label `cost`, to a goal.

    Costs within REL_TIE count as equal. Of equally cheap routes the members' shortest is taken.
    """
    n_poses = graph.turn.shape[0]
    length = np.full(label.size, np.inf)
    previous = np.full(label.size, -1)
    heap, keys, size = np.empty(256, dtype=np.int64), np.empty(256), 0
    for start in starts:
        if label[start] <= cost * (1.0 + REL_TIE):
            length[start] = 0.0
            heap, keys, size = push(heap, keys, size, start, 0.0)
    state = -1
    while size > 0:
        state, key = heap[0], keys[0]
        size = pop_least(heap, keys, size)
        if key > length[state]:
            continue
        m, j = state // n_poses, state % n_poses
        if is_goal(graph.goals, m):
            break
        bound = label[state] * (1.0 + REL_TIE)
        is_near = graph.near_barrier[m] != 0
        for k in range(n_poses):
            after = (m + graph.ahead[k]) * n_poses + k
            if label[after] + graph.entry[after] + graph.step[k] + graph.turn[j, k] > bound:
                continue
            longer = key + graph.turn_length[j, k] + graph.step_length[k]
            if longer < length[after] and (
                not is_near
                or (
                    may_turn(graph.barrier, graph.swept[j, k], m)
                    and may_move(graph.barrier, graph.offsets, graph.swept[k, k], m, k & 7)
                )
            ):
                length[after] = longer
                previous[after] = state
                heap, keys, size = push(heap, keys, size, after, longer)
    n = 0
    at = state
    while at >= 0:
        n += 1
        at = previous[at]
    path = np.empty(n, dtype=np.int64)
    at = state
    for index in range(n - 1, -1, -1):
        path[index] = at
        at = previous[at]
    return path
