"""Behaviour of real autopilots beyond the protocol, each shown on its simulated autopilot."""

from __future__ import annotations

import pytest
from flying_bench import BOTH, Faults, FlyingBench, is_partial_list, plan
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.records import replace
from swarmctl.mavlink.procedures import basic

OLD, NEW = plan(north=8), plan(north=5, east=0.001)


def orders(message) -> bool:
    """Return true if the message changes the vehicle's mode, mission or current item."""
    kind = message.get_type()
    changes = (mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_DO_SET_MISSION_CURRENT)
    return kind == "MISSION_SET_CURRENT" or (kind == "COMMAND_LONG" and message.command in changes)


@BOTH
@pytest.mark.autopilots("1.6")
def test_hold_needs_no_remote_control(personality):
    bench = FlyingBench(personality).flying(OLD)
    assert bench.do("hold", basic.hold).failure is None
    bench.run(10)
    before = bench.vehicle.body.position_m
    bench.run(60)
    assert bench.vehicle.body.position_m == pytest.approx(before, abs=0.5)
    assert bench.session.state.mode_role == "hold"


@BOTH
@pytest.mark.parametrize(
    ("procedure", "role", "modes"),
    [
        (basic.hold, "hold", {"ardupilot": "GUIDED", "px4": "AUTO.LOITER"}),
        (basic.return_home, "return", {"ardupilot": "RTL", "px4": "AUTO.RTL"}),
        (basic.land, "land", {"ardupilot": "LAND", "px4": "AUTO.LAND"}),
    ],
    ids=["hold", "return_home", "land"],
)
def test_an_operators_command_is_seen_in_the_heartbeat(personality, procedure, role, modes):
    bench = FlyingBench(personality).flying(OLD)
    assert bench.do("command", procedure).failure is None
    assert bench.mode == bench.session.state.mode == modes[personality]
    assert bench.session.state.mode_role == role


@BOTH
def test_a_vehicle_that_holds_takes_a_new_mission_and_flies_it(personality):
    bench = FlyingBench(personality).flying(OLD)
    assert bench.do("hold", basic.hold).failure is None
    bench.run(5)
    items = bench.session.mission_items(NEW)
    first = bench.session.dialect.first_waypoint_seq
    result = bench.swap(replace(NEW, from_hold=True))
    assert (result.failure, result.flying) == (None, "new")
    assert bench.holds((bench.stored[0], *items[1:])), "a take-off at item 0 lies where the vehicle is"
    assert bench.aim == (items[first].x, items[first].y)


@pytest.mark.full
@pytest.mark.parametrize(
    ("personality", "mode", "role"),
    [("ardupilot", 9, "land"), ("px4", 4 << 16 | 6 << 24, "land"), ("px4", 4 << 16 | 3 << 24, "hold")],
    ids=["ardupilot", "px4", "px4 holds"],
)
def test_a_pilot_takeover_at_any_moment_of_a_swap_is_respected(personality, mode, role):
    """The mode is one that the swap does not use; the simulated autopilot sets it directly."""
    foreign = 0
    for tenths in range(0, 30, 3):
        bench = FlyingBench(personality).flying(OLD)
        bench.spoil(Faults(max_delay_s=0.2, seed=tenths))
        bench.begin_swap(NEW)
        bench.run(tenths / 10)
        if bench.session.busy_with is None:
            break
        bench.vehicle.modes.enter(mode)
        taken_s, sent = bench.now, len(bench.sent)
        assert bench.run(200, lambda b=bench: b.session.busy_with is None)
        late = [m.get_type() for now, m in bench.sent[sent:] if now > taken_s + 0.25 and orders(m)]
        assert late == []
        assert bench.session.state.mode_role == role
        foreign += bench.result.flying == "theirs"
    assert foreign > 3


@BOTH
@pytest.mark.autopilots("2 shorter mission")
@pytest.mark.autopilots("2 shorter mission", of="px4")
def test_a_mission_shorter_than_the_current_item_is_flown_from_its_first_item(personality):
    """Without a new current item ArduPilot flies on to the deleted position and PX4 to the last item."""
    bench = FlyingBench(personality).flying(OLD)
    bench.block = is_partial_list
    first = bench.session.dialect.first_waypoint_seq
    assert bench.run(100, lambda: bench.session.state.mission_seq == first + 6)
    short = bench.session.mission_items(plan(north=2, east=0.001))
    assert bench.swap(plan(north=2, east=0.001)).flying == "new"
    assert bench.aim == (short[first].x, short[first].y)


@BOTH
def test_the_new_mission_is_flown_although_its_acknowledgements_are_lost(personality):
    bench = FlyingBench(personality).flying(OLD)
    bench.block_down = lambda m: m.get_type() == "MISSION_ACK"
    assert bench.swap(NEW).flying == "new"
    assert bench.holds(bench.session.items)


@pytest.mark.autopilots("2 upload is atomic?", "2 re-upload in AUTO", "2 abandoned upload")
def test_an_upload_abandoned_in_auto_does_not_change_the_flight():
    """ArduPilot stores each item at once; so the swap writes no item in use before the vehicle holds."""
    bench = FlyingBench("ardupilot").flying(OLD)
    old = bench.session.items
    sent = []

    def cut_off(message) -> bool:
        if message.get_type() == "MISSION_ITEM_INT":
            sent.append(message.seq)
        return len(sent) > 2

    bench.block = cut_off
    result, _, aims = bench.watched_swap(NEW)
    assert result.flying == "old", "no message reaches the vehicle, but its messages arrive"
    assert "[no-hold]" in result.failure
    assert aims <= {(i.x, i.y) for i in old} | {None}
    assert bench.stored[1 : len(old)] == old[1:]


@pytest.mark.autopilots("2 abandoned upload", of="px4")
def test_an_upload_that_px4_gave_up_is_repeated():
    bench = FlyingBench("px4").uploaded(OLD)
    bench.block = lambda m: m.get_type() == "MISSION_ITEM_INT" and bench.now < quiet_s
    quiet_s = bench.now + 4.0
    items = bench.session.mission_items(NEW)
    assert bench.upload_items(items).failure is None
    assert bench.holds(items)
