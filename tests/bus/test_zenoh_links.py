"""Broken links and frozen peers: reconnection, calls that never block, and the end of a process."""

from __future__ import annotations

import asyncio
import signal
import subprocess
import sys
import time
from collections.abc import Callable

import pytest
from profiles import full_only
from zenoh_nodes import (
    SWARM,
    UAVS,
    RouterProcess,
    client_of,
    credentials,
    here,
    meet,
    router_process,
    until,
    until_answered,
)

from swarmctl.bus import keys
from swarmctl.bus.endpoint import BusEndpoint
from swarmctl.bus.transports import renewal, zenoh, zenoh_config
from swarmctl.bus.transports.zenoh import CLOSE_S, ZenohBus
from swarmctl.core.records import replace

pytestmark = pytest.mark.interop
TO_TWO = keys.uav_message(SWARM, 2, "inform/state", 1)
WEIGHTS = keys.request(SWARM, "weights", 2)


def say(text: str) -> None:
    """Print a measurement: shown by `pytest -s` and with a failure."""
    sys.stdout.write(text + "\n")


def answer(key: str, payload: bytes | None, reply: Callable[[bytes], None]) -> None:
    reply(b"answer")


@pytest.mark.parametrize(
    ("protocol", "lost_after_s"),
    [
        ("tcp", renewal.LOST_AFTER_S),
        ("tcp", 0.0),
        *full_only(("tls", renewal.LOST_AFTER_S), ("quic", renewal.LOST_AFTER_S)),
    ],
)
def test_a_late_or_restarted_router_is_found_each_time(
    protocol: str, lost_after_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Subscriptions and queries work again, in the same session or a new one."""
    monkeypatch.setattr(renewal, "LOST_AFTER_S", lost_after_s)
    monkeypatch.setattr(zenoh, "CHECK_EVERY_S", 0.05)

    async def scene() -> list[float]:
        router = RouterProcess(here(protocol))
        found_s = []
        received: list[bytes] = []
        with (
            ZenohBus(client_of(router.there, "uav1")) as one,
            ZenohBus(client_of(router.there, "uav2")) as two,
            ZenohBus(client_of(router.there, "operator")) as operator,
        ):
            two.subscribe(keys.inbox(SWARM, 2), lambda _, payload: received.append(payload))
            two.serve(WEIGHTS, answer)
            try:
                # The end of a router is detected at once over TCP, and after the lease over QUIC.
                for _ in range(2 if protocol == "quic" else 3):
                    dropped = one.dropped
                    one.put(TO_TWO, b"lost")
                    assert one.dropped == dropped + 1
                    await asyncio.to_thread(router.start)
                    began_s = time.monotonic()
                    await until(
                        lambda: received, "a message after the restart", lambda: one.put(TO_TWO, b"again")
                    )
                    found_s.append(time.monotonic() - began_s)
                    await meet(operator)
                    await until_answered(operator, WEIGHTS, b"answer", within_s=5.0)
                    router.kill()
                    await until(lambda: one.links + two.links + operator.links == 0, "the end of the links")
                    received.clear()
                    await asyncio.sleep(2 * zenoh.CHECK_EVERY_S if lost_after_s == 0.0 else 0.0)
            finally:
                router.kill()
            assert b"lost" not in received
        return found_s

    found_s = asyncio.run(scene())
    say(f"{protocol}: heard again {', '.join(f'{s:.2f}' for s in found_s)} s after the router was up")
    assert max(found_s) < 4.0


@pytest.mark.full
@pytest.mark.parametrize("protocol", ["tcp", "tls", "quic"])
def test_a_frozen_router_blocks_no_put_and_counts_as_lost(protocol: str) -> None:
    async def scene() -> tuple[float, float, float]:
        with router_process(protocol) as router:
            one = ZenohBus(client_of(router.there, "uav1"))
            await meet(one)
            router.signal(signal.SIGSTOP)
            longest_s = 0.0
            froze_s = time.monotonic()
            while one.links:
                began_s = time.monotonic()
                one.put(TO_TWO, bytes(30_000))
                longest_s = max(longest_s, time.monotonic() - began_s)
                assert time.monotonic() - froze_s < 8.0
                await asyncio.sleep(0)
            given_up_s = time.monotonic() - froze_s
            began_s = time.monotonic()
            one.close()
            return longest_s, given_up_s, time.monotonic() - began_s

    longest_s, given_up_s, closing_s = asyncio.run(scene())
    say(f"{protocol}: put {longest_s * 1e3:.1f} ms, given up {given_up_s:.2f} s, close {closing_s:.2f} s")
    assert longest_s < 0.5
    assert closing_s < CLOSE_S + 1.0


def test_a_frozen_operator_does_not_block_the_loop() -> None:
    """The sender of a query decides whether answers may be dropped; otherwise the node would wait."""

    async def scene() -> float:
        asked = asyncio.Event()
        replies: list[Callable[[bytes], None]] = []

        def serve(key: str, payload: bytes | None, reply: Callable[[bytes], None]) -> None:
            replies.append(reply)
            asked.set()

        there = here("tcp")
        with ZenohBus(zenoh_config.whole_swarm(there, SWARM, (2,))) as bus:
            bus.serve(WEIGHTS, serve)
            asker = [sys.executable, "-c", FROZEN_OPERATOR, str(there), WEIGHTS]
            process = await asyncio.create_subprocess_exec(*asker)
            try:
                async with asyncio.timeout(8.0):
                    await asked.wait()
                await until(lambda: len(replies) == 20, "all queries")
                process.send_signal(signal.SIGSTOP)
                longest_s = 0.0
                for reply in replies:
                    began_s = time.monotonic()
                    reply(bytes(500_000))
                    longest_s = max(longest_s, time.monotonic() - began_s)
                return longest_s
            finally:
                process.kill()
                await process.wait()

    assert asyncio.run(scene()) < 0.3


FROZEN_OPERATOR = """\
import sys, time, zenoh
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", f'["{sys.argv[1]}"]')
config.insert_json5("scouting/multicast/enabled", "false")
session = zenoh.open(config)
kept = [session.get(sys.argv[2], timeout=30.0) for _ in range(20)]
time.sleep(30)
"""


def test_a_mesh_uses_a_returned_node_and_bypasses_a_lost_node() -> None:
    """uav1 and uav2 are connected through uav3 only; then uav2 also links to uav1."""

    async def scene() -> None:
        places = {uav: here("tcp") for uav in UAVS}

        def node(uav: int, *neighbours: int) -> ZenohBus:
            there = [places[neighbour] for neighbour in neighbours]
            return ZenohBus(zenoh_config.mesh_node(places[uav], there, SWARM, UAVS))

        with node(1, 3) as one, node(2, 3) as two:
            received: list[str] = []
            two.subscribe(keys.inbox(SWARM, 2), lambda key, _: received.append(key))
            for _ in range(2):
                received.clear()
                with node(3):
                    await until(lambda: received, "over two hops", lambda: one.put(TO_TWO, b""))
                await until(lambda: one.links + two.links == 0, "the end of the links")
                # No process restarts sooner. Zenoh's routers do not always find routes over a node that
                # returns within milliseconds, while the links to its predecessor are still closing.
                await asyncio.sleep(0.25)
        with node(1, 3, 2) as one, node(2, 3) as two:
            two.subscribe(keys.inbox(SWARM, 2), lambda key, _: received.append(key))
            with node(3) as three:
                await until(lambda: three.links == 2 and one.links == 2, "a ring")
                await until(lambda: received, "a message around the ring", lambda: one.put(TO_TWO, b""))
                await asyncio.sleep(0.2)
                received.clear()
                one.put(TO_TWO, b"")
                await until(lambda: received, "a message in the ring")
                await asyncio.sleep(0.2)
                assert len(received) == 1
            received.clear()
            await until(lambda: received, "a message past the lost node", lambda: one.put(TO_TWO, b""))

    asyncio.run(scene())


def test_a_mesh_node_with_a_link_and_no_routes_renews_its_session_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The other node has an older version without presence keys. The new session repeats all declarations."""
    monkeypatch.setattr(renewal, "MIN_ROUTE_WAIT_S", 0.3)
    monkeypatch.setattr(renewal, "MAX_ROUTE_WAIT_S", 0.3)
    monkeypatch.setattr(zenoh, "RENEWAL_PAUSE_S", 0.1)

    async def scene() -> None:
        one_is, two_is = here("tcp"), here("tcp")
        older = replace(zenoh_config.mesh_node(two_is, [], SWARM, UAVS), nodes="")
        came: list[bool] = []
        received: list[str] = []
        with (
            ZenohBus(older) as two,
            ZenohBus(
                zenoh_config.mesh_node(one_is, [two_is], SWARM, UAVS),
                on_link=lambda _address, _name, has_come: came.append(has_come),
            ) as one,
        ):
            one.subscribe(keys.inbox(SWARM, 1), lambda key, _: received.append(key))
            one.serve(keys.request(SWARM, "weights", 1), answer)
            await until(lambda: came.count(True) == 2, "the second session")
            key = keys.uav_message(SWARM, 1, "inform/state", 2)
            await until(lambda: received, "the message of uav2", lambda: two.put(key, b""))
            assert await two.ask(keys.request(SWARM, "weights", 1), b"", 5.0) == (b"answer",)
            await asyncio.sleep(0.7)
            assert came.count(True) == 2
            assert one.endpoint == one_is
            assert (one.links, two.links) == (1, 1)

    asyncio.run(scene())


@pytest.mark.full
def test_a_whole_mesh_keeps_its_sessions(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(renewal, "MIN_ROUTE_WAIT_S", 1.0)
    monkeypatch.setattr(renewal, "MAX_ROUTE_WAIT_S", 1.0)

    async def scene() -> None:
        places = {uav: here("tls") for uav in UAVS}
        came: list[bool] = []

        def node(uav: int, *neighbours: int) -> ZenohBus:
            there = [places[neighbour] for neighbour in neighbours]
            own = credentials("tls", f"uav{uav}")
            configuration = zenoh_config.mesh_node(places[uav], there, SWARM, UAVS, own)
            return ZenohBus(configuration, on_link=lambda _address, _name, has_come: came.append(has_come))

        with node(1) as one, node(2, 1) as two, node(3, 1, 2) as three:
            await until(lambda: one.links + two.links + three.links == 6, "all links")
            visitor = ZenohBus(zenoh_config.visitor(places[1], credentials("tls", "operator")))
            await asyncio.sleep(2.5)
            visitor.close()
            await until(lambda: False in came, "the visitor has left")
            assert (came.count(True), came.count(False)) == (7, 1)

    asyncio.run(scene())


# --- a process ends

PROCESS = """\
import asyncio, contextlib, signal, sys
from pathlib import Path
from swarmctl.bus.transports import process_exit, zenoh_config
from swarmctl.bus.endpoint import parse_endpoint
from swarmctl.bus.transports.zenoh import ZenohBus
from swarmctl.bus.transports.zenoh_config import Credentials
own = Credentials(*map(Path, sys.argv[3:])) if sys.argv[3:] else None

async def main():
    stopped = asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGINT, stopped.set)
    with ZenohBus(zenoh_config.client(parse_endpoint(sys.argv[1]), own)) as bus:
        bus.subscribe("swarmctl/test/uav/1/**", print)
        bus.serve("swarmctl/test/uav/1/request/weights/operator", print)
        asked = asyncio.ensure_future(bus.ask("swarmctl/test/uav/1/inform/look/sensor", b"", 60.0))
        while sys.argv[2] == "connected" and not bus.connected:
            await asyncio.sleep(0.01)
        print("ready", flush=True)
        while not stopped.is_set():
            bus.put("swarmctl/test/uav/2/inform/state/1", bytes(40_000))
            await asyncio.sleep(0)
        asked.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await asked

asyncio.run(main())
process_exit.exit_process(0)
"""
STATES = ("connecting", "connected", "router dead", "router frozen", "router frozen long")


@pytest.mark.full
@pytest.mark.parametrize("protocol", ["tcp", "tls", "quic"])
@pytest.mark.parametrize("state", STATES)
def test_a_process_ends_on_ctrl_c_in_any_state_of_its_link(state: str, protocol: str) -> None:
    own = credentials(protocol, "uav1")
    paths = [] if own is None else [str(own.ca), str(own.certificate), str(own.key)]

    def started(there: BusEndpoint) -> subprocess.Popen[str]:
        state_before_ready = "connecting" if state == "connecting" else "connected"
        command = [sys.executable, "-c", PROCESS, str(there), state_before_ready, *paths]
        return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    with router_process(protocol) as router:
        if state == "connecting":
            router.kill()
        with started(router.there) as process:
            try:
                assert process.stdout is not None
                assert process.stdout.readline() == "ready\n"
                if state == "router dead":
                    router.kill()
                if state.startswith("router frozen"):
                    router.signal(signal.SIGSTOP)
                # The queues fill, and in one case the link is lost.
                time.sleep(2.5 if state.endswith("long") else 0.3)
                process.send_signal(signal.SIGINT)
                began_s = time.monotonic()
                _, errors = process.communicate(timeout=CLOSE_S + 3.0)
                say(f"{protocol}, {state}: ended after {time.monotonic() - began_s:.2f} s")
                assert (process.returncode, errors) == (0, "")
            finally:
                process.kill()


@pytest.mark.full
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_router_without_clients_ends_on_a_signal(number: signal.Signals) -> None:
    with router_process("tls") as router:
        router.signal(number)
        assert router.ended() == 0
