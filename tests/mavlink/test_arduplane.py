"""ArduPlane's mission, and its flights that differ from those of PX4 (`test_planes`)."""

from __future__ import annotations

import math

import pytest
from flying_bench import HOME
from plane_flights import FIRST, GOAL, LOW_M, RADIUS_M, away_m, bench, landed
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.mission import FlightPlan, MissionItem
from swarmctl.core.records import replace
from swarmctl.mavlink.dialects import dialect_for
from swarmctl.mavlink.procedures import basic
from swarmctl.mavlink.procedures.land import landing_items

PLANE = dialect_for(mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, mavlink.MAV_TYPE_FIXED_WING)


# --- messages sent


def test_the_mission_takes_off_turns_before_corners_and_lands_at_the_goal_or_at_home() -> None:
    items = PLANE.mission_items(FIRST)
    assert [item.command for item in items] == [16, 22, 16, 16, 16, 189, 31, 16, 21, 189, 31, 16, 21]
    takeoff, straight, turn = items[1], items[3], items[4]
    assert (takeoff.param1, takeoff.z) == (15.0, LOW_M)
    # The plane turns by 53 degrees at the second point: 40 m · tan(θ/2) before the corner.
    corner_rad = math.atan2(400.0, 300.0)
    assert straight.param2 == math.ceil(40.0 * math.tan(corner_rad / 2.0))
    assert turn.param2 == 1.0, "the plane flies over its goal"
    start, circle, final, down = items[5:9]
    assert (start.x, start.y) == (circle.x, circle.y)
    assert (circle.param2, circle.param4, circle.z) == (RADIUS_M, 1.0, LOW_M)
    assert (final.z, down.z) == (LOW_M, 0.0)
    assert (down.x, down.y) == (round(FIRST.landing.lat_deg * 1e7), round(FIRST.landing.lon_deg * 1e7))
    assert landing_items(items) == frozenset(range(5, 13))


@pytest.mark.parametrize("autopilot", [mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, mavlink.MAV_AUTOPILOT_PX4])
@pytest.mark.parametrize(
    ("kind", "which", "remedy"),
    [
        (mavlink.MAV_TYPE_QUADROTOR, FIRST, "airframe: copter"),
        (mavlink.MAV_TYPE_FIXED_WING, FlightPlan(40.0, FIRST.track, FIRST.landing), "airframe: plane"),
    ],
)
def test_a_plan_for_another_airframe_is_refused(autopilot, kind, which, remedy) -> None:
    with pytest.raises(ValueError, match=remedy):
        dialect_for(autopilot, kind).mission_items(which, HOME)


def test_a_read_back_equals_the_mission_sent_except_for_storage() -> None:
    sent = (*PLANE.mission_items(FIRST),)
    stored = bench("ardupilot").uploaded(FIRST).stored
    assert stored != sent
    assert PLANE.differences(sent, stored) == ()
    wider = replace(stored[3], param2=stored[3].param2 + 1.0)
    assert PLANE.differences(sent, (*stored[:3], wider, *stored[4:])), (
        "the turning point counts as a difference"
    )
    other_way = replace(stored[6], param2=-RADIUS_M)
    assert PLANE.differences(sent, (*stored[:6], other_way, *stored[7:]))


# --- flights


def test_the_plane_lands_at_its_goal_and_is_made_ready_again_there() -> None:
    flown = bench("ardupilot").flying(FIRST)
    assert landed(flown)
    assert away_m(flown, GOAL) < 60.0
    # ArduPlane stays in its landing item and refuses to arm there (`AP_Arming_Plane::pre_arm_checks`).
    assert flown.do("prepare", basic.prepare, 60.0).failure is None
    assert flown.mode == "GUIDED"
    assert flown.session.state.mission_seq == 1
    assert flown.upload(FIRST).failure is None
    assert flown.do("launch", basic.launch).failure is None


def test_a_plane_without_a_landing_reports_that_it_does_not_land() -> None:
    flown = bench("ardupilot").flying(FIRST)
    del flown.vehicle.mission.items[5:]
    failure = flown.do("land", basic.land).failure
    assert failure is not None
    assert "FAILED" in failure


def test_items_outside_a_landing_do_not_belong_to_it() -> None:
    waypoint = MissionItem(16, 3, 1, 1, 40.0)
    start, down = replace(waypoint, command=189), replace(waypoint, command=21)
    assert landing_items((waypoint, start, waypoint, down, waypoint)) == {1, 2, 3}
    assert landing_items((waypoint, down)) == frozenset()
