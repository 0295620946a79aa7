"""Closed list of the messages to each autopilot, from its first heartbeat to its last landing.

Features on which the autopilots differ are not used, or only on the autopilot where they are reliable.
"""

from __future__ import annotations

from functools import partial

import pytest
from flying_bench import HOME, FlyingBench, plan
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.mavlink.procedures import basic
from swarmctl.mavlink.procedures.basic import set_speed
from swarmctl.mavlink.procedures.fence import enable_fence, fence_items, put_fence, read_fence
from swarmctl.mavlink.procedures.rally import count_rally_points
from swarmctl.mavlink.protocol.parameters import set_parameters
from swarmctl.mavlink.telemetry.instruments import read_instruments

COMMON = {
    "COMMAND_LONG",
    "MISSION_COUNT",
    "MISSION_ITEM_INT",
    "MISSION_ACK",
    "MISSION_REQUEST_LIST",
    "MISSION_REQUEST_INT",
    "PARAM_REQUEST_READ",
    "PARAM_SET",
}
MESSAGES = {
    "ardupilot": COMMON | {"MISSION_WRITE_PARTIAL_LIST"},
    "px4": COMMON | {"MISSION_SET_CURRENT"},
}
COMMON_COMMANDS = {
    mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
    mavlink.MAV_CMD_DO_SET_MODE,
    mavlink.MAV_CMD_DO_CHANGE_SPEED,
    mavlink.MAV_CMD_REQUEST_MESSAGE,
    mavlink.MAV_CMD_SET_MESSAGE_INTERVAL,
}
COMMANDS = {
    "ardupilot": COMMON_COMMANDS
    | {
        mavlink.MAV_CMD_MISSION_START,
        mavlink.MAV_CMD_DO_SET_MISSION_CURRENT,
        mavlink.MAV_CMD_DO_FENCE_ENABLE,
    },
    "px4": COMMON_COMMANDS,
}
WHOLE = {"ardupilot": "DISARM_DELAY", "px4": "COM_LOW_BAT_ACT"}
RELATIVE = {mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT}
SQUARE = tuple(
    (HOME[0] + a * 0.05, HOME[1] + b * 0.05) for a, b in ((-1.0, -1.0), (-1.0, 1.0), (1.0, 1.0), (1.0, -1.0))
)


def whole_flight(personality: str) -> FlyingBench:
    """Return a bench after every procedure has run, once with success and once with a failure."""
    bench = FlyingBench(personality).prepared()
    bench.do("identify", basic.identify)
    bench.do("instruments", read_instruments)
    assert bench.do("set", partial(set_parameters, wanted={WHOLE[personality]: 3.0})).failure is None
    assert bench.do("fence", partial(put_fence, items=fence_items(SQUARE))).failure is None
    if personality == "ardupilot":
        assert bench.do("enable fence", enable_fence).failure is None
    bench.do("read fence", read_fence)
    assert bench.do("rally points", count_rally_points).count == 0
    assert bench.upload(plan(north=8)).failure is None
    for _ in range(2):  # once from the first item, once from the current item
        assert bench.do("launch", basic.launch).failure is None
        assert bench.run(60, lambda: bench.session.state.mission_seq == 3)
        assert bench.do("land", basic.land).failure is None
        assert bench.run(120, lambda: not bench.session.state.armed)
        assert bench.do("prepare", basic.prepare).failure is None
    assert bench.do("launch", basic.launch).failure is None
    assert bench.run(60, lambda: bench.session.state.mission_seq == 3)
    assert bench.swap(plan(north=7, east=0.001)).flying == "new"
    assert bench.do("speed", partial(set_speed, speed_m_s=4.0)).failure is None
    bench.inject("mission_refused:result=invalid")
    bench.block = lambda m: m.get_type() == "MISSION_WRITE_PARTIAL_LIST"
    assert bench.swap(plan(north=6)).flying != "new"
    assert bench.do("hold", basic.hold).failure is None
    assert bench.swap(plan(north=5, east=0.001)).flying != "new"
    assert bench.do("return", basic.return_home).failure is None
    assert bench.do("land", basic.land).failure is None
    assert bench.run(120, lambda: not bench.session.state.armed)
    return bench


@pytest.fixture(scope="module", params=["ardupilot", "px4"])
def after_all_procedures(request: pytest.FixtureRequest) -> tuple[str, FlyingBench]:
    return request.param, whole_flight(request.param)


@pytest.mark.autopilots("1.5", "1.17", "2 CLEAR_ALL", "2 MISSION_SET_CURRENT", "2 pause/continue")
@pytest.mark.autopilots("1.17", "2 CLEAR_ALL", "2 MISSION_WRITE_PARTIAL_LIST", "2 pause/continue", of="px4")
@pytest.mark.autopilots("2 DO_SET_MISSION_CURRENT", "2 fence use", of="px4")
def test_only_the_listed_messages_and_commands_are_sent(after_all_procedures):
    """No SET_MODE (ArduPilot does not acknowledge it), DO_REPOSITION, CLEAR_ALL or pause is sent.

    PX4 gets no partial list, DO_FENCE_ENABLE or DO_SET_MISSION_CURRENT: these are unknown to PX4.
    """
    personality, bench = after_all_procedures
    assert {m.get_type() for _, m in bench.sent} == MESSAGES[personality]
    assert set(bench.commands) == COMMANDS[personality]


@pytest.mark.autopilots("1.15")
def test_all_messages_are_addressed_to_the_autopilot(after_all_procedures):
    """An autopilot also obeys messages to another component, which may exist."""
    _, bench = after_all_procedures
    assert {(m.target_system, m.target_component) for _, m in bench.sent} == {(1, 1)}


@pytest.mark.autopilots("1.14")
@pytest.mark.autopilots("1.14", of="px4")
def test_no_vehicle_is_armed_or_disarmed_by_force(after_all_procedures):
    _, bench = after_all_procedures
    arming = [m for m in bench.of("COMMAND_LONG") if m.command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM]
    assert [(m.param1, m.param2) for m in arming] == [(1.0, 0.0)] * 3


@pytest.mark.autopilots("1.9", "2 types 2 / 3 / 255")
@pytest.mark.autopilots("2 types 2 / 3 / 255", of="px4")
def test_missions_and_fences_are_sent_whole_and_never_empty(after_all_procedures):
    """An empty mission makes AUTO loiter in the air; a list of type 255 clears everything, or nothing."""
    _, bench = after_all_procedures
    requests = ("MISSION_REQUEST_LIST", "MISSION_REQUEST_INT", "MISSION_ACK")  # of rally points, too
    lists = [m for _, m in bench.sent if hasattr(m, "mission_type") and m.get_type() not in requests]
    assert {m.mission_type for m in lists} == {
        mavlink.MAV_MISSION_TYPE_MISSION,
        mavlink.MAV_MISSION_TYPE_FENCE,
    }
    assert min(m.count for m in bench.of("MISSION_COUNT")) >= 3


@pytest.mark.autopilots("2 frame 2 on a WP", "2 RTL item")
def test_places_are_above_home_and_a_return_is_no_item(after_all_procedures):
    """A waypoint in another frame would be flown above mean sea level; a return as an item shows no mode."""
    personality, bench = after_all_procedures
    items = [m for m in bench.of("MISSION_ITEM_INT") if m.mission_type == mavlink.MAV_MISSION_TYPE_MISSION]
    placed = [m for m in items if personality == "px4" or m.seq > 0]
    assert {m.frame for m in placed} <= RELATIVE
    assert {m.command for m in items} == {16, 21, 22}
