"""Conditions under which a flight accepts orders and changes of its range."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import pytest
from flights import small

from swarmctl.core.messages import GiveOrder
from swarmctl.flight import operator_orders
from swarmctl.mavlink.events import Identity


@dataclass
class KnownMember:
    """The fields of a vehicle that the conditions read."""

    name: str
    identity: Identity | None = None


def known(name: str, uid2: bytes | None) -> Any:
    """Return a vehicle with this identity; with none before its first version message."""
    if uid2 is None:
        return KnownMember(name)
    return KnownMember(name, Identity(1, 3, 2, "ArduPilot 4.6.2", uid2.ljust(18, b"\0")))


SIMULATED, REAL = b"sim_vehicle\0", b"\x12\x34"


@pytest.mark.parametrize(
    ("uid2", "has_keys", "refused"),
    [
        (SIMULATED, False, ""),
        (SIMULATED, True, ""),
        (REAL, False, "[orders-need-keys]"),
        (REAL, True, ""),
        (None, False, "[orders-need-keys]"),
        (None, True, ""),
    ],
)
def test_without_keys_only_simulated_vehicles_take_orders(
    uid2: bytes | None, has_keys: bool, refused: str
) -> None:
    vehicles = [known("alpha", uid2)]
    found = operator_orders.order_refusal(
        small(), vehicles, GiveOrder(None, "hold"), flies_all=False, has_keys=has_keys
    )
    assert bool(found) is bool(refused)
    assert not refused or ("alpha" in found and found.endswith(refused))


@pytest.mark.parametrize(
    ("order", "listen", "refused"),
    [
        ("launch", "tcp/127.0.0.1:0", "[launch-by-fly-only]"),
        ("return", "tcp/127.0.0.1:0", ""),
        ("land", "none", ""),
        ("land", "tcp/0.0.0.0:7447", "[orders-need-keys]"),
    ],
)
def test_unsigned_orders_launch_no_aircraft_and_come_from_this_machine_only(
    order: Any, listen: str, refused: str
) -> None:
    scenario = small(communication={"bus": "memory", "listen": listen})
    found = operator_orders.order_refusal(
        scenario, [known("alpha", None)], GiveOrder(None, order), flies_all=True, has_keys=False
    )
    assert refused in found
    assert bool(found) is bool(refused)


@pytest.mark.parametrize("uid2", [REAL, None])
def test_the_range_of_a_swarm_with_a_real_vehicle_is_not_changed(uid2: bytes | None) -> None:
    simulated = known("uav1", SIMULATED)
    assert operator_orders.range_refusal(small(), [simulated]) == ""
    found = operator_orders.range_refusal(small(), [simulated, known("alpha", uid2)])
    assert found.endswith("[range-of-real-vehicles]")
