"""Swarms of processes in network namespaces: killed, cut off, and restored."""

from __future__ import annotations

import json
import re
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import namespaces
import numpy as np
import pytest
from namespaces import BridgedNetwork, Process, bridged_network, until
from recorded import effects, events
from swarmctl_process import SWARMCTL, run

from swarmctl.cli.console import FAILED, OK
from swarmctl.config.checks import check_config
from swarmctl.config.model import load
from swarmctl.config.scenario import build
from swarmctl.core import events as ev
from swarmctl.core.belief import Belief
from swarmctl.core.observation import BeliefItem, Observation

pytestmark = [pytest.mark.interop, pytest.mark.full]

CONFIG = """\
name: apart
area: {{origin_lat_deg: 46.0, origin_lon_deg: 14.4, rows: {count}, cols: {cols}, cell_size_m: 50}}
threats: {{count: 8}}
planner: {{name: dijkstra, w: 0.2}}
communication: {{keys: keys, {communication}}}
simulate: {{count: {count}, speedup: 10, ready_s: 0, speed_m_s: 5}}
flight: {{on_exit: hold, altitude_m: 40, altitude_step_m: 4, connect_timeout_s: 90}}
"""
ROUTER, STATION = "router", "station"
AT = {ROUTER: "10.231.0.1", STATION: "10.231.0.2"} | {f"uav{n}": f"10.231.0.{10 + n}" for n in range(1, 7)}
FLIGHT_S = 300.0
"""limit of a whole flight, which takes 30 s on an idle machine"""
LOADED = "import swarmctl.cli.main; print('loaded'); input(); from swarmctl.cli.entry import main; main()"
"""program text of a process that is loaded before a flight: on a busy machine loading takes long"""
REACHED, MISSING = "[network-reached]", "[network-missing]"


@dataclass
class Swarm:
    """A configuration and its keys in a folder, and the machines that have it."""

    net: BridgedNetwork
    folder: Path
    names: list[str]
    starts: int = 0
    agents: dict[str, Process] = field(default_factory=dict)
    """the running agents by vehicle name"""

    def start(self, machine: str, *words: str, program: Sequence[str] = SWARMCTL) -> Process:
        self.starts += 1
        log = self.folder / f"{self.starts}-{machine}-{words[0]}.log"
        return self.net.start(machine, [*program, *words, "--config", "swarm.yaml"], log)

    def load(self, machine: str, *words: str) -> Process:
        """Return a loaded process that begins at a call of `enter`."""
        return self.start(machine, *words, program=[sys.executable, "-c", LOADED])

    def start_agents(self) -> None:
        for name in self.names:
            self.agents[name] = self.start(name, "agent", "--uav", name, "--launch", "ordered")

    def wait_until_ready(self) -> None:
        for agent in self.agents.values():
            agent.wait_for("[ready]")
            agent.wait_for(REACHED)

    def order(self, process: Process) -> bool:
        """Give the order of a loaded `process` and return whether all agents have taken it, also before."""
        process.wait_for("loaded")
        process.enter()
        code = process.ended()
        assert code in {OK, FAILED}, process.output
        return code == OK

    def summary(self, name: str) -> dict[str, Any]:
        content: dict[str, Any] = json.loads((self._run(name) / "summary.json").read_text())
        return content

    def beliefs(self, until_s: float = float("inf")) -> dict[str, Belief]:
        """Return what each running agent knew at a time [Unix s], or at its end, by its own record."""
        prior = build(load(self.folder / "swarm.yaml", check_config)).prior
        return {name: prior.merge(_observations(self._run(name), until_s)) for name in self.agents}

    def _run(self, name: str) -> Path:
        (folder,) = (self.folder / "runs").glob(f"*-{name}")
        return folder


def _observations(run: Path, until_s: float) -> Iterator[BeliefItem]:
    """Yield an agent's own observations and those it received."""
    for record in [*events(run, "ObservationsReceived"), *effects(run, "Publish")]:
        if record["log_time_ns"] / 1e9 > until_s:
            continue
        if "event" in record:
            yield from msgspec.convert(record["event"], ev.ObservationsReceived).items
        else:
            message = msgspec.convert(record["effect"], ev.Publish).message
            if isinstance(message, Observation):
                yield message


def differ(one: Belief, other: Belief) -> bool:
    return not (np.array_equal(one.looks, other.looks) and np.array_equal(one.hits, other.hits))


def marks(processes: Iterable[Process]) -> dict[Process, int]:
    return {process: process.mark() for process in processes}


