"""`swarmctl dashboard --config`: a swarm of processes, watched in a real browser."""

from __future__ import annotations

import re
import shutil
import socket
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from swarmctl_process import SWARMCTL, read_until
from swarmctl_process import run as run_swarmctl

playwright = pytest.importorskip("playwright.sync_api", reason="the browser tests need playwright")
CHROMIUM = shutil.which("chromium")
pytestmark = [
    pytest.mark.interop,
    pytest.mark.full,
    pytest.mark.skipif(CHROMIUM is None, reason="no chromium is installed"),
]
SWARM = """\
name: apart
area: {origin_lat_deg: 46.0, origin_lon_deg: 14.4, rows: 8, cols: 8, cell_size_m: 50}
threats: {count: 5}
communication: {router: "tcp/127.0.0.1:PORT"}
simulate: {count: 2, speedup: 10, ready_s: 0}
flight: {on_exit: hold, altitude_m: 15}
"""
NAMES = ("uav1", "uav2")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    (tmp_path / "apart.yaml").write_text(SWARM.replace("PORT", str(port)))
    return tmp_path


@pytest.fixture
def dashboard(folder: Path) -> Iterator[subprocess.Popen[str]]:
    """Start a router, an agent for each vehicle, and the dashboard."""
    with ExitStack() as processes:

        def start(*words: str) -> subprocess.Popen[str]:
            process = subprocess.Popen(
                [*SWARMCTL, *words, "--config", "apart.yaml"],
                cwd=folder,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
            )
            processes.enter_context(process)
            processes.callback(process.kill)
            return process

        read_until(start("router"), "listening at")
        for name in NAMES:
            read_until(start("agent", "--uav", name), "[ready]")
        yield start("dashboard")


def test_a_swarm_of_agents_is_watched(folder: Path, dashboard: subprocess.Popen[str]) -> None:
    (address,) = re.findall(r"http://\S+", read_until(dashboard, "token=")[-1])
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.goto(address)
        cards = [page.locator(".card-vehicle", has_text=name) for name in NAMES]
        for card in cards:
            card.filter(has_text="standby").wait_for()
        ordered = run_swarmctl("order", "launch", "--all", "--config", "apart.yaml", cwd=folder)
        assert ordered.returncode == 0
        for card in cards:
            card.filter(has_text="flying").filter(has_text=re.compile("knows [1-9]")).wait_for()
        browser.close()


def test_a_swarm_without_a_network_is_refused(tmp_path: Path) -> None:
    (tmp_path / "alone.yaml").write_text(re.sub(r"communication.*\n", "", SWARM))
    refused = run_swarmctl("dashboard", "--config", "alone.yaml", cwd=tmp_path)
    assert refused.returncode == 2
    assert "[no-network]" in refused.stderr
