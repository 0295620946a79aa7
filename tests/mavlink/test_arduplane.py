"""ArduPlane, flown by the simulator: taken off, changed in flight, held, called back and landed."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import pytest
from flying_bench import HOME, FlyingBench
from plane_flights import (
    FIRST,
    LOW_M,
    RADIUS_M,
    SECOND,
    bench,
    here,
    landed,
    nearest_m,
)
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.mission import FlightPlan, MissionItem
from swarmctl.core.vehicle import Landed
from swarmctl.mavlink.dialects import dialect_for
from swarmctl.mavlink.procedures import basic
from swarmctl.mavlink.procedures.basic import set_speed
from swarmctl.mavlink.procedures.land import landing_items

PLANE = dialect_for(mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, mavlink.MAV_TYPE_FIXED_WING)


def in_flight(first: FlightPlan = FIRST) -> FlyingBench:
    return bench().flying(first)


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


@pytest.mark.parametrize(
    ("autopilot", "kind", "which", "cure"),
    [
        (mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, mavlink.MAV_TYPE_QUADROTOR, FIRST, "airframe: copter"),
        (mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_TYPE_QUADROTOR, FIRST, "airframe: copter"),
        (
            mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
            mavlink.MAV_TYPE_FIXED_WING,
            FlightPlan(40.0, FIRST.track, FIRST.landing),
            "airframe: plane",
        ),
    ],
)
def test_a_plan_for_another_airframe_is_refused(autopilot, kind, which, cure) -> None:
    with pytest.raises(ValueError, match=cure):
        dialect_for(autopilot, kind).mission_items(which, HOME)


def test_a_read_back_equals_the_mission_sent_except_for_storage() -> None:
    sent = (*PLANE.mission_items(FIRST),)
    stored = bench().uploaded(FIRST).stored
    assert stored != sent
    assert PLANE.differences(sent, stored) == ()
    wider = replace(stored[3], param2=stored[3].param2 + 1.0)
    assert PLANE.differences(sent, (*stored[:3], wider, *stored[4:])), (
        "the turning point counts as a difference"
    )
    other_way = replace(stored[6], param2=-RADIUS_M)
    assert PLANE.differences(sent, (*stored[:6], other_way, *stored[7:]))


# --- flights


def test_a_launch_begins_at_the_first_item() -> None:
    flown = bench().uploaded(FIRST)
    flown.vehicle.set_current(6)
    assert flown.do("launch", basic.launch).failure is None
    assert flown.session.state.mission_seq == 1


def test_the_plane_lands_at_its_goal_and_is_made_ready_again_there() -> None:
    flown = in_flight()
    assert landed(flown)
    assert math.dist(here(flown), (400.0, 900.0)) < 60.0
    # ArduPlane stays in its landing item and refuses to arm there (`AP_Arming_Plane::pre_arm_checks`).
    assert flown.do("prepare", basic.prepare, 60.0).failure is None
    assert flown.mode == "GUIDED"
    assert flown.session.state.mission_seq == 1
    assert flown.upload(FIRST).failure is None
    assert flown.do("launch", basic.launch).failure is None


def test_a_new_route_is_taken_over_without_a_stop() -> None:
    flown = in_flight()
    done = flown.swap(SECOND)
    assert (done.failure, done.flying) == (None, "new")
    assert flown.mode == "AUTO"
    assert nearest_m(flown, (-200.0, 700.0), 60.0) < 45.0
    assert landed(flown)
    assert math.dist(here(flown), (400.0, 900.0)) < 60.0


def test_a_plane_holds_in_a_circle_at_its_height() -> None:
    flown = in_flight()
    assert flown.do("hold", basic.hold).failure is None
    centre = here(flown)
    flown.run(30.0)
    away_m, heights_m = [], []

    def measure() -> bool:
        away_m.append(math.dist(here(flown), centre))
        heights_m.append(flown.session.state.alt_rel_m)
        return False

    flown.run(60.0, measure)
    assert flown.mode == "GUIDED"
    assert max(away_m) < RADIUS_M + 40.0, "the circle lies a moment ahead of the command"
    assert max(heights_m) - min(heights_m) < 3.0
    assert flown.session.state.landed is Landed.IN_AIR


def test_the_route_of_a_holding_plane_is_changed() -> None:
    flown = in_flight()
    assert flown.do("hold", basic.hold).failure is None
    done = flown.swap(replace(SECOND, from_hold=True))
    assert (done.failure, done.flying) == (None, "new")
    assert landed(flown)
    assert math.dist(here(flown), (400.0, 900.0)) < 60.0


def test_a_plane_returns_and_lands_at_home() -> None:
    flown = in_flight()
    assert flown.do("return", basic.return_home).failure is None
    assert flown.mode == "RTL"
    assert landed(flown)
    assert math.dist(here(flown), (0.0, 0.0)) < 60.0


def test_a_command_to_land_leads_to_the_nearest_landing() -> None:
    flown = in_flight()
    assert flown.do("land", basic.land).failure is None
    assert flown.mode == "AUTO"
    assert flown.session.state.mission_seq in landing_items(flown.session.items)
    assert landed(flown)
    assert math.dist(here(flown), (0.0, 0.0)) < 60.0


def test_a_command_to_land_during_a_landing_causes_no_go_around() -> None:
    flown = bench().uploaded(FIRST)
    assert flown.do("launch", basic.launch).failure is None
    assert flown.run(300.0, lambda: flown.session.state.mission_seq == 8), "no final approach"
    sent = len(flown.commands)
    assert flown.do("land", basic.land).failure is None
    assert mavlink.MAV_CMD_DO_LAND_START not in flown.commands[sent:]
    assert landed(flown, 60.0)


def test_a_command_to_land_on_the_ground_disarms() -> None:
    flown = bench().uploaded(FIRST)
    flown.vehicle.arm(flown.now, force=True)
    assert flown.run(5.0, lambda: flown.session.state.armed)
    assert flown.do("land", basic.land).failure is None
    assert not flown.vehicle.armed
    assert mavlink.MAV_CMD_DO_LAND_START not in flown.commands


def test_a_plane_without_a_landing_reports_that_it_does_not_land() -> None:
    flown = in_flight()
    del flown.vehicle.mission.items[5:]
    failure = flown.do("land", basic.land).failure
    assert failure is not None
    assert "FAILED" in failure


def test_the_set_speed_is_the_airspeed() -> None:
    flown = in_flight()
    assert flown.do("speed", partial(set_speed, speed_m_s=12.0)).failure is None
    (message,) = [m for m in flown.of("COMMAND_LONG") if m.command == mavlink.MAV_CMD_DO_CHANGE_SPEED]
    assert message.param1 == mavlink.SPEED_TYPE_AIRSPEED
    flown.run(10.0)
    assert flown.session.state.ground_speed_m_s == pytest.approx(12.0, abs=0.3)


def test_items_outside_a_landing_do_not_belong_to_it() -> None:
    waypoint = MissionItem(16, 3, 1, 1, 40.0)
    start, down = replace(waypoint, command=189), replace(waypoint, command=21)
    assert landing_items((waypoint, start, waypoint, down, waypoint)) == {1, 2, 3}
    assert landing_items((waypoint, down)) == frozenset()
