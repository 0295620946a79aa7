"""The abstract mission as machine code: `mission` for the paper's planner, sensor and number of hostiles.

`compiled_mission` prepares the arrays; the kernels are plain functions of them, one for each part.
"""

from __future__ import annotations

import numpy as np

from swarmctl.planners.kernels.descent import is_goal
from swarmctl.planners.kernels.lattice import ROOT2
from swarmctl.study.kernel_layout import (
    ARRIVED_S,
    ARRIVES_S,
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
    N_FLOWN,
    N_OBSERVATIONS,
    OBSERVATION,
    OVERFLOW,
    PHASE,
    RECEIVED,
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
    Area,
    Messages,
    Observations,
    Search,
    Settings,
    Vehicles,
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


def n_strikes(seed: np.uint64, uav: int, m: int, visit: int, area: Area) -> int:
    """Return the number of hostiles that hit a vehicle at an entry (Eq. 1)."""
    hits, width = 0, area.width
    cols = width - 2
    cell = (m // width - 1) * cols + m % width - 1
    for row_step in range(-1, 2):
        for col_step in range(-1, 2):
            n = m + row_step * width + col_step
            if area.occupied[n]:
                p_hit = area.strength[abs(row_step) + abs(col_step)]
                hits += draw_strike(seed, uav, cell + row_step * cols + col_step, cell, visit) < p_hit
    return hits


def learn(i: int, seen: int, area: Area, vehicles: Vehicles, observations: Observations) -> bool:
    """Merge an observation; return whether it is new to the vehicle."""
    ints, cells = vehicles.ints, observations.cells
    if observations.has[i, seen]:
        return False
    observations.has[i, seen] = 1
    ints[i, HAS_NEWS] = 1
    for slot in range(1, 1 + cells[seen, 0]):
        m = cells[seen, slot]
        if not vehicles.known[i, m]:
            vehicles.known[i, m] = 1
            ints[i, KNOWN] += 1
            ints[i, FOUND] += area.occupied[m]
    return True


def look(i: int, m: int, seen: int, area: Area, vehicles: Vehicles, observations: Observations) -> int:
    """Write the unknown cells in sight as an observation; return their number."""
    n = 0
    for row_step in range(-1, 2):
        for col_step in range(-1, 2):
            cell = m + row_step * area.width + col_step
            if area.inside[cell] and not vehicles.known[i, cell]:
                n += 1
                observations.cells[seen, n] = cell
    observations.cells[seen, 0] = n
    return n


def enter(
    i: int, seed: np.uint64, area: Area, vehicles: Vehicles, observations: Observations, seen: int
) -> bool:
    """Let the hostiles fire, and see the 3 × 3 cells; return whether anything is new, observation `seen`."""
    ints = vehicles.ints
    m, slot = int(vehicles.routes[i, ints[i, INDEX]]), ints[i, N_FLOWN]
    ints[i, N_FLOWN] += 1
    vehicles.visits[i, m] += 1
    vehicles.flown[i, slot] = m
    vehicles.strikes[i, slot] = n_strikes(seed, ints[i, UAV], m, int(vehicles.visits[i, m]), area)
    if look(i, m, seen, area, vehicles, observations) == 0:
        return False
    observations.observers[seen] = i
    for j in range(observations.has.shape[0]):
        observations.has[j, seen] = 0
    learn(i, seen, area, vehicles, observations)
    return True


def go_on(i: int, now_s: float, settings: Settings, area: Area, vehicles: Vehicles) -> None:
    """Fly to the next cell of the route."""
    ints, floats, width, cell_m = vehicles.ints, vehicles.floats, area.width, settings.cell_m
    here, there = int(vehicles.routes[i, ints[i, INDEX]]), int(vehicles.routes[i, ints[i, INDEX] + 1])
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


def decide(i: int, now_s: float, settings: Settings, area: Area, vehicles: Vehicles, search: Search) -> None:
    """Arrive, or choose the next cell and fly there."""
    ints, goals = vehicles.ints, vehicles.goals[vehicles.first_goals[i] : vehicles.first_goals[i + 1]]
    if is_goal(goals, int(vehicles.routes[i, ints[i, INDEX]])):
        vehicles.floats[i, ARRIVED_S] = now_s
        ints[i, PHASE] = ENDED
        return
    if ints[i, N_FLOWN] >= settings.max_entries:
        ints[i, PHASE] = ENDED
        return
    if ints[i, HAS_NEWS] == 1:
        ints[i, HAS_NEWS] = 0
        replan(i, goals, settings, area, vehicles, search)
    go_on(i, now_s, settings, area, vehicles)


def next_vehicle(vehicles: Vehicles) -> tuple[int, float]:
    """Return the vehicle that acts next and its time; −1 if none does."""
    ints, floats, best, best_s = vehicles.ints, vehicles.floats, -1, np.inf
    for i in range(ints.shape[0]):
        if ints[i, PHASE] == ENDED:
            continue
        at_s = floats[i, EDGE_S] if ints[i, PHASE] == SEE else floats[i, CENTRE_S]
        if best < 0 or at_s < best_s or (at_s == best_s and ints[i, PHASE] < ints[best, PHASE]):
            best, best_s = i, at_s
    return best, best_s


def mission(
    seed: np.uint64,
    settings: Settings,
    area: Area,
    vehicles: Vehicles,
    observations: Observations,
    messages: Messages,
    search: Search,
) -> None:
    """Fly one mission, event by event."""
    ints, times, ends, counts = vehicles.ints, messages.times, messages.ends, messages.counts
    while counts[OVERFLOW] == 0:
        i, now_s = next_vehicle(vehicles)
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
            if is_in_range(i, now_s, times[head, SENT_X], times[head, SENT_Y], settings, vehicles.floats):
                ints[i, RECEIVED] += 1
                if learn(i, seen, area, vehicles, observations) and settings.relays:
                    sent = seen, int(ends[head, FROM]), int(observations.observers[seen])
        elif i < 0:
            return
        elif ints[i, PHASE] == SEE:
            ints[i, PHASE] = DECIDE
            seen = int(counts[N_OBSERVATIONS])
            if enter(i, seed, area, vehicles, observations, seen):
                counts[N_OBSERVATIONS] += 1
                sent = seen, -1, -1
        else:
            decide(i, now_s, settings, area, vehicles, search)
        if sent[0] >= 0:
            send(i, sent[0], now_s, sent[1], sent[2], settings, vehicles, messages)
