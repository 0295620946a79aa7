"""Access rules on the wire: in each row a node tries a forbidden action."""

from __future__ import annotations

import asyncio
import datetime as dt
import json
import shutil
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, ExitStack, asynccontextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import zenoh
from zenoh_nodes import (
    NOW,
    SWARM,
    UAVS,
    client_of,
    credentials,
    here,
    keys_folder,
    meet,
    router_at,
    until,
    until_answered,
)

from swarmctl.bus import keys
from swarmctl.bus.endpoint import BusEndpoint
from swarmctl.bus.transports import zenoh_config
from swarmctl.bus.transports.base import MAX_MESSAGE_BYTES
from swarmctl.bus.transports.zenoh import ZenohBus
from swarmctl.bus.transports.zenoh_config import Configuration, Credentials
from swarmctl.core.records import replace
from swarmctl.security import issue as making
from swarmctl.security.issue import make_keys

pytestmark = pytest.mark.interop
ROOT = f"swarmctl/{SWARM}"
CERTIFIED = ("tls", "quic")


@dataclass(slots=True)
class Net:
    """A star with two vehicles, a ground station and their received messages; a third vehicle misbehaves."""

    there: BusEndpoint
    router: ZenohBus
    one: ZenohBus
    two: ZenohBus
    station: ZenohBus
    received: dict[str, list[str]] = field(default_factory=dict)
    asked: list[str] = field(default_factory=list)

    async def check_received_only(self, *expected: str) -> None:
        """Check that only `expected` arrived beside a last message of uav2.

        By the time of that message, earlier messages on other links have been processed.
        """
        own_key = keys.uav_message(SWARM, 1, "inform/state", 2)
        self.received["one"].clear()
        await until(
            lambda: own_key in self.received["one"], "the message of uav2", lambda: self.two.put(own_key, b"")
        )
        await asyncio.sleep(0.1)
        elsewhere = {key for received in self.received.values() for key in received} - {own_key}
        assert elsewhere == set(expected)


def _note(received: list[str], key: str, _payload: bytes) -> None:
    received.append(key)


@asynccontextmanager
async def network(protocol: str) -> AsyncIterator[Net]:
    there = here(protocol)
    with ExitStack() as stack:
        router = stack.enter_context(ZenohBus(router_at(there)))
        one, two, station = (
            stack.enter_context(ZenohBus(client_of(there, name))) for name in ("uav1", "uav2", "operator")
        )
        net = Net(there, router, one, two, station)
        for name, bus, expression in (
            ("one", one, keys.inbox(SWARM, 1)),
            ("two", two, keys.inbox(SWARM, 2)),
            ("station", station, f"{ROOT}/station/**"),
        ):
            received = net.received.setdefault(name, [])
            bus.subscribe(expression, partial(_note, received))

        def serve(key: str, payload: bytes | None, reply: Callable[[bytes], None]) -> None:
            net.asked.append(key)
            reply(b"answer")

        one.serve(keys.request(SWARM, "weights", 1), serve)
        one.serve(keys.sensor_report(SWARM, 1), serve)
        await meet(one, two, station)
        yield net


def raw(configuration: Configuration) -> zenoh.Session:
    """Return a raw Zenoh session without the checks of `ZenohBus`."""
    values = json.loads(configuration.as_json5())
    values["transport"]["link"]["rx"]["max_message_size"] = 1 << 20
    return zenoh.open(zenoh.Config.from_json5(json.dumps(values)))


# --- access to the network


def changed(configuration: Configuration, **tls: Any) -> Configuration:
    values = dict(configuration.values)
    values["transport/link/tls"] = values["transport/link/tls"] | tls
    return replace(configuration, values=values)


def without_certificate(there: BusEndpoint, _: Path) -> Configuration:
    return changed(client_of(there, "uav3"), connect_certificate=None, connect_private_key=None)


def of_another_authority(there: BusEndpoint, folder: Path) -> Configuration:
    make_keys(folder, ["uav3"], 5, NOW)
    own = keys_folder() / "uav3" / "ca.pem"
    stranger = folder / "uav3"
    # The client trusts the router's authority, so the router refuses the connection.
    return zenoh_config.client(there, Credentials(own, stranger / "cert.pem", stranger / "key.pem"))


def issued(folder: Path, name: str, at: dt.datetime) -> Credentials:
    """Return a certificate that the swarm's own authority issues for five days."""
    shutil.copytree(keys_folder() / making.AUTHORITY, folder / making.AUTHORITY)
    make_keys(folder, [name], 5, at)
    own = folder / name
    return Credentials(own / "ca.pem", own / "cert.pem", own / "key.pem")


def expired(there: BusEndpoint, folder: Path) -> Configuration:
    return zenoh_config.client(there, issued(folder, "uav3", NOW - dt.timedelta(days=6)))


