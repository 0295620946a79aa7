"""PX4: its dialect, and whole procedures against a simulated vehicle."""

from __future__ import annotations

import math
import struct

import pytest
from flying_bench import FlyingBench, plan
from metric_plans import place
from metric_plans import plan as metric_plan
from profiles import full_only
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.mission import FlightPlan, MissionItem, Waypoint
from swarmctl.core.records import replace
from swarmctl.mavlink.dialects import dialect_for
from swarmctl.mavlink.dialects.px4 import Px4Copter
from swarmctl.mavlink.protocol.mission_upload import UploadOutcome

PX4 = dialect_for(mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_TYPE_QUADROTOR)
OLD, NEW = plan(north=8), plan(north=5, east=0.001, alt=33.333)
ITEM, SET_CURRENT = "MISSION_ITEM_INT", "MISSION_SET_CURRENT"


@pytest.mark.parametrize(
    ("custom_mode", "name"),
    [
        (4 << 16 | 3 << 24, "AUTO.LOITER"),
        (4 << 16 | 4 << 24, "AUTO.MISSION"),
        (4 << 16 | 5 << 24, "AUTO.RTL"),
        (4 << 16 | 6 << 24, "AUTO.LAND"),
        (3 << 16, "POSCTL"),
        (77 << 16 | 9 << 24, "MODE 77/9"),
    ],
)
def test_modes_have_their_names(custom_mode, name):
    assert PX4.mode_name(custom_mode) == name


def test_a_plan_becomes_takeoff_waypoints_land_without_a_home_placeholder():
    short = FlightPlan(20.0, (Waypoint(46.1, 14.1, 25.0),), Waypoint(46.2, 14.2, 25.0))
    items = PX4.mission_items(short, (46.0, 14.0))
    assert [i.command for i in items] == [22, 16, 21]
    assert {i.frame for i in items} == {mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT}
    assert (items[0].x, items[0].y, items[0].z) == (460_000_000, 140_000_000, 20.0)


def test_yaw_is_free_in_flight():
    """PX4 would keep a heading in param4 and reach no waypoint before it faces that heading."""
    items = PX4.mission_items(OLD, (46.0, 14.0))
    assert all(math.isnan(item.param4) for item in items)
    assert items == PX4.mission_items(OLD, (46.0, 14.0))
    bench = FlyingBench("px4", ready_s=0.0).uploaded(OLD)
    assert bench.stored == bench.session.items
    other = struct.unpack("<f", b"\x01\x00\xc0\xff")[0]
    assert PX4.differences((items[1],), (replace(items[1], param4=other),)) == ()
    assert PX4.differences((items[1],), (replace(items[1], param4=0.0),))


def test_a_plan_for_a_vehicle_without_a_position_is_refused():
    with pytest.raises(ValueError, match=r"\[no-position\]"):
        PX4.mission_items(plan())


WP = MissionItem(16, 6, 1, 2, 20.3, 2.7, 5.0, 6.0, 7.0)


@pytest.mark.parametrize(
    ("found", "equal"),
    [
        (WP, True),
        (MissionItem(16, 6, 1, 2, 20.299999237, 2.7, 5.0, 6.0, 7.0), True),
        (MissionItem(16, 3, 1, 2, 20.3, 2.7, 5.0, 6.0, 7.0), True),
        (MissionItem(16, 5, 1, 2, 20.3, 2.7, 5.0, 6.0, 7.0), False),
        (MissionItem(16, 6, 1, 2, 20.29, 2.7, 5.0, 6.0, 7.0), False),
        (MissionItem(16, 6, 1, 2, 20.3, 2.0, 5.0, 6.0, 7.0), False),
        (MissionItem(16, 6, 1, 3, 20.3, 2.7, 5.0, 6.0, 7.0), False),
    ],
)
def test_read_back_is_compared_with_item_0_and_modulo_frames(found, equal):
    assert (PX4.differences((WP,), (found,)) == ()) is equal


