"""A search with a queue of buckets, which spreads labels from some cells to all others.

A bucket is `span` wide, a part of a typical edge. The cells of the least bucket are processed first, in any
order. A cell whose label improves waits again, so the labels end exact although edges may be shorter than a
bucket (as in Δ-stepping).

The bucket of a label is a whole number, its key. The queue has levels of SLOTS slots, one for each value of
BITS bits of the key. A cell waits at the highest level at which its key differs from the current key. When
the search reaches a slot of a higher level, the cells of the slot move to lower levels (a radix heap). A
typical edge is shorter than SLOTS buckets, so few cells move.

Not all eight neighbours need a look. Let the label of a cell come from the cell to its west. That cell has
offered labels to its own neighbours. A way over this cell is no cheaper for the cells to the north-west, west
and south-west, and none for the cells to the north and south, because a straight step costs at least `extra`.
Three neighbours remain. After a diagonal step five remain. Walls may close the diagonal steps of the cell to
the west, so in an area with walls north and south remain too.
"""

from __future__ import annotations

import numpy as np

from swarmctl.planners.kernels.compilation import compiled, prefetch
from swarmctl.planners.kernels.lattice import Floats, Ints, offsets_of

TYPICAL_SPANS = 16
"""number of buckets in a typical edge"""
MIN_SAMPLES = 128
"""least number of cells sampled for the cost of the typical edge"""
BITS = 9
SLOTS = 1 << BITS
LEVELS = 7
MAX_KEY = 2.0**62
MAX_ROUTE_CELLS = 2.0**23
"""Greatest number of cells of a route. The span is so wide that such a route costs at most MAX_KEY spans."""
FIRST_ENTRIES = 8192
"""number of waiting cells for which a search allocates memory at its start"""
CELLS_AHEAD = 8
"""distance of the cells that are fetched into the processor's cache, before the search reaches them"""
SEED = 8
"""in place of the direction of the last step, for a cell without a last step"""
NOW, FREE, N_FREE = 0, 1, 2
"""indices in a queue's state: the current key, the first free entry, the number of free entries"""
U = np.uintp
"""type of an index without a sign; numba then omits its check for negative indices, a fifth of the time"""


def _directions_after(has_walls: bool) -> tuple[Ints, Ints]:
    """Return the directions to go on after each step, one after the other, and the index of each first one.

    Directions are numbered as in `offsets_of`.
    """
    turns = [(k, (k + 1) % 4, (k + 3) % 4) for k in range(4)]  # ahead, to the left, to the right
    straight = [[k, k + 4, right + 4, *((left, right) if has_walls else ())] for k, left, right in turns]
    diagonal = [[k, left, k + 4, left + 4, right + 4] for k, left, right in turns]
    after = [*straight, *diagonal, list(range(8))]
    return np.concatenate(after), np.cumsum([0, *map(len, after)])


DIRECTIONS_AFTER = {has_walls: _directions_after(has_walls) for has_walls in (False, True)}


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
    # A waiting cell takes an entry of the queue: `items` has the cell and the direction of the last step,
    # `below` the next entry of the same slot, `top` the first entry of each slot. -1 stands for none.
    items = np.full(max(2 * seeds.size, FIRST_ENTRIES), -1)
    items[: seeds.size] = 16 * seeds + SEED
    below = np.append(np.arange(1, items.size), -1)
    top, state = np.full(SLOTS * LEVELS, -1), np.array([0, seeds.size, items.size - seeds.size])
    if seeds.size > 0:  # at the highest level, from where they move to their slots
        top[SLOTS * (LEVELS - 1)] = 0
        below[seeds.size - 1] = -1
    while not compiled(spread)(
        label, straight, extra, width, span, until, has_walls, *DIRECTIONS_AFTER[has_walls],
        items, below, top, state,
    ):  # fmt: skip
        n_more = items.size
        below = np.concatenate((below, np.arange(n_more + 1, 2 * n_more), state[FREE : FREE + 1]))
        items = np.append(items, np.full(n_more, -1))
        state[FREE], state[N_FREE] = n_more, state[N_FREE] + n_more
    cells = np.unique(items[items >= 0] >> 4)
    remaining: Ints = cells[label[cells] * (1.0 / span) >= state[NOW]]
    return remaining


