"""Who connects where, by the section `communication` of a configuration."""

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
    network = joining.as_agent(meshed(mesh), 2, NAMES, None, None)
    assert network == zenoh_config.mesh_node(AT[2], [AT[1]], "small", [1, 2, 3], None)
    watching = joining.as_watcher(meshed(mesh), NAMES, None, None)
    assert watching.connect == tuple(AT.values())


def test_an_agent_whose_vehicle_is_missing_in_the_mesh_says_so_by_its_name() -> None:
    with pytest.raises(NoNetwork, match="does not say where uav2 listens"):
        joining.as_agent(meshed({1: str(AT[1])}), 2, NAMES, None, None)


@pytest.mark.parametrize(
    ("mesh", "said"),
    [
        ({9: str(AT[1])}, "no vehicle has the system id or name 9"),
        (BY_NAME | BY_SYSTEM_ID, "is given twice"),
    ],
)
def test_a_mesh_that_is_not_clear_is_refused(mesh: dict[object, str], said: str) -> None:
    with pytest.raises(NoNetwork, match=said):
        joining.as_agent(meshed(mesh), 2, NAMES, None, None)


@pytest.mark.parametrize(("protocol", "keys_may_be_foreign"), [("tcp", False), ("tls", True), ("quic", True)])
def test_who_reaches_nobody_is_told_of_foreign_keys_where_keys_are_used(
    protocol: str, keys_may_be_foreign: bool
) -> None:
    said = joining.not_reached(zenoh_config.client(BusEndpoint("10.0.0.1", 7447, protocol), None))
    assert "firewall" in said
    assert ("ca.pem has to be the same on both machines" in said) is keys_may_be_foreign
