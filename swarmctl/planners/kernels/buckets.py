"""A search with a queue of buckets, which spreads labels from some cells to all others.

A bucket is `span` wide, a part of a typical edge. The cells of the least bucket are processed first, in any
order. A cell whose label improves waits again, so the labels end exact although edges may be shorter than a
bucket (as in Δ-stepping).

The bucket of a label is a whole number, its key. The queue has levels of SLOTS slots, one for each value of
BITS bits of the key. A cell waits at the highest level at which its key differs from the current key. When
the search reaches a slot of a higher level, the cells of the slot move to lower levels (a radix heap). A
typical edge is shorter than SLOTS buckets, so few cells move.

A run of waiting cells is processed in two steps: all labels of their neighbours improve first, then the
improved cells go to their slots. The first step has no branch that depends on labels. A processor cannot
predict such branches; with them a search takes up to twice as long.

Not all eight neighbours need a look. Let the label of a cell come from the cell to its west. That cell has
offered labels to its own neighbours. A way over this cell is no cheaper for the cells to the north-west, west
and south-west. Five neighbours remain. After a diagonal step five remain too.
"""

from __future__ import annotations

import numpy as np

from swarmctl.planners.kernels.compilation import compiled, prefetch
from swarmctl.planners.kernels.lattice import Floats, Ints, cuts_corner, offsets_of

TYPICAL_SPANS = 4
"""number of buckets in a typical edge"""
SAMPLES = 128
"""number of cells sampled for the cost of the typical edge"""
BITS = 7
SLOTS = 1 << BITS
LEVELS = 9
MAX_KEY = 2.0**62
MAX_ROUTE_CELLS = 2.0**23
"""Greatest number of cells of a route. The span is so wide that such a route costs at most MAX_KEY spans."""
BLOCK = 64
"""The cells of a slot wait in blocks of this size. The first number of a block is the index of the next."""
MOST_PUSHED = 5 * BLOCK
"""greatest number of cells that improve in one run, and of blocks that the run can fill"""
CELLS_AHEAD = 8
"""distance of the cells that are fetched into the processor's cache, before the search reaches them"""
FREE_BLOCKS = 4096
"""number of free blocks at the start of a search; few searches need more"""
NOW, SLOT, N_FREE, N_FOUND = 0, 1, 2, 3
"""indices in a queue's state: current key and slot, numbers of free blocks and of improved cells"""
U = np.uintp
"""type of an index without a sign; numba then omits its check for negative indices, a fifth of the time"""

_TURNS = [(k, (k + 1) % 4, (k + 3) % 4) for k in range(4)]  # ahead, to the left, to the right
DIRECTIONS = np.array(
    [[k, left, right, k + 4, right + 4] for k, left, right in _TURNS]
    + [[k, left, k + 4, left + 4, right + 4] for k, left, right in _TURNS]
).reshape(-1)
"""five directions to go on after a step in each direction, numbered as in `offsets_of`"""