@pytest.fixture
def swarm(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Swarm]:
    if reason := namespaces.reason_unavailable():
        pytest.skip(reason)
    count, cols, communication, bridges = request.param
    (tmp_path / "swarm.yaml").write_text(CONFIG.format(count=count, cols=cols, communication=communication))
    made = run("keys", "--config", "swarm.yaml", cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    with bridged_network(*bridges) as net:
        yield Swarm(net, tmp_path, [f"uav{n}" for n in range(1, count + 1)])


@pytest.mark.parametrize(
    "swarm", [(6, 20, f"router: tls/{AT[ROUTER]}:7447", ("air",))], indirect=True, ids=["star"]
)
def test_a_star_network_survives_its_router_a_cut_link_and_an_agent(swarm: Swarm) -> None:
    for machine in (ROUTER, STATION, *swarm.names):
        swarm.net.machine(machine, AT[machine], "air")
    router = swarm.start(ROUTER, "router")
    swarm.start_agents()
    station = swarm.start(STATION, "watch")
    launch, again = swarm.load(STATION, "order", "launch", "--all"), swarm.load(ROUTER, "router")
    swarm.wait_until_ready()
    station.wait_for(": connected")
    again.wait_for("loaded")
    assert swarm.order(launch), launch.output
    for name in swarm.names:
        station.wait_for(f"{name}: flying")

    _router_killed_and_started_again(swarm, router, again, station)
    router = again
    dead = swarm.agents.pop("uav6")
    missed_s = _one_dies_and_one_is_cut_off(swarm, router, station, dead, "uav2")

    for agent in swarm.agents.values():
        agent.wait_for("1 of 1 arrived", within_s=FLIGHT_S)
        assert agent.ended() == 0
    for process in (station, router):
        process.interrupt()
    assert station.ended() == 0
    assert router.ended() == 0
    _all_know_the_same(swarm, station, missed_s, ("uav1", "uav2"))


def _router_killed_and_started_again(swarm: Swarm, router: Process, again: Process, station: Process) -> None:
    before = marks([station, *swarm.agents.values()])
    router.kill()
    for agent in swarm.agents.values():
        agent.wait_for(MISSING, since=before[agent])
    station.wait_for("not connected", since=before[station])
    before = marks([station, *swarm.agents.values()])
    again.enter()
    for agent in swarm.agents.values():
        agent.wait_for(REACHED, since=before[agent])
    station.wait_for(": connected", since=before[station])


def _one_dies_and_one_is_cut_off(
    swarm: Swarm, router: Process, station: Process, dead: Process, cut: str
) -> float:
    """Return the time at which the link was restored [Unix s]."""
    agent = swarm.agents[cut]
    before = marks([station, router, agent])
    swarm.net.cut(cut)
    dead.kill()
    agent.wait_for(MISSING, since=before[agent])
    router.wait_for(f"{cut} at ", " has disconnected", since=before[router])
    for silent in (cut, "uav6"):
        station.wait_for(f"{silent}: flying", " s old", since=before[station])
    _learns(agent)
    missed_s = time.time()
    before = marks([station, agent])
    swarm.net.heal(cut)
    agent.wait_for(REACHED, since=before[agent])
    station.wait_for(f"{cut}: flying", since=before[station], but_not=" s old")
    return missed_s


def _learns(agent: Process) -> None:
    """Wait until an agent knows more cells than it prints next."""
    since = agent.mark()

    def knows_more() -> bool:
        printed = re.findall(r"cells (\d+) own \+ (\d+) received", agent.output[since:])
        known = [int(own) + int(received) for own, received in printed]
        return bool(known) and known[-1] > known[0]

    until(knows_more, lambda: agent.output[since:])


def _all_know_the_same(swarm: Swarm, station: Process, missed_s: float, apart: tuple[str, str]) -> None:
    """Check that all beliefs are equal at the end, and that those of `apart` differed before."""
    then = swarm.beliefs(missed_s)
    assert differ(*(then[name] for name in apart)), "no observation was made during the cut"
    at_the_end = swarm.beliefs()
    known = {name: (belief.n_observed, belief.n_found) for name, belief in at_the_end.items()}
    first = at_the_end[apart[0]]
    assert not [name for name, belief in at_the_end.items() if differ(first, belief)], known
    for name in swarm.agents:
        (vehicle,) = swarm.summary(name)["vehicles"]
        assert (vehicle["cells_own"] + vehicle["cells_received"], vehicle["hostiles_known"]) == known[name]
        assert vehicle["network"]["refused"] == {}
        assert vehicle["network"]["flagged"] == {}
    assert set(re.findall(r"(\d+) messages refused", station.output)) == {"0"}


MESH = ", ".join(f'uav{n}: "tls/{AT[f"uav{n}"]}:7447"' for n in range(1, 5))


@pytest.mark.parametrize(
    "swarm", [(4, 40, f"relay: true, mesh: {{{MESH}}}", ("west", "east"))], indirect=True, ids=["mesh"]
)
def test_a_mesh_splits_and_joins_again(swarm: Swarm) -> None:
    sides = {STATION: "west", "uav1": "west", "uav2": "west", "uav3": "east", "uav4": "east"}
    for machine, side in sides.items():
        swarm.net.machine(machine, AT[machine], side)
    swarm.start_agents()
    station = swarm.start(STATION, "watch")
    launch, hold = (swarm.load(STATION, "order", what, "--all") for what in ("launch", "hold"))
    swarm.wait_until_ready()
    for name in swarm.names:
        station.wait_for(f"{name}: standby")
    hold.wait_for("loaded")
    assert swarm.order(launch), launch.output
    for name in swarm.names:
        station.wait_for(f"{name}: flying")

    before = station.mark()
    swarm.net.cut("east")
    for name in ("uav3", "uav4"):
        station.wait_for(f"{name}: flying", " s old", since=before)
    _learns(swarm.agents["uav1"])
    missed_s = time.time()
    assert not re.search(r"uav[12]: .* ago", station.output[before:])
    before = station.mark()
    swarm.net.heal("east")
    for name in ("uav3", "uav4"):
        station.wait_for(f"{name}: flying", since=before, but_not=" s old")

    # A request before all routes are back may be lost; the operator sees that and orders again.
    _until_all_follow(swarm, hold, "hold")
    _until_all_agree(swarm)
    for process in (*swarm.agents.values(), station):
        process.interrupt()
    for agent in swarm.agents.values():
        assert agent.ended() == 130
    assert station.ended() == 0
    _all_know_the_same(swarm, station, missed_s, ("uav1", "uav3"))


NODE = """\
import asyncio, sys, time
from pathlib import Path
from swarmctl.bus import keys
from swarmctl.bus.transports import zenoh_config
from swarmctl.bus.endpoint import parse_endpoint
from swarmctl.bus.transports.zenoh import ZenohBus
from swarmctl.bus.transports.zenoh_config import Credentials
swarm, uav, here, *there = sys.argv[1:]
uavs, uav = range(1, 5), int(uav)
own = Credentials(*(Path("keys", f"uav{uav}", name) for name in ("ca.pem", "cert.pem", "key.pem")))
there = [parse_endpoint(endpoint) for endpoint in there]
heard_s = {}

async def main():
    with ZenohBus(zenoh_config.mesh_node(parse_endpoint(here), there, swarm, uavs, own)) as bus:
        bus.subscribe(keys.inbox(swarm, uav), lambda key, _: heard_s.update({key[-1]: time.monotonic()}))
        said = ""
        while True:
            for other in uavs:
                bus.put(keys.uav_message(swarm, other, "inform/state", uav), b"")
            await asyncio.sleep(0.2)
            now_s = time.monotonic()
            hears = "hears " + " ".join(sorted(name for name, at_s in heard_s.items() if now_s - at_s < 1.5))
            if hears != said:
                print(said := hears, flush=True)

asyncio.run(main())
"""
ALL = "hears 1 2 3 4"


@pytest.mark.parametrize("swarm", [(4, 4, f"mesh: {{{MESH}}}", ("west", "east"))], indirect=True, ids=["bus"])
def test_all_routes_of_a_mesh_return_after_each_cut(swarm: Swarm) -> None:
    """After a short cut the two ends of a link may not agree on whether it was lost."""
    nodes = []
    for uav in range(1, 5):
        name = f"uav{uav}"
        swarm.net.machine(name, AT[name], "west" if uav < 3 else "east")
        # One node of each pair connects.
        places = [f"tls/{AT[f'uav{n}']}:7447" for n in range(uav, 0, -1)]
        words = [sys.executable, "-c", NODE, "apart", str(uav), *places]
        nodes.append(swarm.net.start(name, words, swarm.folder / f"{name}.log"))
    for node in nodes:
        node.wait_for(ALL)
    for cut_s in (2.0, 2.6, 4.0):
        before = marks(nodes)
        swarm.net.cut("east")
        time.sleep(cut_s)
        swarm.net.heal("east")
        for node in nodes:
            node.wait_for("hears", since=before[node], but_not=ALL)
        until(lambda: all(node.lines()[-1] == ALL for node in nodes), lambda: _last_lines(nodes))


def _last_lines(nodes: Sequence[Process]) -> str:
    return "; ".join(f"{node.log.name}: {node.lines()[-1]}" for node in nodes)


def _until_all_follow(swarm: Swarm, process: Process, what: str) -> None:
    given = [process]

    def all_have_taken_it() -> bool:
        if swarm.order(given[-1]):
            return True
        given.append(swarm.load(STATION, "order", what, "--all"))
        return False

    until(all_have_taken_it, lambda: given[-1].output)


def _until_all_agree(swarm: Swarm) -> None:
    """Wait until the station shows equal beliefs."""
    seen = ""

    def all_the_same() -> bool:
        nonlocal seen
        seen = swarm.net.run(
            STATION, [*SWARMCTL, "watch", "--once", "--config", "swarm.yaml"], swarm.folder
        ).stdout
        rows = [re.split(" +", line) for line in re.findall(r"^ *(uav\d .*?) *$", seen, re.MULTILINE)]
        assert [row[0] for row in rows] == swarm.names, seen
        return {row[1] for row in rows} == {"holding"} and len({(row[6], row[7]) for row in rows}) == 1

    until(all_the_same, lambda: seen)
