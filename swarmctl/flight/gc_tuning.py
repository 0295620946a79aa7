"""Tuning of Python's garbage collector, which holds up every link while it works."""

from __future__ import annotations

import gc

GENERATION_THRESHOLDS = (10_000, 20, 1_000)
"""collection thresholds: number of new objects, then numbers of collections of the next younger generation"""


def tune_collector() -> None:
    """Exclude the objects loaded so far from collections, and make full collections rare.

    Call this before a flight. A full collection takes 50 ms for a hundred UAVs after ten seconds, and longer
    with each stored observation. A collection frees little, because reference counts free most objects.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(*GENERATION_THRESHOLDS)
