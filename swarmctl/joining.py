"""How a process joins its swarm's network, by the section `communication` of a configuration."""

from __future__ import annotations

import datetime as dt
from collections.abc import Sequence
from pathlib import Path

from swarmctl.bus import zenoh_config
from swarmctl.bus.endpoint import BusEndpoint, parse_endpoint
from swarmctl.bus.zenoh_config import Configuration, Credentials
from swarmctl.config import Config
from swarmctl.keyring.use import Keyring, load


class NoNetwork(ValueError):
    """The configuration does not say how; the text says what to add."""


def keyring_of(config: Config, name: str, now: dt.datetime) -> Keyring | None:
    """The keys of `uav3` or `operator`; None where communication.keys is not set. Raises KeyringError."""
    folder = config.communication.keys
    return None if folder is None else load(Path(folder), name, now)


def as_agent(
    config: Config, name: str, uavs: Sequence[int], connect: str | None, keyring: Keyring | None
) -> Configuration:
    """For the agent of vehicle `name`; `connect` is a router instead of the configuration's.

    Raises NoNetwork.
    """
    c = config.communication
    if (router := _router(config, connect)) is not None:
        return zenoh_config.client(router, certified(router, keyring))
    if not c.mesh:
        raise NoNetwork("`communication` has neither router nor mesh, so agents do not find each other")
    if name not in c.mesh:
        raise NoNetwork(f"communication.mesh does not say where {name} listens: add it")
    here = parse_endpoint(c.mesh[name])
    others = [parse_endpoint(endpoint) for who, endpoint in c.mesh.items() if who != name]
    return zenoh_config.mesh_node(here, others, config.name, uavs, certified(here, keyring))


def as_watcher(
    config: Config, uavs: Sequence[int], connect: str | None, keyring: Keyring | None
) -> Configuration:
    """For a ground station that stays: of a mesh it is a node that listens to this machine only.

    Raises NoNetwork.
    """
    if (router := _router(config, connect)) is not None:
        return zenoh_config.client(router, certified(router, keyring))
    nodes = [parse_endpoint(endpoint) for endpoint in config.communication.mesh.values()]
    if not nodes:
        raise NoNetwork("`communication` has neither router nor mesh: there is nothing to watch at")
    here = BusEndpoint("127.0.0.1", 0, nodes[0].protocol)
    return zenoh_config.mesh_node(here, nodes, config.name, uavs, certified(here, keyring))


def certified(endpoint: BusEndpoint, keyring: Keyring | None) -> Credentials | None:
    """What is shown at an endpoint; nothing over plain TCP. Raises NoNetwork where it is missing."""
    if not endpoint.is_certified:
        return None
    if keyring is None:
        raise NoNetwork(f"{endpoint} needs certificates: set communication.keys (`swarmctl keys` makes them)")
    return keyring.credentials


def _router(config: Config, connect: str | None) -> BusEndpoint | None:
    if connect is None:
        return None if config.communication.router is None else parse_endpoint(config.communication.router)
    try:
        return parse_endpoint(connect)
    except ValueError as error:
        raise NoNetwork(f"--connect: {error}") from None
