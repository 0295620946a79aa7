"""From boot to take-off on each autopilot: missing messages, undone modes, refusals and a moved home."""

from __future__ import annotations

import pytest
from flying_bench import ALT_M, BOTH, Faults, FlyingBench, on_the_ground, plan
from profiles import full_only
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.core.events import Rebooted
from swarmctl.core.vehicle import Landed
from swarmctl.mavlink.procedures import basic
from swarmctl.mavlink.protocol.codec import FrameSplitter

OLD = plan(north=8)
ARM, START, MODE = (
    mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
    mavlink.MAV_CMD_MISSION_START,
    mavlink.MAV_CMD_DO_SET_MODE,
)


@pytest.mark.autopilots("1.1")
def test_the_identity_is_requested_at_the_start_and_after_a_reboot():
    bench = FlyingBench("ardupilot")
    assert bench.run(30, lambda: bench.session.state.mode != "")
    bench.run(10)
    assert not bench.session.state.has_position
    assert "no EKF_STATUS_REPORT" in bench.session.state.not_ready[-1]
    bench.connected()
    assert bench.run(5, lambda: bench.session.state.has_position)
    bench.run(20)
    bench.inject("reboot:silence_s=1.5")
    assert bench.run(15, lambda: Rebooted() in bench.events), (
        "the requested messages hold the clock, which shows the reboot"
    )
    asked = len(bench.of("COMMAND_LONG"))
    assert bench.run(5, lambda: bench.session.state.has_position)
    wanted = bench.session.dialect.streams_hz
    assert {int(m.param1) for m in bench.of("COMMAND_LONG")[:asked] if m.command == 511} == set(wanted)


@pytest.mark.autopilots("1.2")
def test_boot_text_is_neither_a_message_nor_a_vehicle():
    bench = on_the_ground("ardupilot")
    data: list[bytes] = []
    bench.on_datagram = data.append
    events = len(bench.events)
    bench.inject("reboot:silence_s=1.5")
    bench.run(15)
    text = [piece for piece in data if piece[:1] != b"\xfd"]
    assert len(text) == 9
    assert b"".join(text).startswith(b"\n\nInit ArduCopter")
    assert {type(e).__name__ for e in bench.events[events:]} <= {
        "Rebooted",
        "TelemetryReceived",
        "StatusText",
    }
    stream = FrameSplitter().feed(b"".join(data))  # as over a serial line
    assert len(stream) == len(data) - len(text)
    assert {frame.sysid for frame in stream} == {1}


@pytest.mark.autopilots("1.3")
def test_the_reasons_for_waiting_are_reported_until_arducopter_has_a_position():
    bench = FlyingBench("ardupilot", ready_s=41.0).connected()
    bench.begin("prepare", basic.prepare)
    reasons = set()

    def ready() -> bool:
        reasons.update(bench.session.state.not_ready)
        return bench.session.busy_with is None

    assert bench.run(60, ready)
    assert bench.now == pytest.approx(41.0, abs=2.5)
    assert bench.session.state.mode == "GUIDED"
    assert any(reason.endswith("[no-position]") for reason in reasons)
    assert any("STABILIZE" in reason and "GUIDED" in reason for reason in reasons)
    assert any("PreArm: " in reason for reason in reasons), "no text of the vehicle"


@pytest.mark.autopilots("1.3")
def test_a_pre_arm_bit_in_stabilize_is_not_readiness():
    """STABILIZE sets the bit at 20 s, without a position."""
    bench = FlyingBench("ardupilot", ready_s=41.0).connected()
    health = []
    bench.block_down = lambda m: (
        m.get_type() == "SYS_STATUS" and health.append(m.onboard_control_sensors_health)
    )
    bench.run(30)
    state = bench.session.state
    assert state.mode == "STABILIZE"
    assert health[-1] & mavlink.MAV_SYS_STATUS_PREARM_CHECK
    assert not state.ready
    assert any(reason.endswith("[no-position]") for reason in state.not_ready)


@BOTH
@pytest.mark.autopilots("1.3")
@pytest.mark.autopilots("2 PX4 otherwise", of="px4")
def test_arming_before_the_position_estimate_is_refused_with_the_text_of_the_vehicle(personality):
    bench = FlyingBench(personality, ready_s=41.0).connected()
    bench.run(12)  # until a fix gives a position for the take-off
    assert bench.do("hold", basic.hold).failure is None
    assert bench.upload(OLD).failure is None
    failure = bench.do("launch", basic.launch).failure
    result, reason = {
        "ardupilot": ("FAILED", "Arm: Need Position Estimate"),
        "px4": ("TEMPORARILY_REJECTED", "Preflight Fail"),
    }[personality]
    assert f"COMPONENT_ARM_DISARM: {result}" in failure
    assert reason in failure
    assert START not in bench.commands
    assert not bench.vehicle.armed