def settle(
    label: Floats,
    straight: Floats,
    extra: float,
    width: int,
    seeds: Ints,
    span: float,
    has_walls: bool,
    until: float = np.inf,
) -> Ints:
    """Spread the labels of `seeds` until no label can be improved.

    Stop at the first bucket of labels from `until` on; return the cells whose labels are not spread yet.
    """
    seeds = seeds[label[seeds] < np.inf]
    # A waiting cell is a number: 8 · cell + direction of its last step. After steps to the north-east and to
    # the south-west all eight directions are looked at, as a seed needs.
    found = np.append(8 * seeds + 4, 8 * seeds + 6)
    state = np.array([0, 0, FREE_BLOCKS + found.size // (BLOCK - 1), found.size])
    found = np.append(found, np.empty(MOST_PUSHED + 1, dtype=np.int64))
    # Each slot has a block of its own from the beginning; the others are free.
    n_lists = SLOTS * LEVELS
    free = np.arange(n_lists, n_lists + state[N_FREE])
    pool = np.empty((n_lists + free.size) * BLOCK, dtype=np.int64)
    read = np.arange(n_lists) * BLOCK + 1
    write = read.copy()
    edges = label, straight, extra, width, span, until, has_walls, DIRECTIONS
    while not compiled(spread)(*edges, read, write, pool, free, found, state):
        n_blocks, n_free = pool.size // BLOCK, state[N_FREE]
        pool = np.append(pool, np.empty_like(pool))
        free = np.concatenate((free[:n_free], np.arange(n_blocks, 2 * n_blocks), free[n_free:]))
        state[N_FREE] += n_blocks
    return _waiting(pool, read, write) if until < np.inf else seeds[:0]


def _waiting(pool: Ints, read: Ints, write: Ints) -> Ints:
    """Return the cells in all slots."""
    parts = [pool[:0]]
    for slot in np.flatnonzero(read != write):
        at, end = read[slot], write[slot]
        while at // BLOCK != end // BLOCK:
            block = at // BLOCK * BLOCK
            parts.append(pool[at : block + BLOCK])
            at = pool[block] * BLOCK + 1
        parts.append(pool[at:end])
    cells: Ints = np.unique(np.concatenate(parts) >> 3)
    return cells


def span_of(straight: Floats, greatest: float) -> float:
    """Return the width of a bucket: a part of a typical edge. `greatest` is the greatest finite edge.

    The typical edge is a median, so a few very dear cells do not matter.
    """
    samples = straight[:: max(straight.size // SAMPLES, 1)]
    finite = np.sort(samples[samples < np.inf])
    typical = float(finite[finite.size // 2]) if finite.size > 0 else 0.0
    if typical == 0.0:
        typical = greatest
    span = max(typical / TYPICAL_SPANS, greatest / MAX_KEY * MAX_ROUTE_CELLS, 1e-280)
    return span if span < np.inf else 1.0


def spread(
    label: Floats,
    straight: Floats,
    extra: float,
    width: int,
    span: float,
    until: float,
    has_walls: bool,
    directions: Ints,
    read: Ints,
    write: Ints,
    pool: Ints,
    free: Ints,
    found: Ints,
    state: Ints,
) -> bool:
    """Spread the labels of the waiting cells; return False if the queue needs more blocks.

    A slot's cells wait in `pool`, from the index in `read` to that in `write`.
    """
    offsets = offsets_of(width)
    steps, added = np.empty(40, dtype=np.int64), np.zeros(40)
    for i in range(40):
        steps[i] = 8 * offsets[directions[i]] + directions[i]
        if directions[i] >= 4:
            added[i] = extra
    per_span = 1.0 / span
    now, slot, n_free, size = state[NOW], state[SLOT], state[N_FREE], state[N_FOUND]
    level = slot // SLOTS
    while True:
        for i in range(size):
            item = found[U(i)]
            later = _slot_of(int(label[U(item >> 3)] * per_span), now)
            at = write[U(later)]
            pool[U(at)] = item
            at += 1
            if at & (BLOCK - 1) == 0:
                n_free -= 1
                pool[U(at - BLOCK)] = free[U(n_free)]
                at = free[U(n_free)] * BLOCK + 1
            write[U(later)] = at
        size = 0
        if read[U(slot)] == write[U(slot)]:
            slot = _least_slot(read, write, now)
            if slot < 0:
                return True
            level = slot // SLOTS
            now = (((now >> ((level + 1) * BITS)) << BITS) + slot % SLOTS) << (level * BITS)
            if now * span >= until:
                return True
        if n_free < MOST_PUSHED:
            state[NOW], state[SLOT], state[N_FREE], state[N_FOUND] = now, slot, n_free, 0
            return False
        at, end = read[U(slot)], write[U(slot)]  # the cells of the first block are removed
        block = at // BLOCK
        if end // BLOCK == block:
            read[U(slot)] = write[U(slot)] = block * BLOCK + 1
        else:
            end = (block + 1) * BLOCK
            read[U(slot)] = pool[U(block * BLOCK)] * BLOCK + 1
            free[U(n_free)] = block
            n_free += 1
        for index in range(at, end):
            item = pool[U(index)]
            n, last = item >> 3, item & 7
            along = label[U(n)]
            if level > 0:
                found[U(size)] = item
                size += int(along * per_span) >= now  # otherwise already processed with this label
                continue
            ahead = n + CELLS_AHEAD * offsets[U(last)]
            prefetch(label, ahead)
            prefetch(straight, ahead)
            for i in range(5 * last, 5 * last + 5):
                other = item - last + steps[U(i)]
                m, k = other >> 3, other & 7
                better = along + added[U(i)] + straight[U(m)]
                if has_walls and k >= 4 and cuts_corner(straight, offsets, n, k):
                    continue
                before = label[U(m)]
                label[U(m)] = min(better, before)
                found[U(size)] = other
                size += better < before


def _least_slot(read: Ints, write: Ints, now: int) -> int:
    """Return the least slot in which cells wait, from the key `now` on; -1 if no cell waits."""
    for level in range(LEVELS):
        for slot in range(level * SLOTS + ((now >> (level * BITS)) & (SLOTS - 1)), (level + 1) * SLOTS):
            if read[U(slot)] != write[U(slot)]:
                return slot
    return -1


def _slot_of(key: int, now: int) -> int:
    """Return the slot of a key, which is at least `now`."""
    lift, difference = 0, key ^ now
    while difference >= SLOTS:
        difference >>= BITS
        key >>= BITS
        lift += SLOTS
    return lift + (key & (SLOTS - 1))
