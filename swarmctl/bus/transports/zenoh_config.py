"""Zenoh's configuration for each role in a swarm's network. No I/O.

| role | mode | listens | connects |
|---|---|---|---|
| `standalone`: a process with the whole swarm | peer | – | – |
| `whole_swarm`: the same, with an endpoint | peer | for operators and payloads | – |
| `visitor`: a command's short session | client | – | at once, or it fails |
| `client`: a vehicle's companion or a ground station | client | – | to the router, now or later |
| `router` | router | for clients | – |
| `mesh_node`: a companion in an ad-hoc mesh | router | for its neighbours | to its neighbours, now or later |

All endpoints are explicit: no multicast scouting, no gossip, no shared memory. All links use the protocols of
the endpoints. With credentials both sides of a link show a certificate.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from swarmctl.bus import keys
from swarmctl.bus.endpoint import BusEndpoint
from swarmctl.bus.transports import access
from swarmctl.bus.transports.base import MAX_MESSAGE_BYTES

LEASE_MS = 2_000
"""time without traffic after which a link counts as dead; keep-alives are sent four times in this time"""
RETRY_MS = (100, 300)
"""first and longest pause between attempts to connect"""
HANDSHAKE_MS = 2_000
"""Time limit of one attempt to connect, TCP's handshake included. A kernel repeats a lost SYN after 1 s, then
at growing intervals. Longer attempts find a restarted router late; shorter ones fail on slow radio links."""
JOIN_MS = 3_000
"""time limit for the connection of a visitor"""
OPENING_MS = 4_000
"""time limit of a client's attempt to open a session; an attempt cannot be interrupted"""
DROP_AFTER_US = 1_000
"""longest wait of a put for room in a full queue; without a wait bursts would lose messages"""
KEY_AND_HEADER_BYTES = 1_024
GIVE_UP_AFTER_US = 1_000_000
"""time after which a waiting declaration or answer closes the link, because neither may be dropped"""


class Credentials(msgspec.Struct, frozen=True):
    """PEM files: the swarm's certificate authority, the participant's certificate and its private key."""

    ca: Path
    certificate: Path
    key: Path
    common_names: Mapping[str, str] = msgspec.field(default_factory=dict)
    """common names of certificates that differ from the participant's name, by participant"""


class Configuration(msgspec.Struct, frozen=True):
    """Configuration of a session."""

    values: Mapping[str, Any]
    """Zenoh's configuration, by path"""
    listen: BusEndpoint | None = None
    connect: tuple[BusEndpoint, ...] = ()
    is_patient: bool = False
    """True if the session may open later"""
    has_others: bool = False
    """True if other processes receive this process's messages"""
    nodes: str = ""
    """prefix of the keys by which a mesh's nodes check their routes; empty outside a mesh"""

    def as_json5(self) -> str:
        """Return the configuration for a `zenohd` of the same version, with the credentials' paths."""
        tree: dict[str, Any] = {}
        for path, value in self.values.items():
            *parents, last = path.split("/")
            node = tree
            for parent in parents:
                node = node.setdefault(parent, {})
            node[last] = value
        return json.dumps(tree, indent=2)

    def explain(self, error: str) -> str:
        """Return the message to the operator for Zenoh's error from opening a session."""
        targets = ", ".join(map(str, self.connect))
        short = error.split(" at /", 1)[0].strip()  # without the line in Zenoh's sources
        if self.is_patient:
            return f"no connection to {targets} yet: {short}"
        if self.listen is not None:
            where, none = (
                ("communication.listen: ", ", or `none`") if self.values["mode"] == "peer" else ("", "")
            )
            why = "the port is in use" if "in use" in error else short
            advice = f"give a free port (0: any free port) at an address of this machine{none}"
            return f"{where}cannot listen at {self.listen}: {why}; {advice}"
        if self.connect:
            same_keys = " and that its keys have the same authority" if self.connect[0].is_certified else ""
            return (
                f"no swarm listens at {targets} (tried for {JOIN_MS / 1e3:g} s); the flight may have ended. "
                "For vehicles flown by `swarmctl agent`, check that the router or the agent runs at this "
                f"endpoint{same_keys} [no-swarm-at-endpoint]"
            )
        return (
            f"Zenoh cannot open a session: {error}; a flight in one process does not need Zenoh: "
            "`communication: {bus: memory}`"
        )


