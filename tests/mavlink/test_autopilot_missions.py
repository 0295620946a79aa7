"""The mission protocol in each autopilot's variant: answers, stored items and reports."""

from __future__ import annotations

import math

import pytest
from flying_bench import BOTH, Faults, FlyingBench, plan
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.mission import MissionItem
from swarmctl.core.records import replace
from swarmctl.mavlink.procedures import basic

OLD = plan(north=8, alt=33.333)
RELATIVE = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT


def with_item(bench: FlyingBench, **changes: object) -> tuple[MissionItem, ...]:
    """Return a short mission with changes in the second-last item."""
    *rest, spoilt, land = bench.session.mission_items(plan(north=2))
    return (*rest, replace(spoilt, **changes), land)


@pytest.mark.autopilots("2 item 0")
def test_a_mission_without_an_item_for_home_fails_its_read_back():
    """ArduPilot answers ACCEPTED and writes home over the take-off."""
    bench = FlyingBench("ardupilot").prepared()
    items = bench.session.mission_items(OLD)[1:]
    failure = bench.upload_items(items).failure
    assert "[read-back-differs]" in failure
    assert "item 0" in failure
    assert [i.command for i in bench.stored[:2]] == [16, 16], "the take-off is still there"
    assert bench.session.items == ()
    assert "[no-mission]" in bench.do("launch", basic.launch).failure


@pytest.mark.autopilots("2 item 0")
@pytest.mark.autopilots("2 item 0", of="px4")
@pytest.mark.parametrize(("personality", "takeoff"), [("ardupilot", 1), ("px4", 0)])
def test_a_plan_has_its_take_off_at_the_item_of_its_autopilot(personality, takeoff):
    bench = FlyingBench(personality).uploaded(OLD)
    assert [i.command for i in bench.stored].index(mavlink.MAV_CMD_NAV_TAKEOFF) == takeoff
    assert bench.session.dialect.first_waypoint_seq == takeoff + 1


@pytest.mark.autopilots("2 count")
@pytest.mark.autopilots("2 count", of="px4")
@pytest.mark.parametrize(("personality", "before", "after"), [("ardupilot", 0, 10), ("px4", None, 10)])
def test_the_count_of_items_includes_home_or_not(personality, before, after):
    """The plan has ten items with take-off and landing. ArduPilot's list holds home, its total does not."""
    bench = FlyingBench(personality).prepared()
    bench.run(3)
    assert bench.session.state.mission_total == before
    items = bench.session.mission_items(OLD)
    assert bench.upload_items(items).failure is None
    bench.run(3)
    assert bench.session.state.mission_total == after
    assert bench.of("MISSION_COUNT")[-1].count == len(items) == after + (personality == "ardupilot")


@pytest.mark.autopilots("2 requests")
@pytest.mark.autopilots("2 requests", of="px4")
@pytest.mark.parametrize(
    ("personality", "old_kind", "new_kind"), [("ardupilot", 11, 0), ("px4", 1, 9)], ids=["ardupilot", "px4"]
)
def test_both_kinds_of_request_get_the_same_answer(personality, old_kind, new_kind):
    bench = FlyingBench(personality).prepared()
    asked = []
    bench.block_down = lambda m: asked.append(m.get_type())
    assert bench.upload(OLD).failure is None
    assert (asked.count("MISSION_REQUEST"), asked.count("MISSION_REQUEST_INT")) == (old_kind, new_kind)
    assert len(bench.of("MISSION_ITEM_INT")) == old_kind + new_kind


