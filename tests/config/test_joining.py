"""The network that each process joins, by the section `communication`."""

from __future__ import annotations

import pytest
from flights import small

from swarmctl.bus.endpoint import BusEndpoint
from swarmctl.bus.transports import zenoh_config
from swarmctl.config import joining
from swarmctl.config.joining import NoNetwork
from swarmctl.config.model import Config

NAMES = {1: "uav1", 2: "uav2", 3: "uav3"}
AT = {uav: BusEndpoint(f"10.0.0.{uav}", 7447) for uav in NAMES}
BY_NAME = {f"uav{uav}": str(at) for uav, at in AT.items()}
BY_SYSTEM_ID = {uav: str(at) for uav, at in AT.items()}
MIXED = {"uav1": str(AT[1]), 2: str(AT[2]), "3": str(AT[3])}


def meshed(mesh: dict[object, str]) -> Config:
    return small(communication={"bus": "zenoh", "mesh": mesh}).config


@pytest.mark.parametrize("mesh", [BY_NAME, BY_SYSTEM_ID, MIXED], ids=["names", "system ids", "mixed"])
def test_an_agent_joins_a_mesh_keyed_by_name_or_by_system_id(mesh: dict[object, str]) -> None:
    network = joining.as_agent(meshed(mesh), 2, None, None)
    assert network == zenoh_config.mesh_node(AT[2], [AT[1]], "small", [1, 2, 3], None)
    watching = joining.as_station(meshed(mesh), None, None)
    assert watching.connect == tuple(AT.values())


def test_a_vehicle_without_an_endpoint_in_the_mesh_is_named() -> None:
    with pytest.raises(NoNetwork, match=r"communication\.mesh.*\buav2\b"):
        joining.as_agent(meshed({1: str(AT[1])}), 2, None, None)


@pytest.mark.parametrize(
    ("mesh", "named"),
    [({9: str(AT[1])}, "9"), (BY_NAME | BY_SYSTEM_ID, "uav1")],
    ids=["an unknown vehicle", "a vehicle twice"],
)
def test_an_ambiguous_mesh_is_refused(mesh: dict[object, str], named: str) -> None:
    with pytest.raises(NoNetwork, match=rf"communication\.mesh: .*\b{named}\b"):
        joining.as_agent(meshed(mesh), 2, None, None)


@pytest.mark.parametrize(("protocol", "keys_may_be_foreign"), [("tcp", False), ("tls", True), ("quic", True)])
def test_advice_for_an_unreachable_network_names_the_authority_if_keys_are_used(
    protocol: str, keys_may_be_foreign: bool
) -> None:
    advice = joining.connection_advice(zenoh_config.client(BusEndpoint("10.0.0.1", 7447, protocol), None))
    assert ("ca.pem" in advice) is keys_may_be_foreign
