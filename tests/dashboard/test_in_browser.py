"""The page in a real browser: a replay is scrubbed, played by keyboard, and loads nothing from outside."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from flights import fly, small
from swarmctl_process import SWARMCTL, read_until

playwright = pytest.importorskip("playwright.sync_api", reason="the browser tests need playwright")
CHROMIUM = shutil.which("chromium")
pytestmark = [
    pytest.mark.interop,
    pytest.mark.skipif(CHROMIUM is None, reason="no chromium is installed"),
]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    fly(small(simulate={"count": 2, "ready_s": 3.0}), folder)
    return folder


@pytest.fixture
def address(run: Path) -> Iterator[str]:
    command = [*SWARMCTL, "dashboard", str(run)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        try:
            (found,) = re.findall(r"http://\S+", read_until(process, "token=")[-1])
            yield found
        finally:
            process.terminate()


def test_a_replay_is_scrubbed_to_its_end(run: Path, address: str) -> None:
    summary = json.loads((run / "summary.json").read_text())
    asked: list[str] = []
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.on("request", lambda request: asked.append(request.url))
        errors: list[str] = []
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto(address)
        page.locator("canvas").wait_for()
        assert page.get_by_role("button", name="Launch").count() == 0, "a record takes no orders"
        page.keyboard.press("End")
        for vehicle in summary["vehicles"]:
            card = page.locator(".card-vehicle", has_text=vehicle["name"])
            known = vehicle["cells_own"] + vehicle["cells_heard"]
            card.filter(has_text=f"knows {known} cells and {vehicle['hostiles_known']} hostiles").wait_for()
            card.filter(has_text=f"{vehicle['replans']} replans, {vehicle['strikes']} strikes").wait_for()
        again = browser.new_context().new_page()
        assert again.goto(address).status == 401, "the address works once"
        browser.close()
    assert errors == []
    assert {urlsplit(url).hostname for url in asked if not url.startswith(("data:", "blob:"))} == {
        "127.0.0.1"
    }


def test_a_slider_shows_the_route_that_would_be_flown_and_a_front_its_routes(address: str) -> None:
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.goto(address)
        page.locator(".card-vehicle", has_text="uav1").click()
        page.get_by_role("tab", name="What if").click()
        page.get_by_text("Weights of uav1").wait_for()
        page.get_by_role("slider", name="w: 0").locator("[tabindex]").focus()
        page.keyboard.press("ArrowRight")
        page.get_by_text(re.compile(r"uav1: \d+ m, ΣP_s [\d.]+")).wait_for()
        page.get_by_role("button", name="Pareto front").press("Enter")
        page.get_by_text("Click a point").wait_for()
        assert page.get_by_role("tabpanel").locator("canvas").is_visible()
        browser.close()