@BOTH
@pytest.mark.autopilots("2 wrong / duplicate item")
@pytest.mark.autopilots("2 wrong / duplicate item", of="px4")
@pytest.mark.parametrize("seed", range(4))
def test_duplicated_messages_count_once(personality, seed):
    """ArduPilot answers each duplicate with an error and goes on, also after the last item."""
    bench = FlyingBench(personality).prepared()
    bench.spoil(Faults(doubling=1.0, max_delay_s=0.2, seed=seed))
    codes = []
    bench.block_down = lambda m: m.get_type() == "MISSION_ACK" and codes.append(m.type)
    items = bench.session.mission_items(OLD)
    assert bench.upload_items(items).failure is None
    assert bench.holds(items)
    assert (mavlink.MAV_MISSION_INVALID_SEQUENCE in codes) == (personality == "ardupilot")


@BOTH
@pytest.mark.autopilots("2 wrong / duplicate item", "2 upload is atomic?")
@pytest.mark.autopilots("2 wrong / duplicate item", "2 upload is atomic?", of="px4")
def test_a_lost_final_acknowledgement_is_replaced_by_the_read_back(personality):
    bench = FlyingBench(personality).prepared()
    bench.block_down = lambda m: m.get_type() == "MISSION_ACK"
    items = bench.session.mission_items(OLD)
    assert bench.upload_items(items).failure is None
    assert bench.holds(items)
    assert len(bench.of("MISSION_COUNT")) == 1


@pytest.mark.autopilots("2 second GCS / download during upload", "2 abandoned upload")
def test_an_upload_waits_until_another_stations_transfer_has_ended():
    bench = FlyingBench("ardupilot").prepared()
    codes = []
    bench.block_down = lambda m: m.get_type() == "MISSION_ACK" and codes.append(m.type)
    bench.another_sends(mavlink.MAVLink_mission_count_message(1, 1, 5, 0))
    began_s, items = bench.now, bench.session.mission_items(OLD)
    assert bench.upload_items(items).failure is None
    assert mavlink.MAV_MISSION_DENIED in codes
    assert 8.0 < bench.now - began_s < 25.0
    assert bench.holds(items)


@pytest.mark.autopilots("2 second GCS / download during upload", "2 abandoned upload", of="px4")
def test_an_upload_that_px4_still_expects_does_not_disturb_the_next():
    """PX4 keeps the old count or answers ERROR. After 5 s it gives the transfer up without a message."""
    bench = FlyingBench("px4").prepared()
    first = bench.session.mission_items(OLD)
    bench.begin("upload", lambda c: basic.upload(c, first))
    bench.block = lambda m: m.get_type() in ("MISSION_ACK", "MISSION_ITEM_INT")
    bench.run(0.3)
    bench.take(bench.session.cancel(bench.now))  # the cancellation is lost as well
    bench.block = lambda m: False
    items = bench.session.mission_items(plan(north=3))
    assert bench.upload_items(items).failure is None
    assert bench.holds(items)


@BOTH
@pytest.mark.autopilots("2 error codes")
@pytest.mark.autopilots("2 error codes", of="px4")
@pytest.mark.parametrize(
    ("changes", "ardupilot", "px4"),
    [
        ({"command": 4711}, "UNSUPPORTED", "UNSUPPORTED"),
        ({"frame": mavlink.MAV_FRAME_LOCAL_NED}, "UNSUPPORTED_FRAME", "UNSUPPORTED_FRAME"),
        ({"x": 1_000_000_000}, "INVALID_PARAM5_X", None),
        ({"z": math.nan}, "INVALID_PARAM7", "[read-back-differs]"),
    ],
    ids=["a command", "a frame", "a latitude", "no altitude"],
)
def test_a_refusal_has_its_mavlink_name_and_an_accepted_item_is_compared(
    personality, changes, ardupilot, px4
):
    """PX4 accepts a latitude of 100 degrees and a missing altitude; `track_to_land` prevents such plans."""
    bench = FlyingBench(personality).prepared()
    failure = bench.upload_items(with_item(bench, **changes)).failure
    code = {"ardupilot": ardupilot, "px4": px4}[personality]
    assert (failure is None) if code is None else (code in failure)
    assert (bench.session.items == ()) == (failure is not None)