def of_another_machine(there: BusEndpoint, _: Path) -> Configuration:
    """The client, not the router, refuses: the router's certificate names other machines."""
    return client_of(replace(there, host="127.0.0.2"), "uav3")


@pytest.mark.full
@pytest.mark.parametrize("protocol", CERTIFIED)
@pytest.mark.parametrize("stranger", [without_certificate, of_another_authority, expired, of_another_machine])
def test_a_process_without_a_certificate_gets_no_access(
    stranger: Callable[[BusEndpoint, Path], Configuration], protocol: str, tmp_path: Path
) -> None:
    async def scene() -> None:
        there = here(protocol)
        listening = replace(there, host="0.0.0.0")
        with (
            ZenohBus(router_at(listening)) as router,
            ZenohBus(stranger(there, tmp_path)) as bus,
            ZenohBus(client_of(there, "uav1")) as honest,
        ):
            await meet(honest)
            # The client has tried several times by now.
            await asyncio.sleep(0.5)
            assert (bus.connected, honest.connected, router.links) == (False, True, 1)

    asyncio.run(scene())


@pytest.mark.parametrize("protocol", CERTIFIED)
def test_a_foreign_certificate_has_no_rights(protocol: str, tmp_path: Path) -> None:
    nine = issued(tmp_path, "uav9", NOW)

    async def scene() -> None:
        async with network(protocol) as net:
            with ZenohBus(zenoh_config.client(net.there, nine)) as stranger:
                received: list[str] = []
                stranger.subscribe("**", lambda key, _: received.append(key))
                await meet(stranger)
                for sender in (1, 2, 9):
                    stranger.put(keys.uav_message(SWARM, 1, "inform/state", sender), b"")
                    stranger.put(keys.to_station(SWARM, sender), b"")
                assert await stranger.ask(keys.request(SWARM, "weights", 1), b"", 1.0) == ()
                await net.check_received_only()
                assert [key for key in received if not key.endswith("/9")] == [
                    key for key in received if key.endswith(("state/1", "state/2")) and "/2/" not in key
                ]
                assert net.asked == []

    asyncio.run(scene())


# --- keys that a vehicle may put

TO_ONE = keys.uav_message(SWARM, 1, "inform/state", 3)
PUTS: dict[str, str] = {
    "to every vehicle by a wildcard": f"{ROOT}/uav/*/inform/state/3",
    "to some vehicles by a wildcard": f"{ROOT}/uav/$*1/inform/state/3",
    "to all receivers by a wildcard": f"{ROOT}/**/3",
    "to any key": "**",
    "from all senders by a wildcard": f"{ROOT}/uav/1/inform/state/*",
    "any message to one vehicle by a wildcard": f"{ROOT}/uav/1/**",
    "in the name of another vehicle": keys.uav_message(SWARM, 1, "inform/state", 2),
    "in the name of another vehicle, to the station": keys.to_station(SWARM, 2),
    "in its own name, below another key": f"{ROOT}/uav/1/inform/state/2/3",
    "as the operator": keys.request(SWARM, "weights", 1),
    "as the payload of another vehicle": keys.sensor_report(SWARM, 1),
    "to another swarm": keys.uav_message("other", 1, "inform/state", 3),
}


@pytest.mark.parametrize("protocol", CERTIFIED)
def test_a_vehicle_can_put_only_its_own_keys(protocol: str) -> None:
    async def scene() -> None:
        async with network(protocol) as net:
            other: list[str] = []
            net.one.subscribe("swarmctl/other/**", lambda key, _: other.append(key))
            with ZenohBus(client_of(net.there, "uav3")) as three:
                await meet(three)
                for what, key in PUTS.items():
                    for received in net.received.values():
                        received.clear()
                    three.put(key, what.encode())
                    await until(
                        lambda: TO_ONE in net.received["one"],
                        "the message of uav3",
                        lambda: three.put(TO_ONE, b""),
                    )
                    assert {key for received in net.received.values() for key in received} == {TO_ONE}, what
                assert other == []

    asyncio.run(scene())


def test_wildcards_and_other_swarms_are_blocked_without_certificates() -> None:
    async def scene() -> None:
        async with network("tcp") as net:
            with ZenohBus(client_of(net.there, "uav3")) as three:
                await meet(three)
                for key in (
                    f"{ROOT}/uav/*/inform/state/3",
                    f"{ROOT}/**",
                    "**",
                    "swarmctl/*/uav/1/inform/state/3",
                ):
                    three.put(key, b"")
                await until(lambda: TO_ONE in net.received["one"], "uav3", lambda: three.put(TO_ONE, b""))
                assert {key for received in net.received.values() for key in received} == {TO_ONE}

    asyncio.run(scene())


# --- keys that a vehicle may receive and query


