"""How a process joins its swarm's network, by the section `communication` of a configuration."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping
from pathlib import Path
from typing import Protocol

from swarmctl.bus.endpoint import BusEndpoint, parse_endpoint
from swarmctl.bus.transports import zenoh_config
from swarmctl.bus.transports.zenoh_config import Configuration, Credentials
from swarmctl.config.communication import Communication
from swarmctl.config.mesh import mesh_endpoints
from swarmctl.security.participant import Keyring, load


class Swarm(Protocol):
    """What is asked of a configuration here: one that is flown, or a `Roll`."""

    @property
    def name(self) -> str: ...

    @property
    def communication(self) -> Communication: ...


class NoNetwork(ValueError):
    """The configuration does not say how; the text says what to add."""


def keyring_of(swarm: Swarm, name: str, now: dt.datetime) -> Keyring | None:
    """The keys of `uav3` or `operator`; None where communication.keys is not set. Raises KeyringError."""
    folder = swarm.communication.keys
    return None if folder is None else load(Path(folder), name, now)


def as_agent(
    swarm: Swarm, uav: int, names: Mapping[int, str], connect: str | None, keyring: Keyring | None
) -> Configuration:
    """For the agent of vehicle `uav` of `names` (system id: name); `connect` is a router instead of the
    configuration's.

    Raises NoNetwork.
    """
    if (router := _router(swarm, connect)) is not None:
        return zenoh_config.client(router, certified(router, keyring))
    mesh = _mesh(swarm, names)
    if not mesh:
        raise NoNetwork("`communication` has neither router nor mesh, so agents do not find each other")
    if uav not in mesh:
        raise NoNetwork(f"communication.mesh does not say where {names[uav]} listens: add it")
    here = mesh[uav]
    # One of each two connects: with two links between two nodes, the end of one may go unnoticed.
    others = [endpoint for other, endpoint in mesh.items() if other < uav]
    return zenoh_config.mesh_node(here, others, swarm.name, [*names], certified(here, keyring))


def as_watcher(
    swarm: Swarm, names: Mapping[int, str], connect: str | None, keyring: Keyring | None
) -> Configuration:
    """For a ground station that stays: of a mesh it is a node that listens to this machine only.

    Raises NoNetwork.
    """
    if (router := _router(swarm, connect)) is not None:
        return zenoh_config.client(router, certified(router, keyring))
    nodes = [*_mesh(swarm, names).values()]
    if not nodes:
        raise NoNetwork("`communication` has neither router nor mesh: there is nothing to watch at")
    here = BusEndpoint("127.0.0.1", 0, nodes[0].protocol)
    return zenoh_config.mesh_node(here, nodes, swarm.name, [*names], certified(here, keyring))


def not_reached(network: Configuration) -> str:
    """What to look at where nobody of a network is reached.

    Zenoh says the same ("Timeout!") of a machine that is not there and of one that refuses our certificate,
    or shows one that we refuse.
    """
    if not any(endpoint.is_certified for endpoint in network.connect):
        return "does anybody run there, and does a firewall let us through?"
    return (
        "does anybody run there, does a firewall let us through, and are its keys and ours of one authority? "
        "ca.pem has to be the same on both machines: copy the folders of one run of `swarmctl keys` to all"
    )


def certified(endpoint: BusEndpoint, keyring: Keyring | None) -> Credentials | None:
    """What is shown at an endpoint; nothing over plain TCP. Raises NoNetwork where it is missing."""
    if not endpoint.is_certified:
        return None
    if keyring is None:
        raise NoNetwork(f"{endpoint} needs certificates: set communication.keys (`swarmctl keys` makes them)")
    return keyring.credentials


def _mesh(swarm: Swarm, names: Mapping[int, str]) -> dict[int, BusEndpoint]:
    try:
        return mesh_endpoints(swarm.communication.mesh, names)
    except ValueError as error:
        raise NoNetwork(f"communication.mesh: {error}") from None


def _router(swarm: Swarm, connect: str | None) -> BusEndpoint | None:
    if connect is None:
        return None if swarm.communication.router is None else parse_endpoint(swarm.communication.router)
    try:
        return parse_endpoint(connect)
    except ValueError as error:
        raise NoNetwork(f"--connect: {error}") from None
