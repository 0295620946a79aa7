"""Closed list of the messages to each autopilot, from its first heartbeat to its last landing.

Much of what an autopilot does in its own way is never asked of it, or only of the one that does it well.
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
EVERYBODY = {
    mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
    mavlink.MAV_CMD_DO_SET_MODE,
    mavlink.MAV_CMD_DO_CHANGE_SPEED,
    mavlink.MAV_CMD_REQUEST_MESSAGE,
    mavlink.MAV_CMD_SET_MESSAGE_INTERVAL,
}
COMMANDS = {
    "ardupilot": EVERYBODY
    | {
        mavlink.MAV_CMD_MISSION_START,
        mavlink.MAV_CMD_DO_SET_MISSION_CURRENT,
        mavlink.MAV_CMD_DO_FENCE_ENABLE,
    },
    "px4": EVERYBODY,
}
WHOLE = {"ardupilot": "DISARM_DELAY", "px4": "COM_LOW_BAT_ACT"}
RELATIVE = {mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT}
SQUARE = tuple(
    (HOME[0] + a * 0.05, HOME[1] + b * 0.05) for a, b in ((-1.0, -1.0), (-1.0, 1.0), (1.0, 1.0), (1.0, -1.0))
)


def life(personality: str) -> FlyingBench:
    """Everything that is ever done with a vehicle, by the way that succeeds and one that fails."""
    bench = FlyingBench(personality).prepared()
    bench.do("identify", basic.identify)
    bench.do("instruments", read_instruments)
    wanted = {WHOLE[personality]: 3.0}
    assert bench.do("set", partial(set_parameters, wanted=wanted, byte_wise=bench.byte_wise)).failure is None
    assert bench.do("fence", partial(put_fence, items=fence_items(SQUARE))).failure is None
    if personality == "ardupilot":
        assert bench.do("enable fence", enable_fence).failure is None
    bench.do("read fence", read_fence)
    assert bench.do("rally points", count_rally_points).count == 0
    assert bench.upload(plan(north=8)).failure is None
    for _ in range(2):  # once from its beginning, once from where it was
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
def lived(request: pytest.FixtureRequest) -> tuple[str, FlyingBench]:
    return request.param, life(request.param)


@pytest.mark.autopilots("1.5", "1.17", "2 CLEAR_ALL", "2 MISSION_SET_CURRENT", "2 pause/continue")
@pytest.mark.autopilots("1.17", "2 CLEAR_ALL", "2 MISSION_WRITE_PARTIAL_LIST", "2 pause/continue", of="px4")
@pytest.mark.autopilots("2 DO_SET_MISSION_CURRENT", "2 fence use", of="px4")
def test_no_other_message_and_no_other_command_is_sent(lived):
    """No SET_MODE, which ArduPilot does not acknowledge; no DO_REPOSITION, CLEAR_ALL or pause. To PX4 no
    partial list, DO_FENCE_ENABLE or DO_SET_MISSION_CURRENT, none of which it knows."""
    personality, bench = lived
    assert {m.get_type() for _, m in bench.sent} == MESSAGES[personality]
    assert set(bench.commands) == COMMANDS[personality]


@pytest.mark.autopilots("1.15")
def test_all_messages_are_addressed_to_the_autopilot(lived):
    """It would do as well what is for another component, of which there may be one."""
    _, bench = lived
    assert {(m.target_system, m.target_component) for _, m in bench.sent} == {(1, 1)}


@pytest.mark.autopilots("1.14")
@pytest.mark.autopilots("1.14", of="px4")
def test_no_vehicle_is_armed_or_disarmed_by_force(lived):
    _, bench = lived
    arming = [m for m in bench.of("COMMAND_LONG") if m.command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM]
    assert [(m.param1, m.param2) for m in arming] == [(1.0, 0.0)] * 3


@pytest.mark.autopilots("1.9", "2 types 2 / 3 / 255")
@pytest.mark.autopilots("2 types 2 / 3 / 255", of="px4")
def test_missions_and_fences_are_sent_whole_and_never_empty(lived):
    """An empty mission makes AUTO loiter in the air; a list of type 255 clears everything, or nothing."""
    _, bench = lived
    asks = ("MISSION_REQUEST_LIST", "MISSION_REQUEST_INT", "MISSION_ACK")  # of rally points, too
    lists = [m for _, m in bench.sent if hasattr(m, "mission_type") and m.get_type() not in asks]
    assert {m.mission_type for m in lists} == {
        mavlink.MAV_MISSION_TYPE_MISSION,
        mavlink.MAV_MISSION_TYPE_FENCE,
    }
    assert min(m.count for m in bench.of("MISSION_COUNT")) >= 3


@pytest.mark.autopilots("2 frame 2 on a WP", "2 RTL item")
def test_places_are_above_home_and_a_return_is_no_item(lived):
    """A waypoint in another frame would be flown above mean sea level; a return as an item shows no mode."""
    personality, bench = lived
    items = [m for m in bench.of("MISSION_ITEM_INT") if m.mission_type == mavlink.MAV_MISSION_TYPE_MISSION]
    placed = [m for m in items if personality == "px4" or m.seq > 0]
    assert {m.frame for m in placed} <= RELATIVE
    assert {m.command for m in items} == {16, 21, 22}
