"""A campaign of drawn traffic with light vehicles: no breach of the limits, no deadlock, no wait without end.

`--drawn-traffic 1000` flies that many seeds; docs/limits.md has the seeds that break a rule today.
"""

from __future__ import annotations

import pytest
from drawn_traffic import draw

N_DEFAULT, N_FULL = 12, 100

FOUND = {
    29: "a vehicle that held below a landing one waited for it, and the other way round",
    64: "a new any-angle route from a lattice route ended the program with an IndexError",
    73: "a vehicle climbed over its goal through the height of a landing one",
    103: "two vehicles changed their heights over one goal",
    112: "a vehicle held in its climb, in the way of the next one",
    546: "two landing vehicles met over the goal's centre, and neither was allowed to hold any more",
    118: "a vehicle gave way to a landing one with a climb that ended over the goal",
    218: "a vehicle with a higher speed followed another one to the goal, and neither had an alarm",
    312: "an ordered landing came down beside a landing vehicle",
    139: "a vehicle passed a silent one that landed beside the goal's centre",
    287: "a vehicle that braked was expected to fly straight on, and another one flew into its hold",
    617: "a return that waited below a landing vehicle climbed through it at its deadline",
    657: "a vehicle landed through the height of one that was mute for 30 s",
    641: "a vehicle with priority came from behind upon a vehicle that gave way but could not",
}
"""seeds that broke a rule before, with the cause"""


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "seed" in metafunc.fixturenames:
        n = metafunc.config.getoption("--drawn-traffic")
        n = n or (N_FULL if metafunc.config.getoption("--full") else N_DEFAULT)
        metafunc.parametrize("seed", sorted({*range(n), *FOUND}))


def test_drawn_traffic_keeps_its_limits_and_ends_every_wait(seed: int) -> None:
    drawn = draw(seed).flown()
    assert drawn.findings == [], drawn.story
