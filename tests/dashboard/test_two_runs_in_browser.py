"""Two runs side by side in a real browser: one time, and each map with the beliefs of its own run."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from flights import fly, small
from swarmctl_process import StartDashboard, address_of, await_facts
from swarmctl_process import run as run_swarmctl

pytestmark = pytest.mark.interop
RANGES = {"together": "all", "silent": 0}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, reach in RANGES.items():
        (tmp_path / name).mkdir()
        two = {"count": 2, "ready_s": 3.0}
        fly(small(simulate=two, communication={"range": reach}), tmp_path / name)
    return tmp_path


@pytest.fixture
def address(folder: Path, start_dashboard: StartDashboard) -> str:
    return address_of(start_dashboard("dashboard", *RANGES, cwd=folder))


def test_two_runs_are_scrubbed_together(folder: Path, address: str, browser: Any) -> None:
    page = browser.new_page()
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(address)
    page.locator("canvas").nth(1).wait_for()
    page.keyboard.press("End")
    for name in RANGES:
        run = page.get_by_role("region", name=name)
        for vehicle in json.loads((folder / name / "summary.json").read_text())["vehicles"]:
            card = run.locator(".card-vehicle", has_text=vehicle["name"])
            await_facts(card, vehicle["cells_own"] + vehicle["cells_received"], vehicle)
    assert errors == []


def test_a_run_is_not_compared_with_itself(tmp_path: Path) -> None:
    assert run_swarmctl("dashboard", "one", "one", cwd=tmp_path).returncode == 2
