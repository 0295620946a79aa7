"""Missions of PX4's fixed wings, and their flights that differ from those of ArduPlane (`test_planes`)."""

from __future__ import annotations

import math

import pytest
from flying_bench import HOME
from plane_flights import FIRST, FRAME, GOAL, LOW_M, RADIUS_M, SECOND, START, away_m, bench, landed, plan
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.mission import MissionItem
from swarmctl.core.records import replace
from swarmctl.core.vehicle import VehicleState
from swarmctl.mavlink.dialects import dialect_for
from swarmctl.mavlink.dialects.plan import append_items
from swarmctl.mavlink.procedures import basic
from swarmctl.mavlink.procedures.land import landing_items, nearest_landing

PLANE = dialect_for(mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_TYPE_FIXED_WING)
AT_HOME, AT_GOAL = 6, 9
"""The circles before both landings, as items of FIRST."""


# --- messages sent


def test_a_jump_in_the_mission_leads_past_the_landing_at_home_to_the_goal() -> None:
    items = PLANE.mission_items(FIRST)
    assert [item.command for item in items] == [22, 16, 16, 16, 177, 189, 31, 21, 177, 31, 21]
    takeoff, jump, start, done = items[0], items[4], items[5], items[8]
    assert (takeoff.x, takeoff.y, takeoff.z) == (items[1].x, items[1].y, LOW_M), (
        "the climb is not along a leg"
    )
    assert (jump.frame, jump.param1, jump.param2) == (mavlink.MAV_FRAME_MISSION, AT_GOAL, 1000.0)
    assert (start.frame, start.x, start.y) == (mavlink.MAV_FRAME_MISSION, 0, 0)
    assert (done.frame, done.param1, done.param2) == (mavlink.MAV_FRAME_MISSION, 10, 1000.0)
    for circle, down, touchdown in ((items[6], items[7], START), (items[9], items[10], GOAL)):
        assert (circle.param1, circle.param2, circle.param4, circle.z) == (1.0, RADIUS_M, 1.0, LOW_M)
        assert math.dist(FRAME.to_local(down.x / 1e7, down.y / 1e7), touchdown) < 0.1
    assert landing_items(items) == frozenset({5, 6, 7, 9, 10})


def test_the_last_waypoint_lies_behind_the_goal() -> None:
    last = PLANE.mission_items(FIRST)[3]
    east_m, north_m = FRAME.to_local(last.x / 1e7, last.y / 1e7)
    # The leg from (0, 600) to (400, 900) is 500 m long and continues past the goal.
    assert (east_m, north_m) == pytest.approx((400 + 30 * 0.8, 900 + 30 * 0.6), abs=0.1)


def test_jumps_of_appended_items_keep_their_targets() -> None:
    items = PLANE.mission_items(FIRST)
    longer = append_items((*items[:3], items[2], items[2]), items, 1)
    jump = next(item for item in longer if item.command == mavlink.MAV_CMD_DO_JUMP)
    assert longer[int(jump.param1)] == items[AT_GOAL]
    assert append_items(items[:1], items, 1) == items


def test_a_read_back_equals_the_mission_sent() -> None:
    sent = PLANE.mission_items(FIRST)
    stored = bench("px4").uploaded(FIRST).stored
    assert PLANE.differences(sent, stored) == ()
    elsewhere = replace(stored[4], param1=5.0)
    assert PLANE.differences(sent, (*stored[:4], elsewhere, *stored[5:])), (
        "the jump target counts as a difference"
    )


def test_the_nearest_landing_has_the_nearest_circle() -> None:
    items = PLANE.mission_items(FIRST)
    lat_deg, lon_deg = FRAME.to_geodetic(380.0, 700.0)
    assert nearest_landing(items, VehicleState(lat_deg=lat_deg, lon_deg=lon_deg)) == AT_GOAL
    assert nearest_landing(items, VehicleState(lat_deg=HOME[0], lon_deg=HOME[1])) == AT_HOME
    assert nearest_landing(items, VehicleState()) == AT_HOME
    assert nearest_landing((MissionItem(16, 3, 1, 1, 40.0),), VehicleState()) is None


# --- flights


def test_the_plane_flies_over_its_goal_and_lands_there() -> None:
    flown = bench("px4").uploaded(FIRST)
    assert flown.do("launch", basic.launch).failure is None
    assert flown.run(300.0, lambda: away_m(flown, GOAL) < 10.0)
    assert landed(flown)
    assert away_m(flown, GOAL) < 60.0


