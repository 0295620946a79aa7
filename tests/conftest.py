"""The short and the full run of the tests. The helpers in `tests/support` are imported by bare names."""

from __future__ import annotations

import os

import pytest
from firmware_builds import OPTIONS, variable
from hypothesis import settings
from profiles import VARIABLE, examples, is_full


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--full", action="store_true", help="run everything, with deep profiles")
    for what in ("traffic", "formations"):
        text = f"number of flights in tests/flight/test_drawn_{what}.py"
        parser.addoption(f"--drawn-{what}", type=int, default=0, metavar="N", help=text)
    for option in OPTIONS:
        text = f"program of an autopilot, for tests/firmware (or {variable(option)} in the environment)"
        parser.addoption(f"--{option}", metavar="PATH", help=text)


def pytest_configure(config: pytest.Config) -> None:
    if config.getoption("--full"):
        os.environ[VARIABLE] = "full"
    settings.register_profile("swarmctl", max_examples=examples(100), deadline=None, derandomize=True)
    settings.load_profile("swarmctl")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if is_full():
        return
    left_out = {"full"} if _wants_firmware(config) else {"full", "firmware"}
    deselected = [item for item in items if any(item.get_closest_marker(mark) for mark in left_out)]
    if deselected:
        config.hook.pytest_deselected(items=deselected)
        items[:] = [item for item in items if item not in deselected]


def _wants_firmware(config: pytest.Config) -> bool:
    """Return whether the command line has an autopilot or the folder of these tests."""
    return any(map(config.getoption, OPTIONS)) or any("firmware" in word for word in config.args)