@pytest.mark.parametrize("protocol", CERTIFIED)
@pytest.mark.parametrize("expression", [keys.inbox(SWARM, 1), f"{ROOT}/**", "**", f"{ROOT}/station/**"])
def test_a_vehicle_receives_only_its_own_messages(expression: str, protocol: str) -> None:
    async def scene() -> None:
        async with network(protocol) as net:
            with ZenohBus(client_of(net.there, "uav3")) as three:
                overheard: list[str] = []
                own: list[str] = []
                three.subscribe(expression, lambda key, _: overheard.append(key))
                three.subscribe(keys.inbox(SWARM, 3), lambda key, _: own.append(key))
                await meet(three)
                for_three = keys.uav_message(SWARM, 3, "inform/state", 2)

                def say() -> None:
                    net.two.put(keys.uav_message(SWARM, 1, "inform/state", 2), b"")
                    net.two.put(keys.to_station(SWARM, 2), b"")
                    net.two.put(for_three, b"")

                await until(
                    lambda: own and net.received["one"] and net.received["station"],
                    "all other receivers",
                    say,
                )
                assert set(own) == {for_three}
                assert set(overheard) <= {for_three}

    asyncio.run(scene())


@pytest.mark.parametrize("protocol", CERTIFIED)
def test_operators_get_answers_to_commands_and_payloads_to_reports(
    protocol: str,
) -> None:
    async def scene() -> None:
        async with network(protocol) as net:
            weights, look = keys.request(SWARM, "weights", 1), keys.sensor_report(SWARM, 1)
            with (
                ZenohBus(client_of(net.there, "uav3")) as three,
                ZenohBus(client_of(net.there, "uav1")) as payload,
            ):
                await meet(three, payload)
                for key in (weights, look, f"{ROOT}/uav/*/request/weights/operator", f"{ROOT}/**"):
                    assert await three.ask(key, b"", 1.0) == (), key
                assert net.asked == []
                assert await net.station.ask(weights, b"", 5.0) == (b"answer",)
                assert await net.station.ask(look, b"", 5.0) == (b"answer",)
                assert await payload.ask(look, b"", 5.0) == (b"answer",)
                assert await payload.ask(weights, b"", 1.0) == ()
                assert net.asked == [weights, look, look]
                payload.put(look, b"")
                await until(lambda: look in net.received["one"], "the payload's look")

    asyncio.run(scene())


@pytest.mark.parametrize("protocol", CERTIFIED)
def test_a_vehicle_does_not_receive_commands_for_another(protocol: str) -> None:
    async def scene() -> None:
        async with network(protocol) as net:
            weights, own = keys.request(SWARM, "weights", 1), keys.request(SWARM, "weights", 3)
            asked: list[str] = []

            def serve(key: str, payload: bytes | None, reply: Callable[[bytes], None]) -> None:
                asked.append(key)
                reply(b"of uav3")

            with ZenohBus(client_of(net.there, "uav3")) as three:
                for key in (weights, own):
                    three.serve(key, serve)
                await meet(three)
                await until_answered(net.station, own, b"of uav3")
                assert await net.station.ask(weights, b"", 5.0) == (b"answer",)
                assert (asked, net.asked) == ([own], [weights])

    asyncio.run(scene())


@pytest.mark.parametrize("protocol", ["tcp", "tls", "quic"])
def test_an_oversized_message_reaches_no_receiver_and_is_counted(protocol: str) -> None:
    async def scene() -> None:
        async with network(protocol) as net:
            session = raw(client_of(net.there, "uav3"))
            try:
                # The first message fits the links, the second does not.
                for size in (MAX_MESSAGE_BYTES + 1, 4 * MAX_MESSAGE_BYTES):
                    session.put(TO_ONE, bytes(size))
                await until(lambda: net.one.dropped, "the count of the first message")
                assert net.received["one"] == []
                await until(
                    lambda: net.received["one"],
                    "short messages after that",
                    lambda: session.put(TO_ONE, b"short"),
                )
                assert net.one.dropped == 1
            finally:
                session.close()  # type: ignore[no-untyped-call]

    asyncio.run(scene())


# --- a mesh