def test_an_infeasible_mission_is_refused_with_the_text_of_the_vehicle() -> None:
    failure = bench("px4", FW_LND_ANG=3.0).prepared().upload(FIRST).failure
    assert failure is not None
    assert "the landing glide slope is steeper than the vehicle setting of 3.0 degrees" in failure


def test_a_mission_outside_the_fence_is_refused() -> None:
    failure = bench("px4", GF_MAX_HOR_DIST=500.0).prepared().upload(FIRST).failure
    assert failure is not None
    assert "Geofence violation for waypoint 3" in failure


@pytest.mark.full
def test_a_repeated_mission_leads_to_the_goal_again() -> None:
    flown = bench("px4").uploaded(FIRST)
    assert flown.do("launch", basic.launch).failure is None
    assert flown.run(300.0, lambda: flown.session.state.mission_seq == AT_GOAL)
    assert flown.do("return", basic.return_home).failure is None
    assert landed(flown)
    items = flown.session.items
    assert flown.do("prepare", basic.prepare).failure is None
    assert flown.upload_items(items).failure is None
    assert flown.do("launch", basic.launch).failure is None
    assert landed(flown)
    assert away_m(flown, GOAL) < 60.0


@pytest.mark.full
def test_a_plane_returns_home_after_a_swap() -> None:
    flown = bench("px4").flying(FIRST)
    assert flown.swap(SECOND).failure is None
    assert flown.do("return", basic.return_home).failure is None
    assert landed(flown)
    assert away_m(flown, START) < 60.0


@pytest.mark.full
def test_a_plane_landing_at_its_goal_gets_no_other_mission() -> None:
    flown = bench("px4").uploaded(FIRST)
    assert flown.do("launch", basic.launch).failure is None
    assert flown.run(300.0, lambda: flown.session.state.mission_seq == AT_GOAL)
    before = flown.stored
    done = flown.swap(SECOND)
    assert (done.flying, flown.stored) == ("old", before)
    assert landed(flown)
    assert away_m(flown, GOAL) < 60.0


def test_a_plane_that_reaches_its_landing_during_an_upload_lands_at_its_goal() -> None:
    longer = plan((230.0, 750.0), (250.0, 900.0))  # not over the goal
    flown = bench("px4").flying(FIRST)
    assert flown.run(200.0, lambda: flown.session.state.mission_seq == 3 and away_m(flown, GOAL) < 30.0)
    flown.block = lambda message: (
        message.get_type() == "MISSION_ITEM_INT" and flown.session.state.mission_seq == 3
    )
    done = flown.swap(replace(longer, leaves_ahead=True))
    assert done.flying == "old"
    assert "[landing-reached]" in done.failure
    assert landed(flown)
    assert away_m(flown, GOAL) < 60.0


@pytest.mark.full
def test_a_command_to_land_works_during_a_return() -> None:
    flown = bench("px4").flying(FIRST)
    assert flown.do("return", basic.return_home).failure is None
    flown.run(5.0)
    assert flown.do("land", basic.land).failure is None
    assert flown.mode == "AUTO.MISSION"
    assert landed(flown)
    assert away_m(flown, START) < 60.0


def test_a_plane_with_unknown_landings_flies_to_the_known_landing() -> None:
    flown = bench("px4").flying(FIRST)
    flown.session._known_vehicle().context.verified_items = ()
    assert flown.do("land", basic.land).failure is None
    assert mavlink.MAV_CMD_DO_LAND_START in flown.commands
    assert landed(flown)
    assert away_m(flown, START) < 60.0


def test_a_command_that_may_arm_is_not_sent_to_a_disarmed_plane() -> None:
    flown = bench("px4").flying(FIRST)
    assert flown.do("return", basic.return_home).failure is None
    flown.block_down = lambda message: message.get_type() in ("HEARTBEAT", "EXTENDED_SYS_STATE")
    flown.run(400.0, lambda: not flown.vehicle.armed)
    flown.block_down = lambda message: message.get_type() == "EXTENDED_SYS_STATE"
    for known in (flown.session.items, ()):
        flown.session._known_vehicle().context.verified_items = known
        assert flown.do("land", basic.land).failure is not None
        assert not flown.vehicle.armed
