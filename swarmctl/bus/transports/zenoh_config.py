"""How Zenoh is configured for each place in a swarm's network: pure data.

| place | mode | listens | connects |
|---|---|---|---|
| `standalone`: a process with the whole swarm inside | peer | at its door, if it has one | – |
| `visitor`: who comes to a door or router for a moment | client | – | at once, or it fails |
| `client`: a vehicle's companion or a ground station | client | – | to the router, now or later |
| `router` | router | for clients | – |
| `mesh_node`: a companion in an ad-hoc mesh | router | for its neighbours | to its neighbours, now or later |

Nobody is looked for: no multicast scouting, no gossip, no shared memory, explicit endpoints. With credentials
both sides of a link show a certificate, and all links are of the one protocol of the endpoints.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from swarmctl.bus import keys
from swarmctl.bus.endpoint import BusEndpoint
from swarmctl.bus.transports import access
from swarmctl.bus.transports.base import MAX_MESSAGE_BYTES

LEASE_MS = 2_000
"""a link on which nothing came for so long is dead; a sign of life is sent four times as often"""
RETRY_MS = (100, 300)
"""between attempts to connect: at first, at most"""
HANDSHAKE_MS = 2_000
"""for one attempt, TCP's included. A kernel repeats a lost SYN after a second, then ever more rarely: longer
attempts would find a returned router late, shorter ones fail on slow radio links."""
JOIN_MS = 3_000
"""a visitor tries for so long"""
OPENING_MS = 4_000
"""a client tries so long at a stretch, which cannot be broken off, then again"""
DROP_AFTER_US = 1_000
"""a put waits this long at most for room in a full queue: without any wait bursts would be cut"""
KEY_AND_HEADER_BYTES = 1_024
GIVE_UP_AFTER_US = 1_000_000
"""what may not be dropped (declarations, answers) waits so long; then the link is closed"""


@dataclass(frozen=True, slots=True)
class Credentials:
    """PEM files: the swarm's certificate authority, one's own certificate and its private key."""

    ca: Path
    certificate: Path
    key: Path


@dataclass(frozen=True, slots=True)
class Configuration:
    """What a session is opened with."""

    values: Mapping[str, Any]
    """Zenoh's configuration, by path"""
    listen: BusEndpoint | None = None
    connect: tuple[BusEndpoint, ...] = ()
    is_patient: bool = False
    """whether it may open at any time later"""
    has_others: bool = False
    """whether what is put here concerns other processes"""
    nodes: str = ""
    """of a mesh: the key under which every node hears, by the id of its session, so that its neighbours see
    whether they have routes to it; nothing is ever put there"""

    def as_json5(self) -> str:
        """The same for a `zenohd` of the same version, which must find the credentials at the same paths."""
        tree: dict[str, Any] = {}
        for path, value in self.values.items():
            *parents, last = path.split("/")
            node = tree
            for parent in parents:
                node = node.setdefault(parent, {})
            node[last] = value
        return json.dumps(tree, indent=2)

    def cure(self, error: str) -> str:
        """What to do where Zenoh could not open a session with it, and said so."""
        there = ", ".join(map(str, self.connect))
        short = error.split(" at /", 1)[0].strip()  # without the place in Zenoh's sources
        if self.is_patient:
            return f"nobody lets us in at {there} yet: {short}"
        if self.listen is not None:
            where, none = (
                ("communication.listen: ", ", or `none`") if self.values["mode"] == "peer" else ("", "")
            )
            why = "the port is taken" if "in use" in error else short
            cure = f"end who has it, give another port (0 is any free one){none}"
            return f"{where}cannot listen at {self.listen}: {why}; {cure}"
        if self.connect:
            keys = ", and are its keys of the same authority" if self.connect[0].is_certified else ""
            return (
                f"no swarm listens at {there}: tried for {JOIN_MS / 1e3:g} s; has its flight ended? Where "
                f"agents fly: does `swarmctl router`, or the agent, run there{keys}?"
            )
        return f"Zenoh cannot open a session: {error}; `communication: {{bus: memory}}` needs none"


def standalone(
    door: BusEndpoint | None = None, ask_keys: Sequence[str] = (), put_keys: Sequence[str] = ()
) -> Configuration:
    """Neither listens nor connects; through a door others may ask and put under these keys."""
    values = _common("peer", listen=door)
    if door is not None:
        values["access_control"] = access.operator_endpoint_rules(ask_keys, put_keys)
    return Configuration(values, listen=door)


