"""Autopilots for the tests of this folder, by options or environment variables."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import namespaces
import pytest
from firmware import FLOWN, Airfield, airfield, swarm
from firmware_builds import Builds, builds_of, variable
from udp_relay import Radio


@pytest.fixture(scope="session")
def builds(request: pytest.FixtureRequest) -> Builds:
    return builds_of(request.config)


@pytest.fixture(autouse=True)
def _require(request: pytest.FixtureRequest, builds: Builds) -> None:
    """Skip a test without the autopilots of its mark."""
    mark = request.node.get_closest_marker("firmware")
    assert mark is not None
    if missing := builds.missing(*mark.args):
        options = ", ".join(f"--{one} or {variable(one)}" for one in missing)
        pytest.skip(f"no autopilot: give the path of a program by {options}")
    for one in mark.args:
        assert builds.programs[one].is_file(), f"--{one}: {builds.programs[one]} is no file"
    if reason := namespaces.reason_unavailable():
        pytest.skip(reason)


@pytest.fixture
def field_of(
    builds: Builds, tmp_path: Path, record_property: Callable[[str, object], None]
) -> Callable[..., AbstractContextManager[Airfield]]:
    """Return a function that starts autopilots of some kinds at the starts of a shipped configuration."""

    def start(kinds: Sequence[str], radio: Radio | None = None, **changes: Any) -> Any:
        return airfield(builds, tmp_path, kinds, swarm(kinds, **changes), radio or Radio(), record_property)

    return start


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Print what each vehicle did."""
    reports = (one for kind in ("passed", "failed", "xfailed") for one in terminalreporter.getreports(kind))
    for report in reports:
        lines = [str(text) for name, text in report.user_properties if name == FLOWN]
        if lines and report.when == "call":
            terminalreporter.write_line(f"{report.nodeid} ({report.duration:.0f} s)")
            for line in lines:
                terminalreporter.write_line(f"  {line}")
