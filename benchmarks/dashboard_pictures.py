"""Draw pictures of the dashboard: `python benchmarks/dashboard_pictures.py docs/images`.

It flies the first example with and without communication and the example of a formation on the virtual
clock, flies a short study, and photographs their pages in Chromium at 1280 × 800. The picture of the orders
is of a flight in real time.
"""

from __future__ import annotations

import argparse
import re
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import yaml
from playwright.sync_api import Browser, Page, ViewportSize, sync_playwright

CONFIGS = Path(__file__).parent.parent / "configs"
SIZE: ViewportSize = {"width": 1280, "height": 800}
STUDY = {
    "question": "How many strikes does communication save?",
    "base": str(CONFIGS / "swarm.yaml"),
    "factors": {"simulate.count": [2, 5], "communication.range": [0, 1, 2, 3, 4]},
    "where": ["communication.range < simulate.count"],
    "worlds": 200,
    "figures": [
        {
            "kind": "lines",
            "title": "Strikes of a vehicle by number of receivers",
            "x": "communication.range",
            "y": "strikes",
            "by": "simulate.count",
        }
    ],
}


def swarmctl(folder: Path, *words: str) -> None:
    subprocess.run(["swarmctl", *words], cwd=folder, check=True, stdout=subprocess.DEVNULL)


def fly(folder: Path, name: str, example: str, communication: object) -> None:
    """Fly an example on the virtual clock, and name its run."""
    content = yaml.safe_load((CONFIGS / f"{example}.yaml").read_text())
    content["communication"]["range"] = communication
    (folder / f"{name}.yaml").write_text(yaml.safe_dump(content))
    out = folder / f"{name}-runs"
    swarmctl(folder, "fly", "--config", f"{name}.yaml", "--clock", "virtual", "--out", str(out))
    (run,) = out.iterdir()
    run.rename(folder / name)


@contextmanager
def page_of(browser: Browser, folder: Path, *words: str) -> Iterator[Page]:
    """Start a dashboard, and open its page; the first word is the command."""
    command = ["swarmctl", *words]
    process = subprocess.Popen(
        command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    assert process.stdout is not None
    found = next(filter(None, (re.search(r"http://\S+", line) for line in process.stdout)))
    page = browser.new_context(viewport=SIZE).new_page()
    page.goto(found[0])
    try:
        yield page
    finally:
        page.context.close()
        process.send_signal(signal.SIGINT)  # the first one ends a flight, the next one its dashboard
        process.communicate()


def scrub(page: Page, seconds: int) -> None:
    """Move the time by seconds, and wait until the map is drawn."""
    page.locator("canvas").last.wait_for()
    page.wait_for_timeout(2000)
    for _ in range(seconds):
        page.keyboard.press(".")
    page.wait_for_timeout(2000)


def show_what_if(page: Page) -> None:
    """Move the slider of w for uav1, and draw its Pareto front."""
    page.locator(".card-vehicle", has_text="uav1").press("Enter")
    page.get_by_role("tab", name="What if").click()
    page.get_by_role("slider", name="w: 0").locator("[tabindex]").focus()
    for _ in range(5):
        page.keyboard.press("ArrowLeft")
    page.get_by_role("button", name="Pareto front").press("Enter")
    page.wait_for_timeout(3000)


def hold_uav2(page: Page) -> None:
    """Let uav2 hold after 40 s of flight."""
    page.locator(".card-vehicle", has_text="uav1").filter(has_text="flying").wait_for(timeout=90_000)
    page.wait_for_timeout(40_000)
    page.locator(".card-vehicle", has_text="uav2").press("Enter")
    page.get_by_role("button", name="Hold", exact=True).press("Enter")
    page.get_by_role("button", name="Give the order").press("Enter")
    page.locator(".card-vehicle", has_text="uav2").filter(has_text="holding").wait_for()
    page.wait_for_timeout(700)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    out = parser.parse_args().folder.resolve()
    chromium = shutil.which("chromium")
    with tempfile.TemporaryDirectory() as scratch, sync_playwright() as driver:
        folder = Path(scratch)
        fly(folder, "together", "swarm", "all")
        fly(folder, "silent", "swarm", 0)
        fly(folder, "formation", "formation", "all")
        content = yaml.safe_load((folder / "together.yaml").read_text())
        content["simulate"]["speedup"] = 1
        (folder / "real-time.yaml").write_text(yaml.safe_dump(content))
        (folder / "reach.yaml").write_text(yaml.safe_dump(STUDY, sort_keys=False))
        swarmctl(folder, "study", "--config", "reach.yaml")
        browser = driver.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        for name, (words, seconds) in {
            "dashboard": (["together"], 64),
            "dashboard-two": (["together", "silent"], 130),
            "dashboard-formation": (["formation"], 120),
        }.items():
            with page_of(browser, folder, "dashboard", *words) as page:
                scrub(page, seconds)
                page.screenshot(path=out / f"{name}.png")
                if name == "dashboard":
                    show_what_if(page)
                    page.screenshot(path=out / "dashboard-what-if.png")
        shutil.copy(CONFIGS / "swarm.yaml", folder)
        with page_of(browser, folder, "dashboard", "--setup", "swarm.yaml") as page:
            page.get_by_role("status").filter(has_text="no problems").wait_for()
            page.wait_for_timeout(2000)
            page.screenshot(path=out / "dashboard-setup.png")
        with page_of(browser, folder, "fly", "--config", "real-time.yaml", "--dashboard") as page:
            hold_uav2(page)
            page.screenshot(path=out / "dashboard-orders.png")
        with page_of(browser, folder, "dashboard", "studies/reach") as page:
            page.locator(".nicegui-echart canvas, .nicegui-echart svg").first.wait_for()
            page.wait_for_timeout(2000)
            page.screenshot(path=out / "dashboard-study.png")
        browser.close()


if __name__ == "__main__":
    main()
