"""The messages of the abstract mission as machine code: who is in range, loss, delay and order of arrival.

The functions are those of `mission` and of `bus.radio`.
"""

from __future__ import annotations

import math

import numpy as np

from swarmctl.planners.kernels.lattice import Floats, Ints
from swarmctl.study.kernel_layout import (
    ARRIVES_S,
    FROM,
    FROM_S,
    FROM_X,
    FROM_Y,
    HEAD,
    OBSERVATION,
    OVERFLOW,
    SENT,
    SENT_X,
    SENT_Y,
    TAIL,
    TO,
    TO_S,
    TO_X,
    TO_Y,
    Messages,
    Settings,
    Vehicles,
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


def draw_message(i: int, j: int, settings: Settings, messages: Messages) -> float:
    """Return the jitter of the next message from i to j [s]; infinite for a lost one (`Radio`)."""
    if not settings.is_random:
        return 0.0
    number, draws = messages.drawn[i, j], messages.draws
    messages.drawn[i, j] += 1
    if 2 * number + 1 >= draws.shape[2]:
        messages.counts[OVERFLOW] = 1
        return np.inf
    is_lost = draws[i, j, 2 * number] < messages.p_lost[i, j]
    messages.p_lost[i, j] = settings.p_stay if is_lost else settings.p_enter
    return np.inf if is_lost else draws[i, j, 2 * number + 1] * settings.jitter_s


def move(times: Floats, ends: Ints, slot: int, to: int) -> None:
    for column in range(3):
        times[to, column], ends[to, column] = times[slot, column], ends[slot, column]


def enqueue(messages: Messages, at_s: float, x: float, y: float, to: int, i: int, seen: int) -> None:
    """Add a message under way; those that arrive at one time keep the order of sending."""
    times, ends, counts = messages.times, messages.ends, messages.counts
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
    settings: Settings,
    vehicles: Vehicles,
    messages: Messages,
) -> None:
    """Send an observation to the vehicles in range, except the one it came from and its observer."""
    floats, counts = vehicles.floats, messages.counts
    n = nearest(floats, i, settings.range, now_s, messages.order, messages.metres)
    x, y = position_m(floats, i, now_s)
    for slot in range(n):
        j = messages.order[slot]
        jitter_s = np.inf
        if skipped != j != observer:
            vehicles.ints[i, SENT] += 1
            jitter_s = draw_message(i, j, settings, messages)
        if jitter_s < np.inf:
            at_s = now_s + settings.delay_s + jitter_s
            if counts[TAIL] - counts[HEAD] == messages.times.shape[0]:
                counts[OVERFLOW] = 1
            else:
                enqueue(messages, at_s, x, y, j, i, seen)


def is_in_range(i: int, now_s: float, x: float, y: float, settings: Settings, floats: Floats) -> bool:
    here_x, here_y = position_m(floats, i, now_s)
    metres = math.sqrt((here_x - x) * (here_x - x) + (here_y - y) * (here_y - y))
    return bool(settings.min_m <= metres <= settings.max_m)
