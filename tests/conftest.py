"""The short and the full run of the tests. The helpers in `tests/support` are imported by bare names."""

from __future__ import annotations

import os

import pytest
from hypothesis import settings
from profiles import VARIABLE, examples, is_full


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--full", action="store_true", help="run everything, with deep profiles")


def pytest_configure(config: pytest.Config) -> None:
    if config.getoption("--full"):
        os.environ[VARIABLE] = "full"
    settings.register_profile("swarmctl", max_examples=examples(100), deadline=None, derandomize=True)
    settings.load_profile("swarmctl")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if is_full():
        return
    deselected = [item for item in items if item.get_closest_marker("full")]
    if deselected:
        config.hook.pytest_deselected(items=deselected)
        items[:] = [item for item in items if not item.get_closest_marker("full")]
