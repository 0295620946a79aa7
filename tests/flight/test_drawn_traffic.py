"""A campaign of drawn traffic with light vehicles: no breach of the limits, no deadlock, no wait without end.

`--drawn-traffic 1000` flies that many seeds; docs/limits.md has what was flown.
"""

from __future__ import annotations

import pytest
from drawn_traffic import draw

N_DEFAULT, N_FULL = 12, 50

FOUND = (
    29, 58, 64, 73, 103, 112, 118, 139, 171, 191, 195, 218, 287, 312, 314, 337, 377, 490, 500, 538, 546,
    617, 641, 657, 788, 892, 963, 975,
)  # fmt: skip
"""seeds that broke a rule before"""

FOUND_IN_FULL_RUNS = (
    10, 142, 150, 166, 310, 368, 381, 432, 566, 609, 644, 646, 679, 740, 852, 893, 916, 961,
)  # fmt: skip
"""seeds of larger swarms that broke a rule before; each flight takes up to 13 s"""


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "seed" in metafunc.fixturenames:
        is_full, n = metafunc.config.getoption("--full"), metafunc.config.getoption("--drawn-traffic")
        seeds = {*range(n or (N_FULL if is_full else N_DEFAULT)), *FOUND}
        metafunc.parametrize("seed", sorted(seeds | {*(FOUND_IN_FULL_RUNS if is_full else ())}))


def test_drawn_traffic_keeps_its_limits_and_ends_every_wait(seed: int) -> None:
    drawn = draw(seed).flown()
    assert drawn.findings == [], drawn.story
