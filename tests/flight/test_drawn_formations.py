"""A campaign of drawn flights of groups in formation, with faults, judged by an independent witness.

`--drawn-formations 1000` flies that many seeds; docs/formation.md has what was flown.
"""

from __future__ import annotations

import pytest
from drawn_formations import draw

N_DEFAULT, N_FULL = 4, 5

FOUND = (
    6, 18, 26, 27, 29, 54, 64, 76, 79, 94, 134, 148, 158, 161, 181, 196, 212, 230, 254, 257, 265, 290,
    323, 331, 397, 404, 425, 457, 514, 569, 585, 647, 657, 768, 785, 827, 866, 967, 983, 987, 993,
)  # fmt: skip
"""seeds that broke a rule before; in the full run"""


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "seed" in metafunc.fixturenames:
        n = metafunc.config.getoption("--drawn-formations")
        is_full = metafunc.config.getoption("--full")
        n = n or (N_FULL if is_full else N_DEFAULT)
        metafunc.parametrize("seed", sorted({*range(n), *(FOUND if is_full else ())}))


def test_drawn_formations_keep_their_limits_and_end(seed: int) -> None:
    drawn = draw(seed).flown()
    assert drawn.findings == [], drawn.story