def visitor(there: BusEndpoint, credentials: Credentials | None = None) -> Configuration:
    """Joins who listens there within `JOIN_MS`, or cannot be opened."""
    values = _common("client", connect=(there,), credentials=credentials)
    values |= {"connect/timeout_ms": JOIN_MS, "connect/exit_on_failure": True}
    return Configuration(values, connect=(there,), has_others=True)


def client(router: BusEndpoint, credentials: Credentials | None = None) -> Configuration:
    """Of a router that may come and go; the session opens when it is there for the first time."""
    values = _common("client", connect=(router,), credentials=credentials)
    # A client without a router cannot be opened by Zenoh at all, whatever exit_on_failure says.
    values |= {"connect/timeout_ms": OPENING_MS, "connect/exit_on_failure": True}
    return Configuration(values, connect=(router,), is_patient=True, has_others=True)


def router(
    listen: BusEndpoint, swarm: str, uavs: Sequence[int], credentials: Credentials | None = None
) -> Configuration:
    """What a swarm's clients connect to."""
    values = _common("router", listen=listen, credentials=credentials)
    values["access_control"] = access.router_rules(swarm, uavs, certified=credentials is not None)
    return Configuration(values, listen=listen, has_others=True)


def mesh_node(
    listen: BusEndpoint,
    neighbours: Sequence[BusEndpoint],
    swarm: str,
    uavs: Sequence[int],
    credentials: Credentials | None = None,
) -> Configuration:
    """One of many that pass on for each other; neighbours may come and go, and it opens without any.

    Of two nodes one alone should have the other among its `neighbours`. Where both connect, two links make
    one transport, whose ends may disagree after a cut on whether it ended; then what one says does not reach
    the other, and no table of Zenoh (1.10) shows it.
    """
    values = _common("router", listen=listen, connect=neighbours, credentials=credentials)
    # Without an end: Zenoh tries in the background.
    values |= {"connect/timeout_ms": -1, "connect/exit_on_failure": False}
    values["access_control"] = access.mesh_node_rules(swarm, uavs, certified=credentials is not None)
    nodes = f"{keys.ROOT}/{swarm}/node"
    return Configuration(values, listen=listen, connect=tuple(neighbours), has_others=True, nodes=nodes)


def _common(
    mode: str,
    *,
    listen: BusEndpoint | None = None,
    connect: Sequence[BusEndpoint] = (),
    credentials: Credentials | None = None,
) -> dict[str, Any]:
    first, most = RETRY_MS
    endpoints = [*connect] if listen is None else [listen, *connect]
    values: dict[str, Any] = {
        "mode": mode,
        "listen/endpoints": [] if listen is None else [str(listen)],
        "listen/exit_on_failure": True,
        "connect/endpoints": [str(endpoint) for endpoint in connect],
        "connect/retry": {"period_init_ms": first, "period_max_ms": most, "period_increase_factor": 1.5},
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        # How long a router waits for whom scouting may find, before it opens.
        "scouting/delay": 0,
        "transport/shared_memory/enabled": False,
        "transport/unicast/open_timeout": HANDSHAKE_MS,
        "transport/unicast/accept_timeout": HANDSHAKE_MS,
        "transport/link/protocols": sorted({endpoint.protocol for endpoint in endpoints}) or ["tcp"],
        "transport/link/tx/lease": LEASE_MS,
        "transport/link/tx/keep_alive": 4,
        "transport/link/tx/queue/congestion_control/drop": {
            "wait_before_drop": DROP_AFTER_US,
            "max_wait_before_drop_fragments": DROP_AFTER_US,
        },
        "transport/link/tx/queue/congestion_control/block": {"wait_before_close": GIVE_UP_AFTER_US},
        # Of what comes in fragments, which is what is longer than a batch; shorter is looked at on arrival.
        "transport/link/rx/max_message_size": MAX_MESSAGE_BYTES + KEY_AND_HEADER_BYTES,
    }
    if listen is not None and listen.port == 0:
        values["adminspace/enabled"] = True
    if credentials is not None:
        values["transport/link/tls"] = _tls(credentials)
    return values


def _tls(credentials: Credentials) -> dict[str, Any]:
    """Used for `tls` and `quic` alike."""
    return {
        "root_ca_certificate": str(credentials.ca),
        "listen_certificate": str(credentials.certificate),
        "listen_private_key": str(credentials.key),
        "connect_certificate": str(credentials.certificate),
        "connect_private_key": str(credentials.key),
        "enable_mtls": True,
        "verify_name_on_connect": True,
        "close_link_on_expiration": True,
    }
