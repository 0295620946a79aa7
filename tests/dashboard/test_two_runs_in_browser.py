"""Two runs side by side in a real browser: one time, and each map with the beliefs of its own run."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from flights import fly, small
from swarmctl_process import SWARMCTL, read_until
from swarmctl_process import run as run_swarmctl

playwright = pytest.importorskip("playwright.sync_api", reason="the browser tests need playwright")
CHROMIUM = shutil.which("chromium")
pytestmark = [
    pytest.mark.interop,
    pytest.mark.skipif(CHROMIUM is None, reason="no chromium is installed"),
]
RANGES = {"together": "all", "silent": 0}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, reach in RANGES.items():
        (tmp_path / name).mkdir()
        two = {"count": 2, "ready_s": 3.0}
        fly(small(simulate=two, communication={"range": reach}), tmp_path / name)
    return tmp_path


@pytest.fixture
def address(folder: Path) -> Iterator[str]:
    command = [*SWARMCTL, "dashboard", *RANGES]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=folder
    ) as process:
        try:
            (found,) = re.findall(r"http://\S+", read_until(process, "token=")[-1])
            yield found
        finally:
            process.terminate()


def test_two_runs_are_scrubbed_together(folder: Path, address: str) -> None:
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        errors: list[str] = []
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto(address)
        page.locator("canvas").nth(1).wait_for()
        page.keyboard.press("End")
        for name in RANGES:
            run = page.get_by_role("region", name=name)
            for vehicle in json.loads((folder / name / "summary.json").read_text())["vehicles"]:
                known = vehicle["cells_own"] + vehicle["cells_heard"]
                card = run.locator(".card-vehicle", has_text=vehicle["name"])
                card.filter(
                    has_text=f"knows {known} cells and {vehicle['hostiles_known']} hostiles"
                ).wait_for()
        browser.close()
    assert errors == []


def test_a_run_is_not_compared_with_itself(tmp_path: Path) -> None:
    assert run_swarmctl("dashboard", "one", "one", cwd=tmp_path).returncode == 2
