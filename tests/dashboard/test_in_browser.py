"""The page in a real browser: a replay is scrubbed, played by keyboard, and loads nothing from outside."""

from __future__ import annotations

import datetime as dt
import fcntl
import json
import re
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from flights import fly, small
from map_tiles import mbtiles
from swarmctl_process import StartDashboard, address_of, addresses_of, await_facts

from swarmctl.dashboard.server import MAX_MESSAGE_BYTES
from swarmctl.report.record import record_path
from swarmctl.security.issue import make_keys

pytestmark = pytest.mark.interop


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    fly(small(simulate={"count": 2, "ready_s": 3.0}), folder)
    return folder


@pytest.fixture
def address(run: Path, start_dashboard: StartDashboard) -> str:
    return address_of(start_dashboard("dashboard", run))


def test_a_replay_is_scrubbed_to_its_end(run: Path, address: str, browser: Any) -> None:
    summary = json.loads((run / "summary.json").read_text())
    asked: list[str] = []
    page = browser.new_page()
    page.on("request", lambda request: asked.append(request.url))
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(address)
    page.locator("canvas").wait_for()
    assert page.get_by_role("button", name="Launch").count() == 0, "a record takes no orders"
    page.keyboard.press("End")
    for vehicle in summary["vehicles"]:
        card = page.locator(".card-vehicle", has_text=vehicle["name"])
        await_facts(card, vehicle["cells_own"] + vehicle["cells_received"], vehicle)
    again = browser.browser.new_context().new_page()
    assert again.goto(address).status == 401, "the address works once"
    assert errors == []
    assert {urlsplit(url).hostname for url in asked if not url.startswith(("data:", "blob:"))} == {
        "127.0.0.1"
    }


def test_a_slider_shows_the_route_that_would_be_flown_and_a_front_its_routes(
    address: str, browser: Any
) -> None:
    page = browser.new_page()
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


def test_operator_and_viewer_see_each_other_over_tls(
    run: Path, tmp_path: Path, browser: Any, start_dashboard: StartDashboard
) -> None:
    make_keys(tmp_path, ["operator"], 1, dt.datetime.now(dt.UTC))
    keys = tmp_path / "operator"
    record = record_path(run).open("rb")
    fcntl.flock(record, fcntl.LOCK_EX)  # as the process of a flight does
    words = ("dashboard", run, "--live", "--cert", keys / "cert.pem", "--key", keys / "key.pem")
    addresses = addresses_of(start_dashboard(*words), 2)
    pages = [browser.browser.new_context(ignore_https_errors=True).new_page() for _ in addresses]
    for page, address in zip(pages, addresses, strict=True):
        assert address.startswith("https://")
        page.goto(address)
    operator, viewer = pages
    operator.get_by_text("also here: viewer 1 at 127.0.0.1").wait_for()
    viewer.get_by_text("also here: operator 1 at 127.0.0.1").wait_for()
    assert operator.get_by_role("button", name="Hold").count() == 1
    assert viewer.get_by_role("button", name="Hold").count() == 0
    viewer.close()
    operator.get_by_text("also here").wait_for(state="hidden")
    record.close()


def test_the_tiles_of_a_file_lie_below_the_area(
    run: Path, tmp_path: Path, browser: Any, start_dashboard: StartDashboard
) -> None:
    world = mbtiles(tmp_path / "world.mbtiles", tiles=((0, 0, 0),))
    page = browser.new_page()
    page.goto(address_of(start_dashboard("dashboard", run, "--tiles", world)))
    page.wait_for_function(
        """() => {
            const canvas = document.querySelector(".risk-map canvas");
            const pixel = canvas?.getContext("2d").getImageData(2, 2, 1, 1).data;
            return pixel?.join() === "255,0,0,255";
        }"""
    )


def test_a_message_above_the_limit_ends_its_socket(address: str, browser: Any) -> None:
    page = browser.new_page()
    page.goto(address)
    page.locator("canvas").wait_for()
    closed = page.evaluate(
        """bytes => new Promise((done) => {
            const path = "/_nicegui_ws/socket.io/?EIO=4&transport=websocket";
            const socket = new WebSocket(location.origin.replace("http", "ws") + path);
            socket.onopen = () => socket.send("x".repeat(bytes));
            socket.onclose = (event) => done(event.code);
        })""",
        MAX_MESSAGE_BYTES + 1,
    )
    assert closed == 1009  # message too big


BLOCKED_S = 12
"""longer than NiceGUI by itself keeps the page of a browser that does not answer [s]"""


def test_a_browser_that_was_blocked_keeps_its_page(address: str, browser: Any) -> None:
    page = browser.new_page()
    page.goto(address)
    page.locator(".card-vehicle", has_text="uav1").press("Enter")
    page.get_by_role("tab", name="What if").click()
    page.get_by_text("Weights of uav1").wait_for()
    loaded: list[str] = []
    page.on("framenavigated", lambda frame: loaded.append(frame.url))
    page.evaluate(f"const end = Date.now() + {BLOCKED_S * 1000}; while (Date.now() < end);")
    page.get_by_role("slider", name="w: 0").locator("[tabindex]").focus()
    page.keyboard.press("ArrowRight")
    page.get_by_text(re.compile(r"uav1: \d+ m, ΣP_s [\d.]+")).wait_for()
    assert loaded == []