def test_a_mesh_relays_the_swarms_keys_for_its_certificates_only(tmp_path: Path) -> None:
    make_keys(tmp_path, ["uav3"], 5, NOW)
    forged = tmp_path / "uav3"
    foreign = Credentials(keys_folder() / "uav3" / "ca.pem", forged / "cert.pem", forged / "key.pem")

    async def scene() -> None:
        places = {uav: here("tls") for uav in UAVS}

        def node(uav: int, own: Credentials | None, *neighbours: int) -> ZenohBus:
            there = [places[neighbour] for neighbour in neighbours]
            return ZenohBus(zenoh_config.mesh_node(places[uav], there, SWARM, UAVS, own))

        with (
            node(1, credentials("tls", "uav1")) as one,
            node(2, credentials("tls", "uav2"), 1) as two,
            node(3, foreign, 1, 2) as three,
        ):
            received: list[str] = []
            for expression in (keys.inbox(SWARM, 1), "swarmctl/other/**", "elsewhere", "**"):
                one.subscribe(expression, lambda key, _: received.append(key))
            await meet(one, two)
            own_key = keys.uav_message(SWARM, 1, "inform/state", 2)

            def say() -> None:
                for key in (own_key, "swarmctl/other/uav/1/inform/state/2", "elsewhere", "**"):
                    two.put(key, b"")

            # The first messages may come before the other subscriptions are known.
            await until(lambda: len(received) >= 30, "the neighbour", say)
            assert set(received) == {own_key}
            assert (one.links, two.links, three.links) == (1, 1, 0)

    asyncio.run(scene())


@asynccontextmanager
async def meshed(protocol: str) -> AsyncIterator[tuple[dict[int, BusEndpoint], dict[int, ZenohBus]]]:
    """Three vehicles' nodes in a row, 1 - 2 - 3."""
    places = {uav: here(protocol) for uav in UAVS}
    with ExitStack() as stack:
        nodes = {}
        for uav in UAVS:
            there = [places[uav - 1]] if uav > 1 else []
            own = credentials(protocol, f"uav{uav}")
            configuration = zenoh_config.mesh_node(places[uav], there, SWARM, UAVS, own)
            nodes[uav] = stack.enter_context(ZenohBus(configuration))
        await meet(*nodes.values())
        yield places, nodes


def answers(text: bytes) -> Callable[[str, bytes | None, Callable[[bytes], None]], None]:
    return lambda _key, _payload, reply: reply(text)


@pytest.mark.parametrize("protocol", ["tcp", "tls"])
def test_mesh_nodes_do_not_relay_reports(protocol: str) -> None:
    """A report has no signature; only the vehicle's own node accepts it, by certificate."""

    async def scene() -> None:
        async with meshed(protocol) as (places, nodes), AsyncExitStack() as stack:
            received: list[bytes] = []
            look, request = keys.sensor_report(SWARM, 1), keys.request(SWARM, "order", 1)
            nodes[1].subscribe(keys.inbox(SWARM, 1), lambda _, payload: received.append(payload))
            nodes[1].serve(look, answers(b"taken"))
            nodes[1].serve(request, answers(b"ordered"))

            def client(at: int, name: str) -> ZenohBus:
                return stack.enter_context(ZenohBus(client_of(places[at], name)))

            payload, operator = client(1, "uav1"), client(1, "operator")
            strangers = {"uav3's own node": nodes[3], "the neighbour of uav1": nodes[2]}
            strangers |= {"uav1's payload at another node": client(2, "uav1")}
            strangers |= {"an operator at another node": client(3, "operator")}
            if protocol == "tls":
                strangers |= {"uav3 at uav1's node": client(1, "uav3")}
            await meet(payload, operator, *strangers.values())
            own_key = keys.uav_message(SWARM, 1, "inform/state", 3)
            await until(lambda: b"far" in received, "the far end", lambda: nodes[3].put(own_key, b"far"))
            far = strangers["an operator at another node"]
            await until_answered(far, request, b"ordered")
            for who, bus in strangers.items():
                assert await bus.ask(look, b"", 2.0) == (), who
                bus.put(look, who.encode())
            for bus in (payload, operator):
                await until_answered(bus, look, b"taken")
            await until(lambda: b"own" in received, "the payload's", lambda: payload.put(look, b"own"))
            await until(lambda: b"by hand" in received, "a person's", lambda: operator.put(look, b"by hand"))
            assert set(received) == {b"far", b"own", b"by hand"}

    asyncio.run(scene())


def test_a_forged_answer_does_not_hide_the_true_answer() -> None:
    """In a mesh any node may serve any key. The sender of the query gets all answers with their authors."""

    async def scene() -> None:
        async with meshed("tls") as (places, nodes):
            key = keys.request(SWARM, "order", 1)
            nodes[1].serve(key, answers(b"uav1's"))
            session = raw(zenoh_config.client(places[3], credentials("tls", "uav3")))
            try:
                for _ in range(2):
                    session.declare_queryable(key, lambda q: q.reply(key, b"forged"), complete=True)
                with ZenohBus(client_of(places[3], "operator")) as operator:
                    await meet(operator)
                    async with asyncio.timeout(8.0):
                        replies: list[bytes] = []
                        while replies != [b"forged", b"forged", b"uav1's"]:
                            replies = sorted(await operator.ask(key, b"", 5.0))
            finally:
                session.close()  # type: ignore[no-untyped-call]

    asyncio.run(scene())