def test_a_swap_changes_the_mission_at_once_and_does_not_stop():
    bench = FlyingBench("px4").flying(OLD)
    items = bench.session.mission_items(NEW)
    before_aim, before_s = bench.aim, bench.now
    result, modes, aims = bench.watched_swap(NEW)
    assert (result.failure, result.flying, result.stood_still_s) == (None, "new", 0.0)
    assert bench.now - before_s < 3.0
    assert modes == {"AUTO.MISSION"}
    assert aims <= {before_aim, (items[1].x, items[1].y)}, "the vehicle aimed at another item"
    assert bench.holds((bench.stored[0], *items[1:])), "the take-off lies where the vehicle is"
    assert bench.session.items == bench.stored
    assert bench.vehicle.mission.index == 1
    assert bench.of(SET_CURRENT) == [], "the upload marks the item to fly"


def test_an_autopilot_that_overlooks_the_marked_item_gets_a_message():
    bench = FlyingBench("px4").flying(OLD)
    assert bench.run(60, lambda: bench.session.state.mission_seq == 4)
    take = bench.vehicle.mission.replace
    bench.vehicle.mission.replace = lambda new, current: take(new, -1)
    result = bench.swap(NEW)
    assert result.flying == "new"
    assert [m.seq for m in bench.of(SET_CURRENT)] == [1]
    assert 224 not in bench.commands


@pytest.mark.parametrize("at_item", [None, 0, 3], ids=["at the count", "the first item", "in mid-upload"])
def test_a_vehicle_that_refuses_a_mission_flies_the_old_one_without_a_stop(at_item):
    bench = FlyingBench("px4").flying(OLD)
    old = bench.session.items
    where = "" if at_item is None else f",at_item={at_item}"
    bench.inject(f"mission_refused:result=invalid{where}")
    result = bench.swap(NEW)
    assert (result.flying, result.stood_still_s) == ("old", 0.0)
    assert "INVALID" in result.failure
    assert bench.mode == "AUTO.MISSION"
    assert bench.holds(old)
    assert bench.session.items == bench.stored


@pytest.mark.autopilots("2 upload is atomic?", "2 abandoned upload", of="px4")
def test_an_upload_that_ends_without_an_acknowledgement_leaves_the_old_mission():
    """PX4 gives a transfer up after five seconds and acknowledges nothing."""
    bench = FlyingBench("px4").flying(OLD)
    old = bench.session.items
    bench.block = lambda m: m.get_type() == ITEM and m.seq >= 3
    result = bench.swap(NEW)
    assert (result.flying, result.stood_still_s) == ("old", 0.0)
    assert UploadOutcome.INCOMPLETE.value in result.failure
    assert "item 3" in result.failure
    assert bench.holds(old)
    bench.block = lambda m: False
    assert bench.swap(NEW).flying == "new"


def test_a_takeover_at_the_end_of_the_read_back_is_reported():
    """The last heartbeat still shows the mission."""
    bench = FlyingBench("px4").flying(OLD)

    def is_lost(message):
        if message.get_type() == "MISSION_ACK" and message.type == mavlink.MAV_MISSION_ACCEPTED:
            bench.vehicle.modes.enter(3 << 16)
        return message.get_type() == ITEM and message.seq >= 3

    bench.block = is_lost
    assert bench.swap(NEW).flying == "theirs"
    assert bench.session.state.mode == "POSCTL"


@pytest.mark.parametrize("number", [3 << 16, 4 << 16 | 5 << 24], ids=["POSCTL", "AUTO.RTL"])
def test_a_swap_leaves_a_vehicle_alone_after_a_takeover(number):
    bench = FlyingBench("px4").flying(OLD)
    old = bench.session.items
    bench.vehicle.modes.enter(number)
    bench.run(2)
    before = len(bench.sent)
    assert bench.swap(NEW).flying == "theirs"
    assert len(bench.sent) == before
    assert bench.holds(old)


