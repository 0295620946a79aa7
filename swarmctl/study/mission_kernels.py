"""The abstract mission as machine code: `mission` for the paper's planner, sensor and number of hostiles.

`compiled_mission` prepares the arrays; the kernels are plain functions of them, one for each part.
"""

from __future__ import annotations

import numpy as np

from swarmctl.planners.kernels.descent import is_goal
from swarmctl.planners.kernels.lattice import ROOT2, Bytes, Floats, Ints
from swarmctl.study.kernel_layout import (
    ARRIVED_S,
    ARRIVES_S,
    CELL_M,
    CENTRE_S,
    DECIDE,
    EDGE_S,
    ENDED,
    FOUND,
    FROM,
    FROM_S,
    FROM_X,
    FROM_Y,
    HAS_NEWS,
    HEAD,
    INDEX,
    KNOWN,
    MAX_ENTRIES,
    N_FLOWN,
    N_OBSERVATIONS,
    OBSERVATION,
    OVERFLOW,
    PHASE,
    RECEIVED,
    RELAYS,
    SEE,
    SENT_X,
    SENT_Y,
    SPEED,
    TAIL,
    TO,
    TO_S,
    TO_X,
    TO_Y,
    UAV,
    WIDTH,
    Int32s,
)
from swarmctl.study.message_kernels import is_in_range, send
from swarmctl.study.replan_kernels import replan

STRIKE = 1
GAMMA, FIRST, SECOND = (
    np.uint64(0x9E3779B97F4A7C15),
    np.uint64(0xBF58476D1CE4E5B9),
    np.uint64(0x94D049BB133111EB),
)
S30, S27, S31, S11 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)


def mix(value: np.uint64) -> np.uint64:
    value = value + GAMMA
    value = (value ^ (value >> S30)) * FIRST
    value = (value ^ (value >> S27)) * SECOND
    return value ^ (value >> S31)


def draw_strike(seed: np.uint64, uav: int, hostile: int, cell: int, visit: int) -> float:
    """Return `world.uniform` of a strike; cells are row · cols + col."""
    mixed = mix(mix(mix(seed) ^ np.uint64(STRIKE)) ^ np.uint64(uav))
    mixed = mix(mix(mix(mixed ^ np.uint64(hostile)) ^ np.uint64(cell)) ^ np.uint64(visit))
    return float(mixed >> S11) * 2.0**-53


