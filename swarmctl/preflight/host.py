"""Checks of this computer: ports, devices, hosts and folders that a configuration needs. Starts nothing."""

from __future__ import annotations

import contextlib
import errno
import os
import socket
from collections.abc import Iterator
from pathlib import Path

from swarmctl.bus.endpoint import NO_ENDPOINT, parse_endpoint
from swarmctl.bus.transports import BUSES
from swarmctl.config.communication import Communication
from swarmctl.config.scenario import Scenario
from swarmctl.links.url import Endpoint, parse_url


def troubles(scenario: Scenario, runs: Path) -> Iterator[str]:
    """Yield a line for each problem that would stop a flight."""
    endpoints: dict[Endpoint, str] = {}
    for spec in scenario.specs:
        endpoints.setdefault(parse_url(spec.url), spec.name)
    # All ports are bound at the same time: 0.0.0.0 and 127.0.0.1 exclude each other on the same port.
    with contextlib.ExitStack() as sockets:
        for endpoint, name in endpoints.items():
            yield from _endpoint_trouble(endpoint, name, sockets)
        yield from _listen_trouble(scenario.config.communication, sockets)
    yield from _folder_trouble(runs)


def _endpoint_trouble(endpoint: Endpoint, name: str, sockets: contextlib.ExitStack) -> Iterator[str]:
    if endpoint.kind == "serial":
        if not Path(endpoint.host).exists():
            yield f"{name}: {endpoint}: device {endpoint.host} does not exist; plug the radio in [no-device]"
    elif endpoint.listens:
        kind = socket.SOCK_DGRAM if endpoint.kind == "udpin" else socket.SOCK_STREAM
        if problem := _bind_problem(endpoint.host, endpoint.port, kind, sockets):
            yield f"{name}: {endpoint}: {problem}"
    elif endpoint.kind in ("udpout", "tcpout"):
        try:
            socket.getaddrinfo(endpoint.host, endpoint.port)
        except OSError as error:
            yield f"{name}: {endpoint}: the host is unknown ({error.strerror or error}); correct the url"


def _listen_trouble(communication: Communication, sockets: contextlib.ExitStack) -> Iterator[str]:
    if not BUSES[communication.bus].is_networked or communication.listen == NO_ENDPOINT:
        return
    endpoint = parse_endpoint(communication.listen)
    if problem := _bind_problem(endpoint.host, endpoint.port, socket.SOCK_STREAM, sockets):
        yield f"communication.listen: {endpoint}: {problem}"


def _bind_problem(host: str, port: int, kind: socket.SocketKind, sockets: contextlib.ExitStack) -> str:
    """Listen as long as `sockets` is open; return the reason as text if this fails, else an empty text."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    probe = sockets.enter_context(contextlib.closing(socket.socket(family, kind)))
    if kind is socket.SOCK_STREAM:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as a server does
    try:
        probe.bind((host, port))
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            return f"port {port} is in use; stop the other program, or give another port (0: any free port)"
        return f"cannot listen here: {error.strerror or error}; give an address of this machine"
    return ""


def _folder_trouble(runs: Path) -> Iterator[str]:
    nearest = next(folder for folder in (runs, *runs.absolute().parents) if folder.exists())
    if not (nearest.is_dir() and os.access(nearest, os.W_OK | os.X_OK)):
        cause = f"{nearest} is not a writable folder"
        yield f"the run folder {runs} cannot be created or written: {cause}; give another folder by --out"
