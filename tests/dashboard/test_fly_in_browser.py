"""`swarmctl fly --dashboard`: a whole flight watched in a real browser, and the end of both processes."""

from __future__ import annotations

import os
import signal
import subprocess
from pathlib import Path
from typing import Any

import pytest
from swarmctl_process import StartDashboard, address_of, read_until

pytestmark = pytest.mark.interop
OVER = "the flight is over"
SWARM = """
name: NAME
seed: 3
area: {origin_lat_deg: 46.0, origin_lon_deg: 14.4, rows: 6, cols: 6, cell_size_m: CELL}
threats:
  count: 6
  hostiles: [[0, 3], [1, 3], [2, 3], [3, 3], [4, 3], [5, 3]]
  firing_strength: {direct: 1.0, first_neighbour: 0.5, second_neighbour: 0.1}
simulate: {count: 2, speedup: 5, ready_s: 1, start_side: west, start_distance_m: 60, goal_side: east}
flight: {altitude_m: 15, altitude_step_m: 5}
"""


@pytest.fixture
def flight(
    tmp_path: Path, request: pytest.FixtureRequest, start_dashboard: StartDashboard
) -> subprocess.Popen[str]:
    """Start a flight; its parameter is the side of a cell [m].

    Orders find all swarms of a machine by name, so flights of other processes have other names.
    """
    content = SWARM.replace("CELL", str(getattr(request, "param", 50)))
    content = content.replace("NAME", f"watched-{os.getpid()}")
    (tmp_path / "swarm.yaml").write_text(content)
    return start_dashboard("fly", "--config", "swarm.yaml", "--dashboard", cwd=tmp_path)


def test_a_flight_is_watched_to_its_end(flight: subprocess.Popen[str], browser: Any) -> None:
    page = browser.new_page()
    lines = read_until(flight, "token=")
    page.goto(lines[-1].split()[-1])
    for name in ("uav1", "uav2"):
        page.locator(".card-vehicle", has_text=name).filter(has_text="done").wait_for(timeout=120_000)
    if not any(OVER in line for line in lines):  # a loaded machine may serve the page after the flight
        read_until(flight, OVER)
    alarms = page.get_by_role("alert", name="Alarms")
    alarms.get_by_role("button", name="Acknowledge all").press("Enter")
    alarms.wait_for(state="hidden")
    flight.send_signal(signal.SIGINT)
    assert flight.wait(timeout=20.0) == 0
    page.get_by_text("Connection lost").wait_for()


def test_the_dashboard_ends_with_a_killed_flight(flight: subprocess.Popen[str], browser: Any) -> None:
    page = browser.new_page()
    page.goto(address_of(flight))
    page.locator(".card-vehicle").first.wait_for()
    flight.kill()
    page.get_by_text("Connection lost").wait_for()
    page.get_by_role("alert").filter(has_text="No data from the dashboard").wait_for()


@pytest.mark.parametrize("flight", [300], indirect=True)  # not over before a loaded machine gives the order
def test_an_order_of_the_page_reaches_the_vehicles_of_a_flight(
    flight: subprocess.Popen[str], browser: Any
) -> None:
    page = browser.new_page()
    page.goto(address_of(flight))
    cards = [page.locator(".card-vehicle", has_text=name) for name in ("uav1", "uav2")]
    for card in cards:
        card.filter(has_text="flying").wait_for()
    page.get_by_role("button", name="Hold").press("Enter")
    page.get_by_role("button", name="Give the order").press("Enter")
    for card in cards:
        card.filter(has_text="holding").wait_for()
