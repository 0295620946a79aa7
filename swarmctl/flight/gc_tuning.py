"""Tuning of Python's garbage collector, which holds up every link while it works."""

from __future__ import annotations

import gc

YOUNG, OLDER, OLDEST = 10_000, 20, 1_000
"""collection thresholds of the three generations: new objects, then collections of the younger generation"""


def tune_collector() -> None:
    """Exclude the objects loaded so far from collections, and make full collections rare.

    Call it before a flight.
    A full collection takes 50 ms for a hundred UAVs after ten seconds, and longer with every observation
    held. Hardly any of these objects is garbage: an agent's dropped objects go with their last reference.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(YOUNG, OLDER, OLDEST)
