"""A study in a real browser: a point lists its worlds, and a world is flown again with equal results."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from swarmctl_process import StartDashboard, address_of, await_facts
from swarmctl_process import run as run_swarmctl

pytestmark = pytest.mark.interop
EXPERIMENT = """
question: How many strikes does communication save?
base: base.yaml
set: {simulate.count: 3}
factors: {communication.range: [0, 2]}
worlds: 3
figures:
  - {kind: lines, x: communication.range, y: strikes, title: Strikes}
"""
BASE = Path(__file__).parents[2] / "configs" / "swarm.yaml"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "reach.yaml").write_text(EXPERIMENT)
    shutil.copy(BASE, tmp_path / "base.yaml")
    done = run_swarmctl("study", "--config", "reach.yaml", "--workers", "1", cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    return tmp_path / "studies" / "reach"


@pytest.fixture
def address(folder: Path, start_dashboard: StartDashboard) -> str:
    return address_of(start_dashboard("dashboard", folder))


def test_a_point_leads_to_a_mission(folder: Path, address: str, browser: Any) -> None:
    rows = [row for row in pq.read_table(folder / "results.parquet").to_pylist() if row["level"] == 1]
    page = browser.new_page()
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(address)
    chart = page.locator(".nicegui-echart").first
    chart.locator("canvas, svg").first.wait_for()
    at = chart.evaluate(
        "e => getElement(e.id.slice(1)).chart.convertToPixel({seriesIndex: 0}, "
        "getElement(e.id.slice(1)).chart.getOption().series[0].data[1])"
    )
    chart.click(position={"x": at[0], "y": at[1]})
    page.get_by_role("link", name="Replay world 2").click()
    page.locator("canvas").wait_for()
    page.get_by_text("its results are those of the study").wait_for()
    page.keyboard.press("End")
    for row in (row for row in rows if row["seed"] == 2):
        card = page.locator(".card-vehicle").nth(row["uav"] - 1)
        await_facts(card, row["cells_known"], row)
    assert errors == []
