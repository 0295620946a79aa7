"""The network of a process, by the section `communication`: client of a router, or node of a mesh."""

from __future__ import annotations

import datetime as dt
from pathlib import Path

from swarmctl.bus.endpoint import BusEndpoint, parse_endpoint
from swarmctl.bus.transports import zenoh_config
from swarmctl.bus.transports.zenoh_config import Configuration, Credentials
from swarmctl.config.communication import mesh_endpoints
from swarmctl.config.roster import Roster
from swarmctl.security.participant import Keyring, load_keyring


class NoNetwork(ValueError):
    """No network for this process; the text names the missing or wrong setting."""


def keyring_of(swarm: Roster, name: str, now: dt.datetime) -> Keyring | None:
    """Return the keys of `name` (`uav3`, `operator`); None if no keys are configured. Raises KeyringError."""
    folder = swarm.communication.keys
    return None if folder is None else load_keyring(Path(folder), name, now)


def as_agent(swarm: Roster, uav: int, connect: str | None, keyring: Keyring | None) -> Configuration:
    """Return the network of the agent of vehicle `uav`.

    `connect` replaces `communication.router`. Raises NoNetwork.
    """
    if (router := _router(swarm, connect)) is not None:
        return zenoh_config.client(router, credentials_for(router, keyring))
    mesh = _mesh(swarm)
    if not mesh:
        raise NoNetwork(
            "`communication` has neither router nor mesh, so agents cannot connect; add a router or a mesh "
            "[no-network]"
        )
    if uav not in mesh:
        raise NoNetwork(f"communication.mesh has no endpoint for {swarm.names[uav]}; add it")
    here = mesh[uav]
    # Only one node of each pair connects: with two links, Zenoh may not notice the loss of a link.
    others = [endpoint for other, endpoint in mesh.items() if other < uav]
    return zenoh_config.mesh_node(here, others, swarm.name, [*swarm.names], credentials_for(here, keyring))


def as_station(swarm: Roster, connect: str | None, keyring: Keyring | None) -> Configuration:
    """Return the network of a ground station. In a mesh the station opens a connection to every agent.

    `connect` replaces `communication.router`. Raises NoNetwork.
    """
    if (router := _router(swarm, connect)) is not None:
        return zenoh_config.client(router, credentials_for(router, keyring))
    nodes = [*_mesh(swarm).values()]
    if not nodes:
        raise NoNetwork("`communication` has neither router nor mesh; add a router or a mesh [no-network]")
    here = BusEndpoint("127.0.0.1", 0, nodes[0].protocol)
    return zenoh_config.mesh_node(here, nodes, swarm.name, [*swarm.names], credentials_for(here, keyring))


def connection_advice(network: Configuration) -> str:
    """Return advice to the operator if no endpoint of a network answers."""
    # Zenoh reports "Timeout!" both for an absent machine and for a refused certificate.
    if not any(endpoint.is_certified for endpoint in network.connect):
        return "check that the program runs on that machine, and that no firewall blocks the port"
    return (
        "check that the program runs on that machine, that no firewall blocks the port, and that both "
        "machines have the same ca.pem (copy the folders of one run of `swarmctl keys` to all machines)"
    )


def credentials_for(endpoint: BusEndpoint, keyring: Keyring | None) -> Credentials | None:
    """Return the credentials for an endpoint; None for tcp/. Raises NoNetwork if keys are missing."""
    if not endpoint.is_certified:
        return None
    if keyring is None:
        raise NoNetwork(
            f"{endpoint} needs certificates; make keys with `swarmctl keys`, and set communication.keys "
            "[no-certificates]"
        )
    return keyring.credentials


def _mesh(swarm: Roster) -> dict[int, BusEndpoint]:
    try:
        return mesh_endpoints(swarm.communication.mesh, swarm.names)
    except ValueError as error:
        raise NoNetwork(f"communication.mesh: {error}") from None


def _router(swarm: Roster, connect: str | None) -> BusEndpoint | None:
    if connect is None:
        return None if swarm.communication.router is None else parse_endpoint(swarm.communication.router)
    try:
        return parse_endpoint(connect)
    except ValueError as error:
        raise NoNetwork(f"--connect: {error}") from None
