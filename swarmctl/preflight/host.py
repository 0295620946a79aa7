"""Checks of this computer: ports, devices, hosts and folders that a configuration needs. Starts nothing."""

from __future__ import annotations

import contextlib
import errno
import os
import socket
from collections.abc import Iterator
from pathlib import Path

from swarmctl.bus.endpoint import parse_endpoint
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
        family = socket.AF_INET6 if ":" in endpoint.host else socket.AF_INET
        probe = sockets.enter_context(contextlib.closing(socket.socket(family, kind)))
        if kind is socket.SOCK_STREAM:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as a server does
        try:
            probe.bind((endpoint.host, endpoint.port))
        except OSError as error:
            yield f"{name}: {endpoint}: {_bind_problem(endpoint, error)}"
    elif endpoint.kind in ("udpout", "tcpout"):
        try:
            socket.getaddrinfo(endpoint.host, endpoint.port)
        except OSError as error:
            yield f"{name}: {endpoint}: the host is unknown ({error.strerror or error}); correct the url"


def _listen_trouble(communication: Communication, sockets: contextlib.ExitStack) -> Iterator[str]:
    if not BUSES[communication.bus].is_networked or communication.listen == "none":
        return
    endpoint = parse_endpoint(communication.listen)
    probe = sockets.enter_context(contextlib.closing(_stream_socket(endpoint.host)))
    try:
        probe.bind((endpoint.host, endpoint.port))
    except OSError as error:
        port_in_use = (
            f"port {endpoint.port} is in use; stop the other program, or give another port (0: any free port)"
        )
        other = f"{error.strerror or error}; give an address of this machine"
        yield f"communication.listen: {endpoint}: {port_in_use if error.errno == errno.EADDRINUSE else other}"


def _stream_socket(host: str) -> socket.socket:
    stream = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_STREAM)
    stream.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as a server does
    return stream


def _bind_problem(endpoint: Endpoint, error: OSError) -> str:
    if error.errno == errno.EADDRINUSE:
        return f"port {endpoint.port} is in use; stop the other ground station, or give another port"
    return f"cannot listen here: {error.strerror or error}; give an address of this machine"


def _folder_trouble(runs: Path) -> Iterator[str]:
    nearest = next(folder for folder in (runs, *runs.absolute().parents) if folder.exists())
    if not (nearest.is_dir() and os.access(nearest, os.W_OK | os.X_OK)):
        cause = f"{nearest} is not a writable folder"
        yield f"the run folder {runs} cannot be created or written: {cause}; give another folder by --out"
