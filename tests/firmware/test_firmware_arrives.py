"""Real autopilots in software fly from their starts to their goals, judged by their own positions."""

from __future__ import annotations

import time
from typing import Any

import pytest
from firmware import Airfield
from flown_cells import summary
from namespaces import Process
from recorded import events
from udp_relay import Radio

COPTER, PLANE, PX4 = "arducopter", "arduplane", "px4"
FLIGHT_S = 600.0
OFF_PLAN_M = {COPTER: 12.0, PX4: 12.0, PLANE: 40.0}
"""greatest distance from the cells of the plans, at a turn or a new plan; a plane's turn radius is 40 m"""
BACK_M = 25.0
"""greatest distance flown back to a new plan, half a cell"""
LANDED_M = {COPTER: 3.0, PX4: 3.0, PLANE: 20.0}
"""greatest distance from the goal; a plane flares and rolls out"""
STILL_M, HOLD_S = 0.5, 30.0
"""a vehicle in hold moves less in 3 s; time limit for it"""
FAR_M = 900.0
"""PX4's MIS_DIST_1WP"""


def assert_arrived(field: Airfield, flight: Process) -> None:
    assert flight.ended(within_s=FLIGHT_S) == 0
    for name, one in field.flown().items():
        kind = field.kinds[list(field.sysids).index(name)]
        assert one.account["outcome"] == "arrived", one
        assert one.furthest_m < OFF_PLAN_M[kind], one
        assert one.back_m < BACK_M, one
        assert field.distance_from_goal_m(name) < LANDED_M[kind], one


@pytest.mark.firmware(COPTER)
def test_the_shipped_scenario(field_of: Any) -> None:
    with field_of([COPTER] * 5) as field:
        assert_arrived(field, field.fly())


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
    """PX4 1.15 refuses missions that begin far away. An operator reports a hostile far from take-off."""
    with field_of([PX4] * 2, cells=26) as field:
        flight = field.fly()
        row, col = field.await_column("uav1", 19)
        assert field.distance_from_start_m("uav1") > FAR_M
        since_ns, hostile = time.time_ns(), f"{row},{col + 4}"
        sysid = str(field.sysids["uav1"])
        field.swarmctl("observe", "--uav", sysid, "--cell", hostile, "--occupied")
        assert_arrived(field, flight)
        assert any(one["log_time_ns"] > since_ns for one in events(field.run, "MissionAccepted", "uav1"))


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


@pytest.mark.firmware(COPTER, PX4)
def test_a_hold_that_is_resumed(field_of: Any) -> None:
    with field_of([COPTER, PX4], cells=10) as field:
        flight = field.fly()
        for name in field.sysids:
            field.await_column(name, 2)
        field.order("hold")
        for name, sysid in field.sysids.items():
            field.witness.until(lambda w, s=sysid: w[s].stands(STILL_M), f"a hold of {name}", HOLD_S)
        field.order("resume")
        assert_arrived(field, flight)
