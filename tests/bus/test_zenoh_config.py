"""Zenoh's configuration: accepted by Zenoh, and right for each role in a network."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import zenoh

from swarmctl.bus.endpoint import BusEndpoint
from swarmctl.bus.transports import zenoh_config
from swarmctl.bus.transports.access import router_rules
from swarmctl.bus.transports.zenoh_config import Configuration, Credentials

OWN = Credentials(Path("/keys/ca.pem"), Path("/keys/cert.pem"), Path("/keys/key.pem"))
TCP, TLS, QUIC = (BusEndpoint("10.0.0.7", 7447, protocol) for protocol in ("tcp", "tls", "quic"))
CONFIGURATIONS: dict[str, Configuration] = {
    "alone": zenoh_config.standalone(),
    "endpoint": zenoh_config.whole_swarm(TCP, "test", [1, 2]),
    "visitor": zenoh_config.visitor(TCP),
    "client": zenoh_config.client(TLS, OWN),
    "router": zenoh_config.router(QUIC, "test", [1, 2, 3], OWN),
    "router tcp": zenoh_config.router(TCP, "test", [1, 2, 3]),
    "mesh": zenoh_config.mesh_node(TLS, [BusEndpoint("b", 1, "tls")], "test", [1, 2, 3], OWN),
}


@pytest.mark.parametrize("name", CONFIGURATIONS)
def test_zenoh_accepts_the_configuration_without_discovery(name: str) -> None:
    configuration = CONFIGURATIONS[name]
    text = configuration.as_json5()
    understood = zenoh.Config.from_json5(text)
    for path, value in configuration.values.items():
        if not isinstance(value, dict | list):
            assert json.loads(understood.get_json(path)) == value, path
    tree = json.loads(text)
    assert tree["scouting"]["multicast"]["enabled"] is False
    assert tree["scouting"]["gossip"]["enabled"] is False
    assert tree["transport"]["shared_memory"]["enabled"] is False


@pytest.mark.parametrize("name", CONFIGURATIONS)
def test_a_listening_configuration_has_an_access_list_and_one_protocol(name: str) -> None:
    configuration = CONFIGURATIONS[name]
    tree = json.loads(configuration.as_json5())
    assert ("access_control" in tree) == (configuration.listen is not None)
    used = {text.split("/")[0] for key in ("listen", "connect") for text in tree[key]["endpoints"]}
    assert set(tree["transport"]["link"]["protocols"]) == (used or {"tcp"})
    certified = used & {"tls", "quic"}
    assert bool(certified) == ("tls" in tree["transport"]["link"])


@pytest.mark.parametrize("name", CONFIGURATIONS)
def test_only_mesh_nodes_have_presence_keys(name: str) -> None:
    """Every node of the swarm may subscribe to these keys; no node may put or query."""
    nodes = CONFIGURATIONS[name].nodes
    assert nodes == ("swarmctl/test/node" if name == "mesh" else "")
    if not nodes:
        return
    key = zenoh.KeyExpr(f"{nodes}/1")
    allowed = {
        message
        for rule in CONFIGURATIONS[name].values["access_control"]["rules"]
        if any(zenoh.KeyExpr(expression).intersects(key) for expression in rule["key_exprs"])
        for message in rule["messages"]
    }
    assert allowed == {"declare_subscriber", "declare_queryable"}


def test_a_vehicles_rights_do_not_depend_on_other_vehicles() -> None:
    """Zenoh loads a list of a hundred vehicles in 0.1 s."""
    listed = router_rules("test", range(1, 101), common_names={})
    assert max(len(rule["key_exprs"]) for rule in listed["rules"]) <= 300
    assert sum(len(rule["key_exprs"]) for rule in listed["rules"]) < 15_000