def test_a_mission_that_the_vehicle_finds_infeasible_ends_with_the_old_one(monkeypatch):
    """PX4 accepts such a mission and then enters hold."""
    bench = FlyingBench("px4").flying(OLD)
    takeoff, *rest = bench.session.mission_items(NEW)
    items = (takeoff, rest[0], takeoff, *rest[1:])
    monkeypatch.setattr(Px4Copter, "mission_items", lambda *_: items)
    result = bench.swap(NEW)
    assert result.flying == "old"
    assert bench.mode == "AUTO.MISSION"
    assert bench.holds(bench.session.items)


def test_a_late_current_item_leaves_out_no_waypoint_of_the_new_plan():
    """The vehicle has just passed a corner, and the last MISSION_CURRENT still names this corner."""
    bench = FlyingBench("px4").flying(metric_plan((0.0, 60.0), (0.0, 120.0), (0.0, 600.0)))
    bench.block_down = lambda m: m.get_type() == "MISSION_CURRENT"
    assert bench.run(60, lambda: place(bench)[1] > 135.0)
    new = metric_plan((0.0, 300.0), (150.0, 300.0), (150.0, 450.0), leaves_ahead=True)
    bench.begin_swap(new)
    bench.run(2.0)
    bench.block_down = lambda m: False
    assert bench.run(60, lambda: bench.session.busy_with is None)
    assert bench.result.flying == "new"
    first = bench.session.mission_items(new)[1]
    assert bench.aim == (first.x, first.y)


def test_a_plan_that_goes_straight_to_a_later_waypoint_of_the_old_one_leaves_out_those_between():
    bench = FlyingBench("px4").flying(metric_plan((0.0, 150.0), (150.0, 300.0), (0.0, 450.0), (0.0, 600.0)))
    assert bench.run(60, lambda: place(bench)[1] > 20.0)
    result = bench.swap(metric_plan((0.0, 450.0), (0.0, 600.0), leaves_ahead=True))
    assert result.flying == "new"
    east_m = []

    def is_down() -> bool:
        east_m.append(abs(place(bench)[0]))
        return not bench.vehicle.armed

    assert bench.run(200, is_down)
    assert max(east_m) < 5.0


@pytest.mark.parametrize(
    ("leaves_ahead", "refused"), [(True, False), *full_only((True, True), (False, False), (False, True))]
)
def test_a_plan_changes_more_than_900_m_from_the_take_off(leaves_ahead, refused, monkeypatch):
    """PX4 1.15 flies no mission whose first position is 900 m (MIS_DIST_1WP) or more from the vehicle."""
    bench = FlyingBench("px4").flying(metric_plan((0.0, 60.0), (0.0, 1100.0), (0.0, 1500.0)))
    assert bench.run(200, lambda: place(bench)[1] > 950.0)
    new = [(0.0, 1150.0), (100.0, 1150.0)] if leaves_ahead else [(20.0, 1010.0), (100.0, 1150.0)]
    second = metric_plan(*new, leaves_ahead=leaves_ahead)
    if refused:  # a take-off after a waypoint
        items = bench.session.mission_items(second)
        monkeypatch.setattr(Px4Copter, "mission_items", lambda *_: (*items[:2], items[0], *items[2:]))
    result = bench.swap(second)
    assert result.flying == ("old" if refused else "new"), result.failure
    assert bench.mode == "AUTO.MISSION"
    assert bench.run(200, lambda: not bench.vehicle.armed)
    assert place(bench) == pytest.approx((0.0, 1500.0) if refused else new[-1], abs=3.0)


def test_an_interrupted_read_back_is_repeated():
    """Without a request for 5 s PX4 ends the transfer; item requests stay unanswered until the next one."""
    bench = FlyingBench("px4").flying(OLD)
    lost = iter(range(7))
    bench.block = lambda m: (
        m.get_type() == "MISSION_REQUEST_INT" and m.seq == 3 and next(lost, None) is not None
    )
    result = bench.swap(NEW)
    assert next(lost, None) is None
    assert (result.failure, result.flying) == (None, "new")
    assert bench.holds((bench.stored[0], *bench.session.mission_items(NEW)[1:]))
    assert [m.count for m in bench.of("MISSION_COUNT")] == [
        len(bench.session.mission_items(p)) for p in (OLD, NEW)
    ]