@pytest.mark.autopilots("1.4")
def test_a_mode_that_the_boot_undoes_is_set_again():
    bench = FlyingBench("ardupilot", ready_s=41.0)
    assert bench.run(5, lambda: bench.session.state.mode != "")
    assert bench.now < 2.0, "too late for the boot to undo the mode"
    bench.connected()
    assert bench.do("prepare", basic.prepare).failure is None
    assert bench.commands.count(MODE) == 2
    assert bench.mode == "GUIDED"


@BOTH
@pytest.mark.autopilots("1.5")
@pytest.mark.autopilots("1.5", of="px4")
def test_an_acknowledged_mode_counts_only_with_a_heartbeat(personality):
    bench = FlyingBench(personality).flying(OLD)
    bench.inject("stuck_mode:answer=accepted")
    failure = bench.do("hold", basic.hold).failure
    assert "DO_SET_MODE: ACCEPTED" in failure
    assert bench.session.state.mode == bench.session.dialect.mission_mode


@pytest.mark.autopilots("1.7")
def test_arducopter_is_armed_in_guided_and_then_its_mission_is_started():
    """ArduCopter refuses to arm in AUTO.

    Armed and in AUTO without MISSION_START, it stays on the ground until it disarms.
    """
    bench = FlyingBench("ardupilot").uploaded(OLD)
    before = len(bench.commands)
    modes = []
    bench.block = lambda m: (
        m.get_type() == "COMMAND_LONG" and m.command in (ARM, START) and modes.append(bench.mode)
    )
    assert bench.do("launch", basic.launch).failure is None
    orders = [c for c in bench.commands[before:] if c in (ARM, START, MODE)]
    assert (orders, modes) == ([ARM, START], ["GUIDED", "GUIDED"])
    assert bench.run(30, lambda: bench.session.state.landed is Landed.IN_AIR)


@pytest.mark.autopilots("2 PX4 otherwise", of="px4")
def test_px4_is_armed_in_hold_and_its_mission_mode_starts_it():
    bench = FlyingBench("px4").uploaded(OLD)
    bench.run(2)  # until PX4 has checked its mission
    before = len(bench.commands)
    assert bench.do("launch", basic.launch).failure is None
    orders = [c for c in bench.commands[before:] if c in (ARM, START, MODE)]
    assert orders == [ARM, MODE]


@BOTH
@pytest.mark.autopilots("2 PX4 otherwise")
@pytest.mark.autopilots("2 PX4 otherwise", of="px4")
def test_the_take_off_height_above_home_is_that_of_the_plan(personality):
    """PX4's take-off command, which is not used, counts from mean sea level; home is 300 m above that."""
    bench = FlyingBench(personality).uploaded(OLD)
    assert bench.do("launch", basic.launch).failure is None
    third = bench.session.dialect.first_waypoint_seq + 1
    assert bench.run(60, lambda: bench.session.state.mission_seq == third)
    assert bench.session.state.alt_rel_m == pytest.approx(20.0, abs=1.0)
    assert bench.session.state.alt_amsl_m == pytest.approx(ALT_M + 20.0, abs=1.5)


@pytest.mark.autopilots("1.10")
def test_a_launch_begins_at_the_take_off_item_if_the_current_item_moved_on():
    bench = FlyingBench("ardupilot").uploaded(OLD)
    bench.vehicle.modes.enter(3)  # AUTO, by its own switch
    bench.run(10)
    state = bench.session.state
    assert state.mission_seq not in (None, 0), "the current item does not move on"
    assert (state.armed, state.landed) == (False, Landed.ON_GROUND)
    assert "[not-flying]" in bench.swap(plan(north=3)).failure
    flown = []
    assert bench.do("launch", basic.launch).failure is None
    assert bench.run(60, lambda: flown.append(bench.session.state.mission_seq) or flown[-1] == 3)
    assert flown[0] == 1
    assert bench.session.state.alt_rel_m > 18.0


@pytest.mark.autopilots("1.11", "2 item 0")
def test_a_home_moved_by_arming_is_no_mission_difference():
    bench = FlyingBench("ardupilot").uploaded(OLD)
    before = bench.stored[0]
    assert bench.do("launch", basic.launch).failure is None
    assert bench.run(60, lambda: bench.session.state.mission_seq == 3)
    assert bench.stored[0] != bench.session.mission_items(OLD)[0]
    assert before.command == bench.stored[0].command
    bench.block = lambda m: m.get_type() == "MISSION_WRITE_PARTIAL_LIST"
    assert bench.swap(plan(north=4, east=0.001)).flying == "new"
    assert bench.holds(bench.session.items)


