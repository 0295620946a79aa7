"""The two runs of the tests: `pytest` is the short run, `pytest --full` the full run."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any

import pytest

VARIABLE = "SWARMCTL_TESTS"
"""Environment variable that carries the choice to the workers of xdist: `full`, or not set."""
SHORT_SHARE = 5
"""Share of a full run's examples that a short run draws: one in this number"""
SHORT_LEAST = 10
"""Least number of examples in a short run"""


def is_full() -> bool:
    return os.environ.get(VARIABLE) == "full"


def examples(n_full: int, least: int = SHORT_LEAST) -> int:
    """Return the number of examples that hypothesis draws, of `n_full` in a full run.

    A test with a whole conversation or flight an example gives a smaller `least` for the short run.
    """
    return n_full if is_full() else min(n_full, max(least, n_full // SHORT_SHARE))


def full_only(*values: Any) -> Iterable[Any]:
    """Return values of a parameter that only the full run takes; a tuple is one row of several parameters."""
    rows = [value if isinstance(value, tuple) else (value,) for value in values]
    return [pytest.param(*row, marks=pytest.mark.full) for row in rows]
