"""A label-correcting search with a queue of buckets; it completes a field after the sweeps.

Cells wait in buckets by their label. A bucket is `span` wide, and the buckets form a ring. A few edges may
cost more than the whole ring. The cells at the ends of such edges wait in a separate list, `far`, until the
ring reaches their labels.

If no edge is cheaper than `span`, all labels in the current bucket are final (Dial; Denardo and Fox), and
each cell is processed once. With cheaper edges, a cell whose label improves is processed again, generation by
generation (as in Δ-stepping).

A bucket is a stack of blocks from a common pool. So the memory grows with the front of the search, not with
the area. The queue's arrays are local to one long function: calls of smaller functions with these arrays
made the search three times slower.
"""

from __future__ import annotations

import numpy as np

from swarmctl.planners.kernels.lattice import Bytes, Floats, Int32s, Ints, offsets_of

BLOCK_CELLS = 256
N_BUCKETS = 1024
TYPICAL_SPANS = 24
"""number of spans in a typical edge; fewer if the cheapest edge allows a wider span"""
MIN_SAMPLES = 128
"""least number of cells sampled for the cost of the typical edge"""
MAX_KEY = np.int64(2**62)
MAX_ROUTE_CELLS = 2**23
"""Greatest number of cells of a route. The span is so wide that such a route costs at most MAX_KEY spans."""


def correct(
    label: Floats,
    straight: Floats,
    extra: float,
    width: int,
    seeds: Ints,
    least: float,
    greatest: float,
    has_walls: bool,
    waiting: Bytes,
    until: float = np.inf,
) -> Ints:
    """Spread the labels of `seeds` until no label can be improved.

    `least` and `greatest` bound the finite values of `straight`; `waiting` is all zero before and after. Stop
    at the first bucket of labels from `until` on; return the cells whose labels are not spread yet.
    """
    span = _span(straight, least, greatest)
    per_span = 1.0 / span
    n_buckets = min(int((greatest + extra) * per_span) + 3, N_BUCKETS)
    top = np.full(n_buckets, -1, dtype=np.int64)  # a bucket's block to fill; -1: empty
    fill = np.full(n_buckets, BLOCK_CELLS, dtype=np.int64)  # number of cells in that block
    far = seeds.copy()  # cells beyond the ring, in no order
    n_far, far_key = far.size, np.int64(0)
    due = far[:0]  # cells of `far` that the ring has reached, by label
    pool, below, free = _more_blocks(np.empty(0, dtype=np.int32), np.empty(0, dtype=np.int64))
    n_free = free.size
    offsets = offsets_of(width)
    waiting[seeds] = 1
    joined, queued = 0, 0
    key, bucket = np.int64(0), 0
    while queued > 0 or joined < due.size or n_far > 0:
        if queued == 0:
            key = far_key
            if joined < due.size:
                key = min(key, np.int64(label[due[joined]] * per_span))
        if key * span >= until:
            break
        if far_key <= key:
            due = np.concatenate((due[joined:], far[:n_far]))
            due = due[np.argsort(label[due])]
            joined, n_far, far_key = 0, 0, MAX_KEY
        next_due = joined
        while joined < due.size and np.int64(label[due[joined]] * per_span) <= key:
            joined += 1
        while next_due < joined or top[bucket] >= 0:
            block, filled = top[bucket], fill[bucket]
            top[bucket] = -1
            fill[bucket] = BLOCK_CELLS
            while next_due < joined or block >= 0:
                if next_due < joined:
                    n = due[next_due]
                    next_due += 1
                else:
                    filled -= 1
                    queued -= 1
                    n = np.int64(pool[block * BLOCK_CELLS + filled])
                    if filled == 0:
                        free[n_free] = block
                        n_free += 1
                        block = below[block]
                        filled = BLOCK_CELLS
                if waiting[n] == 0:
                    continue  # the cell was already processed with this label
                waiting[n] = 0
                along, across = label[n], label[n] + extra
                for k in range(8):
                    m = n + offsets[k]
                    better = (along if k < 4 else across) + straight[m]
                    if better >= label[m]:
                        continue
                    if has_walls and k >= 4:  # as in `cuts_corner`; m is no wall, because its label improves
                        beside, other = n + offsets[k - 4], n + offsets[(k - 3) & 3]
                        if straight[beside] == np.inf or straight[other] == np.inf:
                            continue
                    label[m] = better
                    waiting[m] = 1
                    q = bucket + int(np.int64(better * per_span) - key)
                    if q - bucket >= n_buckets:
                        if n_far == far.size:
                            far = np.concatenate((far, np.empty(n_far, dtype=np.int64)))
                        far[n_far] = m
                        n_far += 1
                        far_key = min(far_key, np.int64(better * per_span))
                        continue
                    if q >= n_buckets:
                        q -= n_buckets
                    if fill[q] == BLOCK_CELLS:
                        if n_free == 0:
                            pool, below, free = _more_blocks(pool, below)
                            n_free = free.size // 2
                        n_free -= 1
                        below[free[n_free]] = top[q]
                        top[q] = free[n_free]
                        fill[q] = 0
                    pool[top[q] * BLOCK_CELLS + fill[q]] = m
                    fill[q] += 1
                    queued += 1
        key += 1
        bucket = bucket + 1 if bucket + 1 < n_buckets else 0
    remaining = np.empty(queued + due.size - joined + n_far, dtype=np.int64)
    size = n_far + due.size - joined
    remaining[:size] = np.concatenate((due[joined:], far[:n_far]))
    for q in range(n_buckets):
        block, filled = top[q], fill[q]
        while block >= 0:
            remaining[size : size + filled] = pool[block * BLOCK_CELLS : block * BLOCK_CELLS + filled]
            size += filled
            block, filled = below[block], BLOCK_CELLS
    kept = 0
    for i in range(size):
        if waiting[remaining[i]] != 0:
            waiting[remaining[i]] = 0
            remaining[kept] = remaining[i]
            kept += 1
    return remaining[:kept]


def _span(straight: Floats, least: float, greatest: float) -> float:
    """Return the width of a bucket: the greater of the cheapest edge and a part of a typical edge.

    The typical edge is a median, so a few very dear cells do not matter.
    """
    samples = straight[:: max(straight.size // MIN_SAMPLES, 1)]
    finite = samples[samples < np.inf]
    typical = np.median(finite) if finite.size > 0 else 0.0
    if typical == 0.0:
        typical = greatest
    span = max(least * (1.0 - 1e-9), typical / TYPICAL_SPANS, greatest / MAX_KEY * MAX_ROUTE_CELLS, 1e-280)
    return span if span < np.inf else 1.0


def _more_blocks(pool: Int32s, below: Ints) -> tuple[Int32s, Ints, Ints]:
    """Return the pool with room for more blocks, the block below each block, and a stack of new blocks."""
    n = below.size
    n_new = max(n, 64)
    free = np.zeros(n + n_new, dtype=np.int64)
    free[:n_new] = np.arange(n, n + n_new)
    return (
        np.concatenate((pool, np.empty(n_new * BLOCK_CELLS, dtype=np.int32))),
        np.concatenate((below, np.full(n_new, -1, dtype=np.int64))),
        free,
    )
