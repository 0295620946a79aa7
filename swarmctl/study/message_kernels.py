"""The messages of the abstract mission as machine code: who is in range, loss, delay and order of arrival.

The functions are those of `mission` and of `bus.radio`.
"""

from __future__ import annotations

import math

import numpy as np

from swarmctl.planners.kernels.lattice import Floats, Ints
from swarmctl.study.kernel_layout import (
    ARRIVES_S,
    DELAY_S,
    FROM,
    FROM_S,
    FROM_X,
    FROM_Y,
    HEAD,
    IS_RANDOM,
    JITTER_S,
    MAX_M,
    MIN_M,
    OBSERVATION,
    OVERFLOW,
    P_ENTER,
    P_STAY,
    RANGE,
    SENT,
    SENT_X,
    SENT_Y,
    TAIL,
    TO,
    TO_S,
    TO_X,
    TO_Y,
)


def position_m(floats: Floats, i: int, now_s: float) -> tuple[float, float]:
    if now_s >= floats[i, TO_S]:
        return floats[i, TO_X], floats[i, TO_Y]
    share = max(now_s - floats[i, FROM_S], 0.0) / (floats[i, TO_S] - floats[i, FROM_S])
    x = floats[i, FROM_X] + share * (floats[i, TO_X] - floats[i, FROM_X])
    return x, floats[i, FROM_Y] + share * (floats[i, TO_Y] - floats[i, FROM_Y])


def nearest(floats: Floats, i: int, k: int, now_s: float, order: Ints, metres: Floats) -> int:
    """Write the vehicles in communication range into `order`, and return their number."""
    n, size = floats.shape[0], 0
    x, y = position_m(floats, i, now_s)
    for j in range(n):
        if j == i:
            continue
        if k < n - 1:
            other_x, other_y = position_m(floats, j, now_s)
            metres[j] = math.sqrt((other_x - x) * (other_x - x) + (other_y - y) * (other_y - y))
        slot = size
        while k < n - 1 and slot > 0 and metres[order[slot - 1]] > metres[j]:
            order[slot] = order[slot - 1]
            slot -= 1
        order[slot] = j
        size += 1
    return min(k, size)


def draw_message(
    i: int, j: int, rules: Ints, settings: Floats, draws: Floats, drawn: Ints, p_lost: Floats, counts: Ints
) -> float:
    """Return the jitter of the next message from i to j [s]; infinite for a lost one (`Radio`)."""
    if rules[IS_RANDOM] == 0:
        return 0.0
    number = drawn[i, j]
    drawn[i, j] += 1
    if 2 * number + 1 >= draws.shape[2]:
        counts[OVERFLOW] = 1
        return np.inf
    is_lost = draws[i, j, 2 * number] < p_lost[i, j]
    p_lost[i, j] = settings[P_STAY] if is_lost else settings[P_ENTER]
    return np.inf if is_lost else draws[i, j, 2 * number + 1] * settings[JITTER_S]


def move(times: Floats, ends: Ints, slot: int, to: int) -> None:
    for column in range(3):
        times[to, column], ends[to, column] = times[slot, column], ends[slot, column]


def enqueue(
    times: Floats, ends: Ints, counts: Ints, at_s: float, x: float, y: float, to: int, i: int, seen: int
) -> None:
    """Add a message under way; those that arrive at one time keep the order of sending."""
    if counts[HEAD] == counts[TAIL]:
        counts[HEAD] = counts[TAIL] = 0
    if counts[TAIL] == times.shape[0]:
        n = counts[TAIL] - counts[HEAD]
        for slot in range(n):
            move(times, ends, counts[HEAD] + slot, slot)
        counts[HEAD], counts[TAIL] = 0, n
    slot = counts[TAIL]
    while slot > counts[HEAD] and times[slot - 1, ARRIVES_S] > at_s:
        move(times, ends, slot - 1, slot)
        slot -= 1
    times[slot, ARRIVES_S], times[slot, SENT_X], times[slot, SENT_Y] = at_s, x, y
    ends[slot, TO], ends[slot, FROM], ends[slot, OBSERVATION] = to, i, seen
    counts[TAIL] += 1


def send(
    i: int,
    seen: int,
    now_s: float,
    skipped: int,
    observer: int,
    ints: Ints,
    floats: Floats,
    rules: Ints,
    settings: Floats,
    draws: Floats,
    drawn: Ints,
    p_lost: Floats,
    times: Floats,
    ends: Ints,
    counts: Ints,
    order: Ints,
    metres: Floats,
) -> None:
    """Send an observation to the vehicles in range, except the one it came from and its observer."""
    n = nearest(floats, i, rules[RANGE], now_s, order, metres)
    x, y = position_m(floats, i, now_s)
    for slot in range(n):
        j = order[slot]
        jitter_s = np.inf
        if skipped != j != observer:
            ints[i, SENT] += 1
            jitter_s = draw_message(i, j, rules, settings, draws, drawn, p_lost, counts)
        if jitter_s < np.inf:
            at_s = now_s + settings[DELAY_S] + jitter_s
            if counts[TAIL] - counts[HEAD] == times.shape[0]:
                counts[OVERFLOW] = 1
            else:
                enqueue(times, ends, counts, at_s, x, y, j, i, seen)


def is_in_range(floats: Floats, settings: Floats, i: int, now_s: float, x: float, y: float) -> bool:
    here_x, here_y = position_m(floats, i, now_s)
    metres = math.sqrt((here_x - x) * (here_x - x) + (here_y - y) * (here_y - y))
    return bool(settings[MIN_M] <= metres <= settings[MAX_M])
