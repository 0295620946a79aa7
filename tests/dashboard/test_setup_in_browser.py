"""The set-up in a real browser: no-fly cells are set by mouse and by keyboard, saved, and flown."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from simulator_process import free_udp_port
from swarmctl_process import StartDashboard, address_of, read_until

from swarmctl.config.model import load

pytestmark = pytest.mark.interop
COMMENT = "# narrow on purpose"
SMALL = f"""\
name: drawn
seed: 3
area: {{origin_lat_deg: 46.0, origin_lon_deg: 14.4, rows: 6, cols: 6, cell_size_m: 50}}  {COMMENT}
threats: {{count: 3}}
simulate: {{count: 3, speedup: 10, ready_s: 1, start_distance_m: 60}}
flight: {{altitude_m: 15, altitude_step_m: 5}}
"""


@pytest.fixture
def address(tmp_path: Path, start_dashboard: StartDashboard) -> str:
    return address_of(start_dashboard("dashboard", "--setup", "new.yaml", cwd=tmp_path))


@pytest.mark.full
def test_a_set_up_is_drawn_saved_and_flown(
    tmp_path: Path, start_dashboard: StartDashboard, browser: Any
) -> None:
    (tmp_path / "small.yaml").write_text(SMALL)
    process = start_dashboard("dashboard", "--setup", "small.yaml", cwd=tmp_path)
    page = browser.new_page()
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(address_of(process))
    ready = page.get_by_role("status")
    ready.filter(has_text="no problems").wait_for()
    page.get_by_label("Simulated vehicles").fill("2")
    page.locator(".first-routes > *").nth(2).wait_for(state="detached")
    canvas = page.locator("canvas")
    box = canvas.bounding_box()
    # The fence, which reaches west to the vehicles, is centred: a third of a cell to row 3, column 2.
    canvas.click(position={"x": box["width"] / 2, "y": box["height"] / 2 - 24})
    canvas.press("ArrowUp")
    canvas.press("Enter")
    ready.filter(has_text="no problems").wait_for()
    page.get_by_role("button", name="Save and fly").click()
    page.wait_for_url("**/flight/1")
    for name in ("uav1", "uav2"):
        page.locator(".card-vehicle", has_text=name).filter(has_text="done").wait_for()
    page.get_by_text("its record is complete").wait_for()
    assert errors == []

    assert COMMENT in (tmp_path / "small.yaml").read_text()
    assert load(tmp_path / "small.yaml").area.no_fly == ((3, 2), (4, 2))
    read_until(process, "exit code 0")
    assert len(list(tmp_path.glob("runs/*/summary.json"))) == 1
    page.get_by_role("link", name="Set-up").click()
    page.get_by_role("link", name="Flight 1").wait_for()


REAL = """\
name: drawn-real
area: {origin_lat_deg: 46.0, origin_lon_deg: 14.4, rows: 8, cols: 8, cell_size_m: 50}
threats: {count: 5}
vehicles:
  - {name: hawk, url: "udpin://127.0.0.1:PORT", sysid: 1,
     start: {lat_deg: 46.001, lon_deg: 14.3995}, goal: [2, 7]}
"""


def test_a_flight_of_real_vehicles_needs_their_names(
    tmp_path: Path, start_dashboard: StartDashboard, browser: Any
) -> None:
    (tmp_path / "real.yaml").write_text(REAL.replace("PORT", str(free_udp_port())))
    page = browser.new_page()
    page.goto(address_of(start_dashboard("dashboard", "--setup", "real.yaml", cwd=tmp_path)))
    page.get_by_role("button", name="Save and fly").click()
    fly = page.get_by_role("button", name="Fly", exact=True)
    fly.wait_for()
    page.get_by_label("Names").fill("haw")
    assert fly.is_disabled()
    page.get_by_role("button", name="Cancel").click()
    fly.wait_for(state="detached")
    assert not (tmp_path / "runs").exists()
    page.get_by_role("button", name="Save and fly").click()
    page.get_by_label("Names").fill("hawk")
    fly.click()
    page.wait_for_url("**/flight/1")  # nobody answers there, so the flight ends by itself
    page.get_by_text("its record is complete").wait_for()


def test_a_bad_value_is_not_saved(tmp_path: Path, address: str, browser: Any) -> None:
    page = browser.new_page()
    page.goto(address)
    page.get_by_role("status").filter(has_text="no problems").wait_for()
    page.get_by_label("Rows").fill("0")
    page.locator(".problems", has_text="area.rows").wait_for()
    page.get_by_role("button", name="Save", exact=True).click()
    page.locator(".saved", has_text="not saved").wait_for()
    assert not (tmp_path / "new.yaml").exists()
