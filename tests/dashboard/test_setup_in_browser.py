"""The set-up in a real browser: no-fly cells are set by mouse and by keyboard, saved, and flown."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from dashboard_process import StartDashboard, address_of
from swarmctl_process import run as run_swarmctl

from swarmctl.config.model import load

pytestmark = pytest.mark.interop


@pytest.fixture
def address(tmp_path: Path, start_dashboard: StartDashboard) -> str:
    return address_of(start_dashboard("dashboard", "--setup", "new.yaml", cwd=tmp_path))


def test_a_set_up_is_drawn_saved_and_flown(tmp_path: Path, address: str, browser: Any) -> None:
    page = browser.new_page()
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(address)
    ready = page.get_by_role("status")
    ready.filter(has_text="no problems").wait_for()
    page.get_by_label("Simulated vehicles").fill("2")
    page.locator(".first-routes > *").nth(2).wait_for(state="detached")
    canvas = page.locator("canvas")
    box = canvas.bounding_box()
    canvas.click(position={"x": box["width"] / 2 + 5, "y": box["height"] / 2 - 5})
    canvas.press("ArrowUp")
    canvas.press("Enter")
    page.get_by_role("button", name="Save").click()
    page.locator(".saved", has_text="swarmctl fly --config new.yaml").wait_for()
    assert errors == []
    config = load(tmp_path / "new.yaml")
    assert config.area.no_fly == ((10, 10), (11, 10))
    flown = run_swarmctl("fly", "--config", "new.yaml", "--clock", "virtual", cwd=tmp_path)
    assert flown.returncode == 0, flown.stdout + flown.stderr
    assert len(list(tmp_path.glob("runs/*/summary.json"))) == 1


def test_a_bad_value_is_not_saved(tmp_path: Path, address: str, browser: Any) -> None:
    page = browser.new_page()
    page.goto(address)
    page.get_by_role("status").filter(has_text="no problems").wait_for()
    page.get_by_label("Rows").fill("0")
    page.locator(".problems", has_text="area.rows").wait_for()
    page.get_by_role("button", name="Save").click()
    page.locator(".saved", has_text="not saved").wait_for()
    assert not (tmp_path / "new.yaml").exists()