@BOTH
@pytest.mark.autopilots("2 RTL item")
@pytest.mark.autopilots("2 RTL item", of="px4")
@pytest.mark.parametrize("frame", [mavlink.MAV_FRAME_MISSION, RELATIVE])
def test_a_return_as_an_item_is_in_frame_mission_to_px4(personality, frame):
    bench = FlyingBench(personality).prepared()
    *rest, _land = bench.session.mission_items(OLD)
    rtl = MissionItem(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH, frame, 0, 0, 0.0)
    failure = bench.upload_items((*rest, rtl)).failure
    if (personality, frame) == ("px4", RELATIVE):
        assert "UNSUPPORTED" in failure
    else:
        assert failure is None


@BOTH
@pytest.mark.autopilots("2 read-back")
@pytest.mark.autopilots("2 read-back", of="px4")
@pytest.mark.parametrize("alt", [20.3, 33.333])
def test_rounding_of_an_altitude_is_no_difference_but_a_further_centimetre_is(personality, alt):
    bench = FlyingBench(personality).prepared()
    items = bench.session.mission_items(plan(north=3, alt=alt))
    assert bench.upload_items(items).failure is None
    dialect = bench.session.dialect
    moved = (*bench.stored[:-2], replace(bench.stored[-2], z=bench.stored[-2].z - 0.02), bench.stored[-1])
    assert dialect.differences(items, bench.stored) == ()
    assert dialect.differences(items, moved) != ()


@BOTH
@pytest.mark.autopilots("2 re-upload in AUTO", "2 DO_SET_MISSION_CURRENT", "2 MISSION_WRITE_PARTIAL_LIST")
@pytest.mark.autopilots("2 re-upload in AUTO", "2 MISSION_SET_CURRENT", of="px4")
def test_the_flown_item_is_never_overwritten_and_the_next_is_set_by_a_known_message(personality):
    bench = FlyingBench(personality).flying(OLD)
    old, sent = bench.session.items, len(bench.sent)
    new = plan(north=5, east=0.001)
    first = bench.session.mission_items(new)[bench.session.dialect.first_waypoint_seq]
    result, _, aims = bench.watched_swap(new)
    assert result.flying == "new"
    assert aims <= {(i.x, i.y) for i in old} | {(first.x, first.y)}
    written = {m.seq for _, m in bench.sent[sent:] if m.get_type() == "MISSION_ITEM_INT"}
    if personality == "ardupilot":
        assert min(written) == len(old), "items before the end of the old mission were written"
        assert bench.commands[-10:].count(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT) == 1
    else:
        marked = [m.seq for _, m in bench.sent[sent:] if m.get_type() == "MISSION_ITEM_INT" and m.current]
        assert marked == [1]
        assert mavlink.MAV_CMD_DO_SET_MISSION_CURRENT not in bench.commands


@pytest.mark.autopilots("2 MISSION_SET_CURRENT", of="px4")
def test_px4_gets_its_first_item_by_message_and_confirms_it():
    """PX4 keeps its current item after a landing and after an upload of the same mission."""
    bench = FlyingBench("px4").flying(OLD)
    assert bench.do("land", basic.land).failure is None
    assert bench.run(120, lambda: not bench.session.state.armed)
    assert bench.vehicle.mission.index > 0
    again = bench.session.items
    assert bench.do("prepare", basic.prepare).failure is None
    assert bench.upload_items(again).failure is None
    lost = []
    bench.block = lambda m: (
        m.get_type() == "MISSION_SET_CURRENT" and len(lost) < 2 and not lost.append(bench.now)
    )
    assert bench.do("launch", basic.launch).failure is None
    assert [m.seq for m in bench.of("MISSION_SET_CURRENT")] == [0, 0, 0]
    assert lost[1] - lost[0] >= 1.0, "no acknowledgement exists: the wait is one second"