@pytest.mark.autopilots("1.8", "1.12")
def test_a_landed_arducopter_stays_in_auto_without_an_item_and_can_fly_its_mission_again():
    bench = FlyingBench("ardupilot").uploaded(plan(north=2))
    for _ in range(2):
        assert bench.do("launch", basic.launch).failure is None
        assert bench.run(120, lambda: not bench.session.state.armed)
        bench.run(3)
        state = bench.session.state
        assert (state.mode, state.mission_seq, state.landed) == ("AUTO", 0, Landed.ON_GROUND)
        refused = bench.swap(OLD)
        assert refused.flying == "old"
        assert refused.failure.endswith("[not-flying]")
        # The copter stands at its goal and may take off again; its mission leads back to its start.
        assert bench.do("prepare", basic.prepare).failure is None


@pytest.mark.autopilots("1.13")
def test_system_status_decides_neither_landed_state_nor_failsafe():
    bench = FlyingBench("ardupilot", params={"BATT_FS_LOW_ACT": 1, "BATT_LOW_VOLT": 11.0}).uploaded(OLD)
    status = []
    bench.block_down = lambda m: m.get_type() == "HEARTBEAT" and status.append(m.system_status)
    bench.vehicle.body.arm(True)
    bench.run(2)
    assert status[-1] == mavlink.MAV_STATE_STANDBY
    assert (bench.session.state.armed, bench.session.state.landed) == (True, Landed.ON_GROUND)
    bench.vehicle.body.arm(False)
    assert bench.run(5, lambda: not bench.session.state.armed)
    assert bench.do("launch", basic.launch).failure is None
    assert bench.run(60, lambda: bench.session.state.mission_seq == 3)
    bench.another_sets(SIM_BATT_VOLTAGE=10.5)
    assert bench.run(60, lambda: bench.mode == "LAND")
    assert bench.run(90, lambda: not bench.session.state.armed)
    assert status[-1] == mavlink.MAV_STATE_CRITICAL
    assert (bench.session.state.landed, bench.session.state.mode_role) == (Landed.ON_GROUND, "land")


@BOTH
@pytest.mark.autopilots("1.14")
@pytest.mark.autopilots("1.14", of="px4")
def test_an_unconfirmed_launch_does_not_disarm_a_flying_vehicle(personality):
    """The vehicle's reports are lost: the last known state is on the ground."""
    bench = FlyingBench(personality).uploaded(OLD)
    lost = ("EXTENDED_SYS_STATE", "GLOBAL_POSITION_INT")
    bench.block_down = lambda m: m.get_type() in lost
    failure = bench.do("launch", basic.launch).failure
    assert "[no-take-off]" in failure
    disarms = [m for m in bench.of("COMMAND_LONG") if m.command == ARM and m.param1 == 0.0]
    assert disarms, "no disarming was sent"
    assert bench.vehicle.armed, "a flying vehicle was disarmed"
    assert bench.vehicle.body.airborne


@pytest.mark.autopilots("1.20")
@pytest.mark.parametrize(
    ("params", "then", "mode"),
    [
        ({}, {"SIM_GPS_DISABLE": 1}, "LAND"),
        ({"BATT_FS_LOW_ACT": 2, "BATT_LOW_VOLT": 11.0}, {"SIM_BATT_VOLTAGE": 10.5}, "RTL"),
    ],
    ids=["GPS", "battery"],
)
def test_a_failsafe_of_the_autopilot_is_recognised_and_not_overridden(params, then, mode):
    bench = FlyingBench("ardupilot", params=params).flying(OLD)
    bench.another_sets(**then)
    assert bench.run(60, lambda: bench.session.state.mode == mode)
    sent = len(bench.sent)
    result = bench.swap(plan(north=4, east=0.001))
    assert (result.flying, mode in result.failure) == ("theirs", True)
    assert len(bench.sent) == sent
    assert bench.mode == mode


@BOTH
@pytest.mark.autopilots("1.15")
def test_a_command_of_another_ground_station_is_not_overridden(personality):
    bench = FlyingBench(personality).flying(OLD)
    bench.spoil(Faults(max_delay_s=0.2, seed=1))
    bench.begin_swap(plan(north=5, east=0.001))
    bench.run(0.3)
    bench.another_sets_mode(bench.session.dialect.land_mode)
    assert bench.session.busy_with == "swap"
    assert bench.run(60, lambda: bench.session.busy_with is None)
    assert bench.result.flying == "theirs"
    assert bench.mode == bench.session.dialect.land_mode


@BOTH
@pytest.mark.autopilots("1.5", "1.15")
@pytest.mark.autopilots("1.5", of="px4")
@pytest.mark.parametrize("after_s", [0.0, 0.6, *full_only(0.3, 0.9)])
def test_a_vehicle_landing_by_another_stations_command_does_not_count_as_on_its_old_plan(
    personality, after_s
):
    """The report of the landing arrives before a heartbeat with the mode."""
    bench = FlyingBench(personality).flying(OLD)
    bench.run(after_s)
    bench.another_sets_mode(bench.session.dialect.land_mode)
    assert bench.run(2, lambda: bench.session.state.landed is Landed.LANDING)
    assert bench.swap(plan(north=4, east=0.001)).flying == "theirs"
