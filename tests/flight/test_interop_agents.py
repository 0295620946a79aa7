"""A swarm of processes: a router, an agent for each vehicle, a ground station, an operator."""

from __future__ import annotations

import json
import re
import signal
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import pytest
from namespaces import until
from swarmctl_process import read_until, run, started
from zenoh_nodes import free_port

from swarmctl.core.messages import VehicleAnswer
from swarmctl.report.answers import order_line

pytestmark = [pytest.mark.interop, pytest.mark.full]

APART = """\
name: apart
area: {origin_lat_deg: 46.0, origin_lon_deg: 14.4, rows: 8, cols: 8, cell_size_m: 50}
threats: {count: 5}
communication: {router: "tcp/127.0.0.1:PORT"}
simulate: {count: 2, speedup: 10, ready_s: 0}
flight: {on_exit: hold, altitude_m: 15}
"""


@dataclass
class Field:
    """A folder with a configuration, and the processes started in it."""

    folder: Path
    processes: ExitStack

    def start(self, *words: str) -> subprocess.Popen[str]:
        process = started(*words, "--config", "apart.yaml", cwd=self.folder)
        return self.processes.enter_context(process)

    def agent(self, uav: str, *words: str) -> subprocess.Popen[str]:
        return self.start("agent", "--uav", uav, *words)

    def run(self, *words: str) -> subprocess.CompletedProcess[str]:
        return run(*words, "--config", "apart.yaml", cwd=self.folder)

    def summary(self, name: str) -> dict[str, object]:
        (file,) = (self.folder / "runs").glob(f"*-apart-{name}/summary.json")
        content: dict[str, object] = json.loads(file.read_text())
        return content


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Field]:
    (tmp_path / "apart.yaml").write_text(APART.replace("PORT", str(free_port())))
    with ExitStack() as processes:
        yield Field(tmp_path, processes)


def test_agents_launch_by_order_and_fly_on_without_the_router(place: Field) -> None:
    one, two = place.agent("uav1"), place.agent("2")  # before there is a router
    read_until(one, "[network-missing]")
    router = place.start("router")
    for agent in (one, two):
        read_until(agent, "[network-reached]")

    until(lambda: place.run("watch", "--once").stdout.count("standby") == 2, lambda: "not both on standby")
    launched = place.run("order", "launch", "--all")
    taken = [order_line("launch", VehicleAnswer(n, f"uav{n}", "taken")) for n in (1, 2)]
    assert (launched.returncode, launched.stdout.splitlines()) == (0, taken)
    weighed = place.run("set", "--uav", "uav1", "--w", "0.9")
    assert re.match(r"uav1: w = 0\.9 .*\d", weighed.stdout)
    router.kill()
    for agent, name in ((one, "uav1"), (two, "uav2")):
        read_until(agent, "1 of 1")
        assert agent.wait(timeout=20.0) == 0
        vehicles = place.summary(name)["vehicles"]
        assert isinstance(vehicles, list)
        assert [vehicle["name"] for vehicle in vehicles] == [name]
    gone = place.run("order", "hold", "--all")
    assert gone.returncode == 1


def test_ctrl_c_ends_every_process_even_with_a_stopped_router(place: Field) -> None:
    router = place.start("router")
    lines = read_until(router, "listening at")
    agent, station = place.agent("uav1"), place.start("watch")
    lines += read_until(agent, "[ready]")
    lines += read_until(station, "uav1: standby")
    assert all(re.match(r"\d\d:\d\d:\d\d \S", line) for line in lines), lines
    router.send_signal(signal.SIGSTOP)
    try:
        for process in (agent, station):
            process.send_signal(signal.SIGINT)
        assert agent.wait(timeout=20.0) == 130
        assert (
            station.wait(timeout=20.0) == 0
        )  # the station shows the vehicles until their landing, so the router still runs
    finally:
        router.send_signal(signal.SIGCONT)
    router.send_signal(signal.SIGINT)
    assert router.wait(timeout=20.0) == 0


def test_an_agent_without_network_flies_alone_and_can_be_stopped(place: Field) -> None:
    waiting = place.agent("uav1")
    read_until(waiting, "[ready]")
    flown = place.agent("uav2", "--launch", "when-ready")
    read_until(flown, "1 of 1")
    assert flown.wait(timeout=20.0) == 0
    waiting.send_signal(signal.SIGINT)
    read_until(waiting, "0 of 1")
    assert waiting.wait(timeout=20.0) == 130