def n_strikes(
    seed: np.uint64, uav: int, m: int, visit: int, width: int, occupied: Bytes, strength: Floats
) -> int:
    """Return the number of hostiles that hit a vehicle at an entry (Eq. 1)."""
    hits, cols = 0, width - 2
    cell = (m // width - 1) * cols + m % width - 1
    for row_step in range(-1, 2):
        for col_step in range(-1, 2):
            n = m + row_step * width + col_step
            if occupied[n]:
                p_hit = strength[abs(row_step) + abs(col_step)]
                hits += draw_strike(seed, uav, cell + row_step * cols + col_step, cell, visit) < p_hit
    return hits


def learn(ints: Ints, i: int, seen: int, news: Int32s, has: Bytes, known: Bytes, occupied: Bytes) -> bool:
    """Merge an observation; return whether it is new to the vehicle."""
    if has[i, seen]:
        return False
    has[i, seen] = 1
    ints[i, HAS_NEWS] = 1
    for slot in range(1, 1 + news[seen, 0]):
        m = news[seen, slot]
        if not known[i, m]:
            known[i, m] = 1
            ints[i, KNOWN] += 1
            ints[i, FOUND] += occupied[m]
    return True


def look(i: int, m: int, width: int, known: Bytes, inside: Bytes, seen: int, news: Int32s) -> int:
    """Write the unknown cells in sight as an observation; return their number."""
    n = 0
    for row_step in range(-1, 2):
        for col_step in range(-1, 2):
            cell = m + row_step * width + col_step
            if inside[cell] and not known[i, cell]:
                n += 1
                news[seen, n] = cell
    news[seen, 0] = n
    return n


def enter(
    i: int,
    seed: np.uint64,
    ints: Ints,
    rules: Ints,
    routes: Int32s,
    flown: Int32s,
    strikes: Int32s,
    visits: Int32s,
    occupied: Bytes,
    inside: Bytes,
    known: Bytes,
    has: Bytes,
    news: Int32s,
    observers: Int32s,
    strength: Floats,
    counts: Ints,
) -> bool:
    """Let the hostiles fire, and see the 3 × 3 cells; return whether anything is new."""
    m, width, uav = int(routes[i, ints[i, INDEX]]), rules[WIDTH], ints[i, UAV]
    slot = ints[i, N_FLOWN]
    ints[i, N_FLOWN] += 1
    visits[i, m] += 1
    flown[i, slot] = m
    strikes[i, slot] = n_strikes(seed, uav, m, int(visits[i, m]), width, occupied, strength)
    seen = counts[N_OBSERVATIONS]
    if look(i, m, width, known, inside, seen, news) == 0:
        return False
    counts[N_OBSERVATIONS] += 1
    observers[seen] = i
    for j in range(has.shape[0]):
        has[j, seen] = 0
    learn(ints, i, seen, news, has, known, occupied)
    return True


def go_on(
    i: int, now_s: float, ints: Ints, floats: Floats, rules: Ints, settings: Floats, routes: Int32s
) -> None:
    """Fly to the next cell of the route."""
    width, cell_m = rules[WIDTH], settings[CELL_M]
    here, there = int(routes[i, ints[i, INDEX]]), int(routes[i, ints[i, INDEX] + 1])
    ints[i, INDEX] += 1
    is_diagonal = here // width != there // width and here % width != there % width
    step_s = (ROOT2 if is_diagonal else 1.0) * (cell_m / floats[i, SPEED])
    floats[i, FROM_S], floats[i, TO_S] = now_s, now_s + step_s
    floats[i, FROM_X] = (here % width - 1 + 0.5) * cell_m
    floats[i, FROM_Y] = (here // width - 1 + 0.5) * cell_m
    floats[i, TO_X] = (there % width - 1 + 0.5) * cell_m
    floats[i, TO_Y] = (there // width - 1 + 0.5) * cell_m
    floats[i, EDGE_S], floats[i, CENTRE_S] = now_s + 0.5 * step_s, now_s + step_s
    ints[i, PHASE] = SEE


def decide(
    i: int,
    now_s: float,
    ints: Ints,
    floats: Floats,
    rules: Ints,
    settings: Floats,
    strength: Floats,
    routes: Int32s,
    goals: Ints,
    first_goals: Ints,
    occupied: Bytes,
    inside: Bytes,
    walls: Bytes,
    offsets: Ints,
    known: Bytes,
    work: Floats,
    heap: Ints,
    keys: Floats,
) -> None:
    """Arrive, or choose the next cell and fly there."""
    own_goals = goals[first_goals[i] : first_goals[i + 1]]
    if is_goal(own_goals, int(routes[i, ints[i, INDEX]])):
        floats[i, ARRIVED_S] = now_s
        ints[i, PHASE] = ENDED
        return
    if ints[i, N_FLOWN] >= rules[MAX_ENTRIES]:
        ints[i, PHASE] = ENDED
        return
    if ints[i, HAS_NEWS] == 1:
        ints[i, HAS_NEWS] = 0
        replan(
            i, ints, rules, settings, routes, own_goals, known, occupied, inside, walls, strength, offsets,
            work, heap, keys,
        )  # fmt: skip
    go_on(i, now_s, ints, floats, rules, settings, routes)


def next_vehicle(ints: Ints, floats: Floats) -> tuple[int, float]:
    """Return the vehicle that acts next and its time; −1 if none does."""
    best, best_s = -1, np.inf
    for i in range(ints.shape[0]):
        if ints[i, PHASE] == ENDED:
            continue
        at_s = floats[i, EDGE_S] if ints[i, PHASE] == SEE else floats[i, CENTRE_S]
        if best < 0 or at_s < best_s or (at_s == best_s and ints[i, PHASE] < ints[best, PHASE]):
            best, best_s = i, at_s
    return best, best_s


def mission(
    seed: np.uint64,
    ints: Ints,
    floats: Floats,
    rules: Ints,
    settings: Floats,
    strength: Floats,
    routes: Int32s,
    goals: Ints,
    first_goals: Ints,
    occupied: Bytes,
    inside: Bytes,
    walls: Bytes,
    offsets: Ints,
    known: Bytes,
    has: Bytes,
    news: Int32s,
    observers: Int32s,
    visits: Int32s,
    flown: Int32s,
    strikes: Int32s,
    draws: Floats,
    drawn: Ints,
    p_lost: Floats,
    times: Floats,
    ends: Ints,
    counts: Ints,
    order: Ints,
    metres: Floats,
    work: Floats,
    heap: Ints,
    keys: Floats,
) -> None:
    """Fly one mission, event by event."""
    while counts[OVERFLOW] == 0:
        i, now_s = next_vehicle(ints, floats)
        sent = -1, -1, -1  # observation to send, vehicle it came from, its observer
        head = counts[HEAD]
        is_message = head < counts[TAIL] and (
            i < 0
            or times[head, ARRIVES_S] < now_s
            or (times[head, ARRIVES_S] == now_s and ints[i, PHASE] == DECIDE)
        )
        if is_message:
            now_s, i, seen = times[head, ARRIVES_S], int(ends[head, TO]), int(ends[head, OBSERVATION])
            counts[HEAD] += 1
            if is_in_range(floats, settings, i, now_s, times[head, SENT_X], times[head, SENT_Y]):
                ints[i, RECEIVED] += 1
                if learn(ints, i, seen, news, has, known, occupied) and rules[RELAYS] == 1:
                    sent = seen, int(ends[head, FROM]), int(observers[seen])
        elif i < 0:
            return
        elif ints[i, PHASE] == SEE:
            ints[i, PHASE] = DECIDE
            if enter(
                i,
                seed,
                ints,
                rules,
                routes,
                flown,
                strikes,
                visits,
                occupied,
                inside,
                known,
                has,
                news,
                observers,
                strength,
                counts,
            ):
                sent = counts[N_OBSERVATIONS] - 1, -1, -1
        else:
            decide(
                i, now_s, ints, floats, rules, settings, strength, routes, goals, first_goals, occupied,
                inside, walls, offsets, known, work, heap, keys,
            )  # fmt: skip
        if sent[0] >= 0:
            send(
                i,
                sent[0],
                now_s,
                sent[1],
                sent[2],
                ints,
                floats,
                rules,
                settings,
                draws,
                drawn,
                p_lost,
                times,
                ends,
                counts,
                order,
                metres,
            )