def span_of(straight: Floats, greatest: float) -> float:
    """Return the width of a bucket: a part of a typical edge. `greatest` is the greatest finite edge.

    The typical edge is a median, so a few very dear cells do not matter.
    """
    samples = straight[:: max(straight.size // MIN_SAMPLES, 1)]
    finite = samples[samples < np.inf]
    typical = float(np.median(finite)) if finite.size > 0 else 0.0
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
    begin: Ints,
    items: Ints,
    below: Ints,
    top: Ints,
    state: Ints,
) -> bool:
    """Spread the labels of the waiting cells; return False if the queue needs more entries.

    The queue does not grow here: arrays that are replaced in this long function make it five times slower.
    """
    offsets = offsets_of(width)
    moves, added = np.empty(directions.size, dtype=np.int64), np.zeros(directions.size)
    for i in range(directions.size):
        moves[i] = offsets[directions[i]]
        if directions[i] >= 4:
            added[i] = extra
    per_span = 1.0 / span
    now, free, n_free = state[NOW], state[FREE], state[N_FREE]
    while True:
        slot = _least_slot(top, now)
        if slot < 0:
            break
        level = slot // SLOTS
        now = (((now >> ((level + 1) * BITS)) << BITS) + slot % SLOTS) << (level * BITS)
        if now * span >= until:
            break
        entry = top[U(slot)]
        top[U(slot)] = -1
        while entry >= 0:
            item, following = items[U(entry)], below[U(entry)]
            n, last = item >> 4, item & 15
            along = label[U(n)]
            key = int(along * per_span)
            if level > 0 and key >= now:
                lower = _slot_of(key, now)
                below[U(entry)] = top[U(lower)]
                top[U(lower)] = entry
                entry = following
                continue
            if n_free < 8 and level == 0:
                _put_back(below, top, slot, entry)
                state[NOW], state[FREE], state[N_FREE] = now, free, n_free
                return False
            items[U(entry)] = -1
            below[U(entry)] = free
            free = entry
            n_free += 1
            entry = following
            if key < now:
                continue  # the cell was already processed with this label
            ahead = n + CELLS_AHEAD * offsets[U(last & 7)]
            prefetch(label, ahead)
            prefetch(straight, ahead)
            for i in range(begin[U(last)], begin[U(last + 1)]):
                m = n + moves[U(i)]
                better = along + added[U(i)] + straight[U(m)]
                if better >= label[U(m)]:
                    continue
                k = directions[U(i)]
                if has_walls and k >= 4:  # as in `cuts_corner`; m is no wall, because its label improves
                    beside, other = n + offsets[k - 4], n + offsets[(k - 3) & 3]
                    if straight[beside] == np.inf or straight[other] == np.inf:
                        continue
                label[U(m)] = better
                later = _slot_of(int(better * per_span), now)
                taken = free
                free = below[U(taken)]
                n_free -= 1
                items[U(taken)] = 16 * m + k
                below[U(taken)] = top[U(later)]
                top[U(later)] = taken
    state[NOW] = now
    return True


def _least_slot(top: Ints, now: int) -> int:
    """Return the least slot in which cells wait, from the key `now` on; -1 if no cell waits."""
    for level in range(LEVELS):
        for slot in range(level * SLOTS + ((now >> (level * BITS)) & (SLOTS - 1)), (level + 1) * SLOTS):
            if top[U(slot)] >= 0:
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


def _put_back(below: Ints, top: Ints, slot: int, entry: int) -> None:
    """Put the rest of a slot's entries, from `entry` on, back in front of its new entries."""
    end = entry
    while below[end] >= 0:
        end = below[end]
    below[end] = top[slot]
    top[slot] = entry
