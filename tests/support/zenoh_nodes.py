"""Participants of a swarm's network for tests: keys, routers, and waits for events of the network."""

from __future__ import annotations

import asyncio
import contextlib
import datetime as dt
import functools
import os
import secrets
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

from swarmctl.bus.endpoint import BusEndpoint
from swarmctl.bus.transports import zenoh_config
from swarmctl.bus.transports.zenoh import ZenohBus
from swarmctl.bus.transports.zenoh_config import Configuration, Credentials
from swarmctl.security.issue import make_keys
from swarmctl.security.participant import load_keyring

SWARM = "test"
UAVS = (1, 2, 3)
NAMES = ("uav1", "uav2", "uav3", "operator", "router")
NOW = dt.datetime.now(dt.UTC)


@functools.cache
def _keys() -> tuple[tempfile.TemporaryDirectory[str], Path]:
    folder = tempfile.TemporaryDirectory()
    # The authority is older than all its certificates, including expired ones.
    make_keys(Path(folder.name), [], 5, NOW - dt.timedelta(days=10))
    make_keys(Path(folder.name), NAMES, 5, NOW)
    return folder, Path(folder.name)


def credentials(protocol: str, name: str) -> Credentials | None:
    """Return credentials of the swarm's own authority; over tcp there are none."""
    return None if protocol == "tcp" else load_keyring(_keys()[1], name, NOW).credentials


def keys_folder() -> Path:
    return _keys()[1]


_reserved: list[socket.socket] = []


def free_port() -> int:
    """Return a port that no other process gets before this one ends.

    A bound socket reserves it. Listeners share an address with it because both allow that.
    The port is free for streams and datagrams: quic listens for datagrams.
    """
    while True:
        port = secrets.choice(range(20_000, 32_000))
        stream = socket.socket()
        with (
            contextlib.suppress(OSError),
            contextlib.closing(socket.socket(type=socket.SOCK_DGRAM)) as datagrams,
        ):
            datagrams.bind(("127.0.0.1", port))
            stream.bind(("127.0.0.1", port))
            # After the bind, which fails beside a reservation of another process.
            stream.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            _reserved.append(stream)
            return port
        stream.close()


def here(protocol: str) -> BusEndpoint:
    return BusEndpoint("127.0.0.1", free_port(), protocol)


def router_at(there: BusEndpoint) -> Configuration:
    return zenoh_config.router(there, SWARM, UAVS, credentials(there.protocol, "router"))


def client_of(there: BusEndpoint, name: str) -> Configuration:
    return zenoh_config.client(there, credentials(there.protocol, name))


async def until(true: Callable[[], object], what: str, again: Callable[[], object] | None = None) -> None:
    """Wait for an effect of another thread or process; call `again` meanwhile."""
    try:
        async with asyncio.timeout(8.0):
            while not true():
                if again is not None:
                    again()
                await asyncio.sleep(0.01)
    except TimeoutError:
        raise AssertionError(f"not within 8 s: {what}") from None


async def meet(*buses: ZenohBus) -> None:
    await until(lambda: all(bus.connected for bus in buses), "all have a link")


async def until_answered(bus: ZenohBus, key: str, answer: bytes, within_s: float = 8.0) -> None:
    """Wait until `answer` is the one answer under a key; a declaration takes longer than its link."""
    async with asyncio.timeout(within_s):
        while await bus.ask(key, b"", 5.0) != (answer,):  # noqa: ASYNC110 - another process's
            await asyncio.sleep(0.05)


ROUTER = """\
import asyncio, sys
from pathlib import Path
from swarmctl.station import router
from swarmctl.bus.transports import zenoh_config
from swarmctl.bus.endpoint import parse_endpoint
from swarmctl.bus.transports.zenoh_config import Credentials
endpoint, swarm, uavs, *paths = sys.argv[1:]
credentials = Credentials(*map(Path, paths)) if paths else None
uavs = [int(uav) for uav in uavs.split(",")]
configuration = zenoh_config.router(parse_endpoint(endpoint), swarm, uavs, credentials)
asyncio.run(router.run(configuration, lambda text: print(text, flush=True)))
"""


class RouterProcess:
    """A router in its own process; a test can kill, freeze and restart it at the same endpoint."""

    def __init__(self, there: BusEndpoint) -> None:
        self.there = there
        self._process: subprocess.Popen[str] | None = None

    def start(self) -> None:
        own = credentials(self.there.protocol, "router")
        paths = [] if own is None else [str(own.ca), str(own.certificate), str(own.key)]
        uavs = ",".join(map(str, UAVS))
        self._process = subprocess.Popen(
            [sys.executable, "-c", ROUTER, str(self.there), SWARM, uavs, *paths],
            stdout=subprocess.PIPE,
            text=True,
            env=os.environ | {"PYTHONUNBUFFERED": "1"},
        )
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        assert line == f"listening at {self.there}\n", line

    def signal(self, number: signal.Signals) -> None:
        assert self._process is not None
        self._process.send_signal(number)

    def kill(self) -> None:
        if self._process is None:
            return
        self._process.kill()
        self._process.wait()
        assert self._process.stdout is not None
        self._process.stdout.close()
        self._process = None

    def ended(self) -> int:
        """Wait for the end of the process and return its exit code."""
        assert self._process is not None
        return self._process.wait(8.0)


@contextlib.contextmanager
def router_process(protocol: str) -> Iterator[RouterProcess]:
    router = RouterProcess(here(protocol))
    router.start()
    try:
        yield router
    finally:
        router.kill()