def standalone() -> Configuration:
    """Return the configuration of a process that exchanges messages with no other process."""
    return Configuration(_common("peer"))


def whole_swarm(listen: BusEndpoint, swarm: str, uavs: Sequence[int]) -> Configuration:
    """Return the configuration of a process with the whole swarm, which takes commands and reports."""
    values = _common("peer", listen=listen)
    values["access_control"] = access.endpoint_rules(swarm, uavs)
    return Configuration(values, listen=listen)


def visitor(endpoint: BusEndpoint, credentials: Credentials | None = None) -> Configuration:
    """Return the configuration of a client that connects within `JOIN_MS`, or fails."""
    values = _common("client", connect=(endpoint,), credentials=credentials)
    values |= {"connect/timeout_ms": JOIN_MS, "connect/exit_on_failure": True}
    return Configuration(values, connect=(endpoint,), has_others=True)


def client(router: BusEndpoint, credentials: Credentials | None = None) -> Configuration:
    """Return the configuration of a client whose session opens at the router's first answer."""
    values = _common("client", connect=(router,), credentials=credentials)
    # Zenoh cannot open a client without a router, even with exit_on_failure False.
    values |= {"connect/timeout_ms": OPENING_MS, "connect/exit_on_failure": True}
    return Configuration(values, connect=(router,), is_patient=True, has_others=True)


def router(
    listen: BusEndpoint, swarm: str, uavs: Sequence[int], credentials: Credentials | None = None
) -> Configuration:
    """Return the configuration of the router of a swarm's clients."""
    values = _common("router", listen=listen, credentials=credentials)
    values["access_control"] = access.router_rules(swarm, uavs, common_names=_common_names(credentials))
    return Configuration(values, listen=listen, has_others=True)


def mesh_node(
    listen: BusEndpoint,
    neighbours: Sequence[BusEndpoint],
    swarm: str,
    uavs: Sequence[int],
    credentials: Credentials | None = None,
) -> Configuration:
    """Return the configuration of a mesh node, which relays for its neighbours; neighbours may be absent.

    Only one node of each pair should connect to the other node. If both connect, the pair has two links and
    one transport. After a cut sometimes only one end closes the transport. Then messages are lost in one
    direction, and no table of Zenoh (1.10) shows this.
    """
    values = _common("router", listen=listen, connect=neighbours, credentials=credentials)
    # No time-out: Zenoh tries in the background.
    values |= {"connect/timeout_ms": -1, "connect/exit_on_failure": False}
    values["access_control"] = access.mesh_node_rules(swarm, uavs, common_names=_common_names(credentials))
    nodes = f"{keys.ROOT}/{swarm}/node"
    return Configuration(values, listen=listen, connect=tuple(neighbours), has_others=True, nodes=nodes)


def _common_names(credentials: Credentials | None) -> Mapping[str, str] | None:
    return None if credentials is None else credentials.common_names


def _common(
    mode: str,
    *,
    listen: BusEndpoint | None = None,
    connect: Sequence[BusEndpoint] = (),
    credentials: Credentials | None = None,
) -> dict[str, Any]:
    first, longest = RETRY_MS
    endpoints = [*connect] if listen is None else [listen, *connect]
    values: dict[str, Any] = {
        "mode": mode,
        "listen/endpoints": [] if listen is None else [str(listen)],
        "listen/exit_on_failure": True,
        "connect/endpoints": [str(endpoint) for endpoint in connect],
        "connect/retry": {"period_init_ms": first, "period_max_ms": longest, "period_increase_factor": 1.5},
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,  # wait for scouting before a router opens [ms]
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
        # Zenoh checks only messages longer than a batch, sent in fragments; `ZenohBus` checks all messages.
        "transport/link/rx/max_message_size": MAX_MESSAGE_BYTES + KEY_AND_HEADER_BYTES,
    }
    if listen is not None and listen.port == 0:
        values["adminspace/enabled"] = True
    if credentials is not None:
        values["transport/link/tls"] = _tls(credentials)
    return values


def _tls(credentials: Credentials) -> dict[str, Any]:
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
