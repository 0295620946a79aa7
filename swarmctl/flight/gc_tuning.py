"""Python's collector of garbage, which holds up every link while it works."""

from __future__ import annotations

import gc

YOUNG, OLDER, OLDEST = 10_000, 20, 1_000
"""How many new objects, and how many collections of the generation before, make one of each generation."""


def settle() -> None:
    """Before a flight: what is loaded stays and is passed over, and full collections become rare.

    They take time by what is held, which grows with all that a swarm has seen (50 ms for a hundred UAVs after
    ten seconds). Hardly anything of it is garbage: what an agent drops goes at once, by its last reference.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(YOUNG, OLDER, OLDEST)
