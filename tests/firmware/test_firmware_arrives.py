"""Real autopilots in software fly from their starts to their goals, judged by their own positions."""

from __future__ import annotations

from typing import Any

import pytest
from firmware import Airfield
from flown_cells import summary
from namespaces import Process
from recorded import events
from udp_relay import Radio

COPTER, PLANE, PX4 = "arducopter", "arduplane", "px4"
FLIGHT_S = 600.0
OFF_PLAN_M = 12.0
"""greatest distance of a copter from the cells of its plans, where it turns or receives a new plan"""
PLANE_OFF_PLAN_M = 40.0
"""a plane rounds its corners by `wings.turn_radius_m`"""
LANDED_M = 3.0


def assert_arrived(field: Airfield, flight: Process) -> None:
    assert flight.ended(within_s=FLIGHT_S) == 0
    for name, one in field.flown().items():
        is_plane = field.kinds[list(field.sysids).index(name)] == PLANE
        assert one.account["outcome"] == "arrived", one
        assert one.furthest_m < (PLANE_OFF_PLAN_M if is_plane else OFF_PLAN_M), one
        assert field.distance_from_goal_m(name) < LANDED_M, one


@pytest.mark.firmware(COPTER)
def test_the_shipped_scenario(field_of: Any) -> None:
    with field_of([COPTER] * 5) as field:
        assert_arrived(field, field.fly())


@pytest.mark.xfail(
    reason="a plan that is changed before the first centre of the route is flown from its beginning: back",
    strict=False,
)
@pytest.mark.firmware(COPTER)
def test_a_radio_with_loss_and_delay(field_of: Any) -> None:
    with field_of([COPTER] * 5, Radio(loss=0.15, delay_s=0.2)) as field:
        assert_arrived(field, field.fly())


@pytest.mark.firmware(COPTER)
def test_an_arrival_together(field_of: Any) -> None:
    with field_of([COPTER] * 5, example="arrive") as field:
        assert_arrived(field, field.fly())
        assert summary(field.run)["arrival"]["spread_s"] < 3.0


@pytest.mark.firmware(PLANE)
def test_a_plane(field_of: Any) -> None:
    with field_of([PLANE], example="wings") as field:
        assert_arrived(field, field.fly())


@pytest.mark.firmware(PX4)
def test_two_px4(field_of: Any) -> None:
    with field_of([PX4] * 2) as field:
        assert_arrived(field, field.fly())


@pytest.mark.firmware(COPTER, PLANE, PX4)
def test_three_autopilots_in_one_swarm(field_of: Any) -> None:
    with field_of([COPTER, PLANE, PX4, COPTER, PX4], example="wings") as field:
        assert_arrived(field, field.fly())


@pytest.mark.firmware(COPTER)
@pytest.mark.parametrize(
    ("policy", "outage_s"), [("return", 6.0), ("continue", 26.0)], ids=["shorter-than-the-failsafe", "long"]
)
def test_an_outage(field_of: Any, policy: str, outage_s: float) -> None:
    """The failsafe of a vehicle that returns waits 10 s; another vehicle flies on."""
    radio = Radio()
    with field_of([COPTER] * 2, radio, cells=10, policy={"lost_link": policy}) as field:
        flight = field.fly()
        field.await_column("uav1", 1)
        radio.cut_for(outage_s)
        assert_arrived(field, flight)
        assert {one["vehicle"] for one in events(field.run, "LinkRestored")} == {"uav1", "uav2"}