CLEARINGS = {
    "CLEAR_ALL": mavlink.MAVLink_mission_clear_all_message(1, 1, 0),
    "a count of 0": mavlink.MAVLink_mission_count_message(1, 1, 0, 0),
}
READ_ONLY = {"MISSION_REQUEST_INT", "MISSION_REQUEST_LIST", "MISSION_ACK"}
"""The station's mission messages that change no mission."""


def orders_of(bench: FlyingBench, sent: int) -> list[str]:
    """Return the types of the messages after the first `sent` that would change the vehicle's behaviour."""
    request = mavlink.MAV_CMD_REQUEST_MESSAGE
    return [
        m.get_type()
        for _, m in bench.sent[sent:]
        if m.get_type() not in READ_ONLY and getattr(m, "command", 0) != request
    ]


@pytest.mark.autopilots("2 CLEAR_ALL", of="px4")
@pytest.mark.parametrize("how", CLEARINGS)
@pytest.mark.parametrize("before_s", [5.0, 0.0])
def test_a_px4_is_released_if_its_mission_is_cleared_before_a_swap(how, before_s):
    bench = FlyingBench("px4").flying(OLD)
    sent = len(bench.sent)
    bench.another_sends(CLEARINGS[how])
    bench.run(before_s)
    assert bench.session.state.other_mission == (before_s > 0.0)
    assert (bench.session.items == ()) == (before_s > 0.0), "the own mission still counts as present"
    result = bench.swap(plan(north=5, east=0.001))
    assert (result.flying, bench.mode, bench.stored) == ("theirs", "AUTO.LOITER", ())
    assert bench.aim is None
    assert ("AUTO.LOITER" in result.failure) or before_s == 0.0
    assert orders_of(bench, sent) == []


@pytest.mark.autopilots("2 CLEAR_ALL")
def test_a_flying_ardupilot_refuses_to_clear_its_mission():
    bench = FlyingBench("ardupilot").flying(OLD)
    codes, ours, sent = [], bench.session.items, len(bench.sent)
    bench.block_down = lambda m: m.get_type() == "MISSION_ACK" and codes.append(m.type)
    bench.another_sends(CLEARINGS["CLEAR_ALL"])
    bench.run(15)
    assert codes == [mavlink.MAV_MISSION_ERROR]
    assert bench.holds(ours)
    assert (bench.mode, bench.session.items) == ("AUTO", ours)
    assert not bench.session.state.other_mission
    assert bench.session.state.mission_seq > 3, "the vehicle does not fly on"
    assert orders_of(bench, sent) == []


@pytest.mark.autopilots("2 CLEAR_ALL")
def test_an_ardupilot_stops_at_a_count_of_0_and_is_released():
    """The vehicle's mode stays AUTO."""
    bench = FlyingBench("ardupilot").flying(OLD)
    sent = len(bench.sent)
    bench.another_sends(CLEARINGS["a count of 0"])
    bench.run(15)
    assert (bench.stored, bench.mode, bench.aim) == ((), "AUTO", None)
    assert bench.session.state.ground_speed_m_s < 0.5
    assert bench.session.items == ()
    assert bench.session.state.other_mission
    assert orders_of(bench, sent) == []


@pytest.mark.autopilots("2 CLEAR_ALL")
def test_an_ardupilot_is_released_if_its_mission_is_cleared_before_a_swap():
    """The vehicle's mode stays AUTO, but the mission to append to is gone."""
    bench = FlyingBench("ardupilot").flying(OLD)
    sent = len(bench.sent)
    bench.another_sends(CLEARINGS["a count of 0"])
    result = bench.swap(plan(north=5, east=0.001))
    assert (result.flying, bench.mode, bench.stored) == ("theirs", "AUTO", ())
    assert "[mission-changed]" in result.failure
    assert bench.session.items == ()
    assert {*orders_of(bench, sent)} <= {"MISSION_WRITE_PARTIAL_LIST", "MISSION_ITEM_INT"}, "all refused"
