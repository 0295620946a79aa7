"""A real browser, and dashboards as processes."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from swarmctl_process import StartDashboard, started

CHROMIUM = shutil.which("chromium")
LONGEST_WAIT_S = 90.0
"""of a browser for what it is to show: a loaded machine takes long"""


@pytest.fixture
def browser() -> Iterator[Any]:
    """Return a context of a headless Chromium, from which pages are opened."""
    playwright = pytest.importorskip("playwright.sync_api", reason="the browser tests need playwright")
    if CHROMIUM is None:
        pytest.skip("no chromium is installed")
    with playwright.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        context = chromium.new_context(viewport={"width": 1280, "height": 800}, ignore_https_errors=True)
        context.set_default_timeout(LONGEST_WAIT_S * 1e3)
        yield context
        chromium.close()


@pytest.fixture
def start_dashboard() -> Iterator[StartDashboard]:
    """Return a function that starts a command of the program, and returns the process."""
    with ExitStack() as processes:

        def start(*words: str | Path, cwd: Path | None = None) -> subprocess.Popen[str]:
            # Without a desktop the program opens no browser itself.
            no_desktop = dict(os.environ, DISPLAY="", WAYLAND_DISPLAY="")
            return processes.enter_context(started(*words, cwd=cwd, env=no_desktop))

        yield start
