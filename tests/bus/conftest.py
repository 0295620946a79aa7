"""Fixtures for the tests of the bus."""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest

from swarmctl.bus.transports import process_exit, zenoh_config


@pytest.fixture(scope="session", autouse=True)
def _no_thread_is_inside_zenoh_at_the_end() -> Iterator[None]:
    """Wait until no thread opens a Zenoh session, since the interpreter may abort otherwise."""
    yield
    until_s = time.monotonic() + 2.0 * zenoh_config.OPENING_MS / 1e3
    while process_exit.has_live_thread() and time.monotonic() < until_s:
        time.sleep(0.05)
