"""`swarmctl dashboard --config`: a swarm of processes, watched in a real browser."""

from __future__ import annotations

import os
import re
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from swarmctl_process import StartDashboard, address_of, read_until
from swarmctl_process import run as run_swarmctl
from zenoh_nodes import free_port

pytestmark = [
    pytest.mark.interop,
    pytest.mark.full,
]
# The way is long: a browser on a loaded machine takes a minute for what this file does during the flight.
SWARM = """\
name: NAME
area: {origin_lat_deg: 46.0, origin_lon_deg: 14.4, rows: 8, cols: 8, cell_size_m: 300}
threats: {count: 5}
communication: {router: "tcp/127.0.0.1:PORT"}
simulate: {count: 2, speedup: 4, ready_s: 0}
flight: {on_exit: hold, altitude_m: 15}
"""
NAMES = ("uav1", "uav2")
WEIGHTS = ("w: 0", "own cell", "first neighbours", "second neighbours")
RANGE = "range of communication"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "apart.yaml").write_text(
        SWARM.replace("PORT", str(free_port())).replace("NAME", f"apart-{os.getpid()}")
    )
    return tmp_path


@dataclass
class Swarm:
    start: Callable[..., subprocess.Popen[str]]
    router: subprocess.Popen[str]
    dashboard: subprocess.Popen[str]


@pytest.fixture
def swarm(folder: Path, start_dashboard: StartDashboard) -> Swarm:
    """Start a router, an agent for each vehicle, and the dashboard."""

    def start(*words: str) -> subprocess.Popen[str]:
        return start_dashboard(*words, "--config", "apart.yaml", cwd=folder)

    router = start("router")
    read_until(router, "listening at")
    for name in NAMES:
        read_until(start("agent", "--uav", name), "[ready]")
    return Swarm(start, router, start("dashboard"))


def launched(page: Any, swarm: Swarm) -> list[Any]:
    """Open the page, order the launch, and return the cards of the vehicles in flight."""
    page.goto(address_of(swarm.dashboard))
    cards = [page.locator(".card-vehicle", has_text=name) for name in NAMES]
    for card in cards:
        card.filter(has_text="standby").wait_for()
    order(page, "Launch")
    for card in cards:
        card.filter(has_text="flying").wait_for()
    return cards


def order(page: Any, name: str) -> None:
    page.get_by_role("button", name=name, exact=True).press("Enter")
    confirm = page.get_by_role("button", name="Give the order")
    confirm.press("Enter")
    confirm.wait_for(state="detached")  # a dialog that still closes has the button of the next one's name


def test_each_slider_and_command_arrives_at_a_vehicle(swarm: Swarm, browser: Any) -> None:
    page = browser.new_page()
    cards = launched(page, swarm)
    cards[0].press("Enter")
    page.get_by_role("tab", name="What if").click()
    page.get_by_text("Weights of uav1").wait_for()
    set_values = []
    for slider, key in {**dict.fromkeys(WEIGHTS, "ArrowRight"), RANGE: "ArrowLeft"}.items():
        handle = page.get_by_role("slider", name=slider)
        before = float(handle.get_attribute("aria-valuenow"))
        handle.locator("[tabindex]").focus()
        page.keyboard.press(key)
        after = before + (0.01 if slider in WEIGHTS else -1.0)
        page.wait_for_function(
            "([e, value]) => Math.abs(e.getAttribute('aria-valuenow') - value) < 1e-6",
            arg=[handle.element_handle(), after],
        )
        set_values.append(after)
    w, *strengths, reach = (f"{value:g}" for value in set_values)
    page.get_by_role("button", name="Apply").press("Enter")
    answer = page.get_by_role("alert").filter(has_text=f"w = {w} and firing strengths {', '.join(strengths)}")
    answer.filter(has_text=f"range of communication {reach} from now on").wait_for()
    page.get_by_role("tab", name="Events").click()
    # The vehicle itself tells which weights it plans with.
    page.get_by_text(f"w {w}, firing strengths {'/'.join(strengths)}").wait_for()

    page.get_by_role("tab", name="Vehicles").click()
    page.get_by_text("Order uav1:").wait_for()
    for name, phase in {"Hold": "holding", "Resume": "flying", "Return": "leaving"}.items():
        order(page, name)
        cards[0].filter(has_text=phase).wait_for()
    assert cards[1].filter(has_text="flying").count() == 1
    cards[1].press("Enter")
    page.get_by_text("Order uav2:").wait_for()
    order(page, "Land")
    cards[1].filter(has_text="leaving").wait_for()
    page.get_by_role("button", name="Abort").press("Enter")
    page.get_by_role("button", name="All hold").press("Enter")
    for card in cards:
        card.filter(has_text="holding").wait_for()


def test_a_swarm_of_agents_is_watched_through_a_restart_of_its_router(swarm: Swarm, browser: Any) -> None:
    page = browser.new_page()
    for card in launched(page, swarm):
        card.filter(has_text=re.compile("known cells: [1-9]")).wait_for()
    silent = page.locator(".card-vehicle.is-silent")
    swarm.router.kill()
    swarm.router.wait()
    page.get_by_text("not connected").wait_for()
    silent.nth(1).wait_for()
    read_until(swarm.start("router"), "listening at")
    silent.first.wait_for(state="hidden")


def test_a_swarm_without_a_network_is_refused(tmp_path: Path) -> None:
    (tmp_path / "alone.yaml").write_text(re.sub(r"communication.*\n", "", SWARM))
    refused = run_swarmctl("dashboard", "--config", "alone.yaml", cwd=tmp_path)
    assert refused.returncode == 2
    assert "[no-network]" in refused.stderr


REAL = """\
name: real
area: {origin_lat_deg: 46.0, origin_lon_deg: 14.4, rows: 8, cols: 8, cell_size_m: 50}
threats: {count: 5}
communication: {router: "tcp/127.0.0.1:9"}
vehicles:
  - name: hawk
    url: "udpin://127.0.0.1:14551"
    sysid: 1
    start: {lat_deg: 46.001, lon_deg: 14.3995}
    goal: [2, 7]
"""


def test_the_launch_of_a_real_vehicle_needs_its_name(
    tmp_path: Path, start_dashboard: StartDashboard, browser: Any
) -> None:
    (tmp_path / "real.yaml").write_text(REAL)
    page = browser.new_page()
    page.goto(address_of(start_dashboard("dashboard", "--config", "real.yaml", cwd=tmp_path)))
    page.get_by_role("button", name="Launch").press("Enter")
    order = page.get_by_role("button", name="Give the order")
    order.wait_for()
    assert order.is_disabled()
    page.get_by_label("Names").fill("haw")
    page.get_by_label("Names").press("Enter")
    assert order.is_disabled()
    page.get_by_label("Names").fill("hawk")
    order.click()
    page.get_by_role("alert").filter(has_text="9").wait_for()  # no router listens there
