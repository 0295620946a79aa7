"""Whole jobs against a simulated copter: prepare, upload, launch, swap, hold; over good and bad wires."""

from __future__ import annotations

from functools import partial

import pytest
from flying_bench import Faults, FlyingBench, is_partial_list, north_of_home, wires
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from profiles import examples
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from simulated_answers import refuse, refuse_heartbeats, stay_on_ground

from sim_vehicle.vehicle.injected_faults import FaultEffect, MissionRefusal
from swarmctl.core.events import Rebooted
from swarmctl.core.vehicle import Landed
from swarmctl.mavlink.procedures import basic

OLD, NEW = north_of_home(8, 0.0005), north_of_home(6, east=0.002, alt=33.333)
MODEST = settings(
    max_examples=examples(25),
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.data_too_large],
)


ARM, SET_MODE, SET_CURRENT, CHANGE_SPEED = (
    mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
    mavlink.MAV_CMD_DO_SET_MODE,
    mavlink.MAV_CMD_DO_SET_MISSION_CURRENT,
    mavlink.MAV_CMD_DO_CHANGE_SPEED,
)
GUIDED, AUTO = 4, 3


def copter() -> FlyingBench:
    return FlyingBench("ardupilot")


def test_an_upload_onto_a_flying_vehicle_is_refused():
    bench = copter().flying(OLD)
    before = len(bench.sent)
    assert "[armed]" in bench.upload(NEW).failure
    assert len(bench.sent) == before


@pytest.mark.parametrize("late", [False, True], ids=["text before the ack", "text after the ack"])
def test_a_refused_arming_is_reported_in_the_words_of_the_vehicle(late):
    bench, text = copter().uploaded(OLD), "Arm: Compass not calibrated"
    refuse(bench.vehicle, ARM, text="" if late else text)
    bench.begin("launch", basic.launch)
    assert bench.run(10, lambda: ARM in bench.commands)
    for _ in range(3 * late):  # as a PX4 repeats its text
        bench.vehicle.send_text(2, text)
    assert bench.run(60, lambda: bench.session.busy_with is None)
    assert "COMPONENT_ARM_DISARM: FAILED" in bench.result.failure
    assert bench.result.failure.count("Compass not calibrated") == 1


def test_launch_that_stays_on_the_ground_ends_disarmed():
    bench = copter().uploaded(OLD)
    stay_on_ground(bench.vehicle)
    assert "[no-take-off]" in bench.do("launch", basic.launch).failure
    assert not bench.vehicle.armed


def refuse_item(bench: FlyingBench, uploads: float) -> None:
    """Let the vehicle refuse item 3 of this number of uploads."""
    effect = FaultEffect(mission_refusal=MissionRefusal(mavlink.MAV_MISSION_INVALID, 3))
    end = bench.vehicle.injected_faults.begin(effect, bench.now)
    counts = []

    def block(message) -> bool:
        if message.get_type() == "MISSION_COUNT":
            counts.append(message)
            if len(counts) > uploads:
                end(bench.now)
        return is_partial_list(message)

    bench.block = block


def refuse_mode(bench: FlyingBench, number: int, name: str) -> None:
    text = f"Mode change to {name} failed: init failed"
    refuse(bench.vehicle, SET_MODE, text=text, when=lambda command: command.param2 == number)


def spoil_item(bench: FlyingBench) -> None:
    """Let the vehicle return item 4 as stored 500 m off."""

    def spoil(message) -> None:
        if message.get_type() == "MISSION_ITEM_INT" and message.seq == 4:
            message.x += 50_000

    bench.block_down = spoil


def stand_still(bench: FlyingBench) -> None:
    """Let the vehicle report its present place and no speed."""
    here = [round(degrees * 1e7) for degrees in bench.vehicle.body.lat_lon_deg]

    def freeze(message) -> None:
        if message.get_type() == "GLOBAL_POSITION_INT":
            message.lat, message.lon = here
            message.vx = message.vy = message.vz = 0

    bench.block_down = freeze


@pytest.mark.parametrize(
    ("spoil", "flying", "part"),
    [
        (partial(refuse_item, uploads=1), "old", "INVALID"),
        (partial(refuse_item, uploads=99), "hold", "INVALID"),
        (partial(refuse_mode, number=GUIDED, name="GUIDED"), "old", "Mode change to GUIDED failed"),
        (partial(refuse_mode, number=AUTO, name="AUTO"), "hold", "Mode change to AUTO failed"),
        (lambda bench: refuse(bench.vehicle, SET_CURRENT, 2), "hold", "DO_SET_MISSION_CURRENT: DENIED"),
        (spoil_item, "hold", "item 4: sent"),
        (stand_still, "hold", "[not-flying-on]"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_failed_swap_leaves_and_reports_a_whole_plan_or_hold(spoil, flying, part):
    bench = copter().flying(OLD)
    bench.block = is_partial_list
    spoil(bench)
    result = bench.swap(NEW)
    assert result.flying == flying
    assert part in result.failure
    assert bench.mode == ("GUIDED" if flying == "hold" else "AUTO")
    if flying == "old":
        assert bench.holds(bench.session.mission_items(OLD))


def test_the_return_to_an_appended_plan_skips_the_plans_before_that_plan():
    bench, appended = copter().flying(OLD), north_of_home(6, east=0.002)
    assert bench.swap(appended).flying == "new"
    refuse_item(bench, uploads=1)
    assert bench.swap(NEW).flying == "old"
    assert bench.holds(bench.session.mission_items(appended))
    assert bench.vehicle.mission.index < bench.vehicle.mission.count


def test_a_swap_right_after_the_launch_waits_for_the_climb():
    bench = copter()
    bench.spoil(Faults(max_delay_s=0.1))
    bench.uploaded(OLD)
    assert bench.do("launch", basic.launch).failure is None
    assert bench.session.state.alt_rel_m < 5.0
    bench.begin_swap(NEW)
    assert bench.run(60, lambda: bench.of("MISSION_WRITE_PARTIAL_LIST") != [])
    assert bench.session.state.alt_rel_m == pytest.approx(OLD.takeoff_alt_m, abs=1.0)
    assert bench.run(60, lambda: bench.session.busy_with is None)
    assert bench.result.flying == "new"


def test_a_landing_vehicle_keeps_its_mission():
    bench = copter().flying(OLD)
    assert bench.run(200, lambda: bench.session.state.landed is Landed.LANDING)
    result = bench.swap(NEW)
    assert (result.flying, "[landing]" in result.failure) == ("old", True)
    assert bench.of("MISSION_WRITE_PARTIAL_LIST") == []


def test_an_operators_command_is_repeated_after_a_boot_undoes_the_mode():
    bench = copter().connected()
    bench.inject("stuck_mode:answer=accepted,for=3")
    assert bench.do("hold", basic.hold).failure is None
    assert bench.commands.count(SET_MODE) == 2
    assert bench.mode == "GUIDED"


@pytest.mark.parametrize(
    ("answers", "limit_s"),
    [(True, 1.0), (False, 8.0)],
    ids=["heartbeats on request", "regular heartbeats only"],
)
def test_a_swap_on_a_perfect_wire_is_quick(answers, limit_s):
    bench = copter().flying(OLD)
    if not answers:
        refuse_heartbeats(bench.vehicle)
    before = bench.now
    assert bench.swap(NEW).flying == "new"
    assert bench.now - before < limit_s


def test_an_upload_on_a_perfect_wire_predicts_a_quick_swap():
    bench = copter().prepared()
    assert bench.upload(OLD).swap_takes_s == pytest.approx(0.0, abs=0.2)


@pytest.mark.parametrize("partial_lists", [True, False])
def test_a_swap_on_a_lost_link_reports_the_last_known_mission(partial_lists):
    bench = copter().flying(OLD)
    bench.spoil(Faults(max_delay_s=0.3))
    if not partial_lists:
        bench.block = is_partial_list
    announces = "MISSION_WRITE_PARTIAL_LIST" if partial_lists else "MISSION_COUNT"
    before = len(bench.of(announces))
    bench.begin_swap(NEW)
    assert bench.run(20, lambda: len(bench.of(announces)) > before)
    bench.silent = True
    assert bench.run(400, lambda: bench.session.busy_with is None)
    assert bench.result.flying == ("unknown" if partial_lists else "hold")
    if partial_lists:
        landed = bench.run(200, lambda: not bench.vehicle.armed)
        assert landed, "the old plan is not flown to its end"
        assert bench.vehicle.body.lat_lon_deg[0] == pytest.approx(OLD.landing.lat_deg, abs=1e-4)
    else:
        assert bench.mode == "GUIDED", "the stored mixture is flown"


def flies_new(bench: FlyingBench) -> bool:
    return bench.mode == "AUTO" and bench.holds(bench.session.mission_items(NEW))


def test_a_swap_without_an_answer_to_the_last_mode_command_does_not_report_hold():
    bench = copter().flying(OLD)
    bench.block = is_partial_list
    bench.block_down = lambda m: flies_new(bench)
    assert bench.swap(NEW).flying == "unknown"
    assert bench.mode == "AUTO"


def test_a_speed_from_before_the_hold_does_not_show_that_the_vehicle_flies_on():
    bench = copter().flying(OLD)
    bench.block = is_partial_list
    stand_still(bench)
    freeze = bench.block_down
    bench.block_down = lambda m: freeze(m) or (m.get_type() == "GLOBAL_POSITION_INT" and not flies_new(bench))
    result = bench.swap(NEW)
    assert result.flying != "new"
    assert "[not-flying-on]" in result.failure


def test_a_reboot_restarts_the_streams_and_makes_the_mission_unknown():
    bench = copter().uploaded(OLD)
    bench.run(10)
    bench.inject("reboot")
    assert bench.run(15, lambda: Rebooted() in bench.events)
    assert bench.session.items == ()
    assert bench.run(15, lambda: streams_run(bench))


def streams_run(bench: FlyingBench) -> bool:
    """Return whether the vehicle sends each message that the session needs at its rate."""
    rates = bench.session.dialect.streams_hz.items()
    return all(bench.vehicle.rates.interval_s(number) == pytest.approx(1.0 / hz) for number, hz in rates)


def test_the_address_changes_only_after_the_loss_and_not_amid_a_command():
    bench = copter().flying(OLD)
    assert not bench.session.may_change_address
    bench.silent = True
    assert bench.run(20, lambda: bench.session.may_change_address)
    assert bench.session.age_s(bench.now) > 4.9
    bench.begin("hold", basic.hold)
    assert not bench.session.may_change_address
    assert bench.run(20, lambda: bench.session.busy_with is None)
    assert bench.session.may_change_address


def test_a_vehicle_that_rebooted_while_lost_gets_its_stream_requests_at_once():
    bench = copter().prepared()
    bench.silent = True
    bench.run(60)
    bench.inject("reboot:silence_s=0.1")
    bench.run(1)
    bench.silent = False
    assert bench.run(3, lambda: streams_run(bench))


@MODEST
@given(faults=wires, count=st.integers(1, 12))
def test_an_upload_reports_success_only_for_the_exact_mission(faults, count):
    bench = copter()
    bench.spoil(faults)
    assert bench.run(200, lambda: bench.session.state.mode != "")
    mission = north_of_home(count)
    done = bench.upload(mission)
    if done.failure is None:
        assert bench.holds(bench.session.mission_items(mission))
        items = bench.session.mission_items(mission)
        assert bench.session.dialect.differences(items, bench.session.items) == ()
    else:
        assert bench.session.items == ()


@MODEST
@given(faults=wires)
def test_successive_uploads_never_mix(faults):
    bench = copter()
    bench.spoil(faults)
    assert bench.run(200, lambda: bench.session.state.mode != "")
    bench.begin("upload", lambda c: basic.upload(c, bench.session.mission_items(OLD)))
    bench.run(1.0)
    bench.take(bench.session.cancel(bench.now))
    if bench.upload(NEW).failure is None:
        assert bench.holds(bench.session.mission_items(NEW))


# Speed


def speeds_sent(bench: FlyingBench) -> list:
    return [m for _, m in bench.sent if m.get_type() == "COMMAND_LONG" and m.command == CHANGE_SPEED]


def test_the_ground_speed_is_sent_once_and_a_refusal_is_reported():
    bench = copter().flying(OLD)
    refuse(bench.vehicle, CHANGE_SPEED, mavlink.MAV_RESULT_UNSUPPORTED)
    assert (
        bench.do("set_speed", partial(basic.set_speed, speed_m_s=6.5)).failure
        == "DO_CHANGE_SPEED: UNSUPPORTED"
    )
    (message,) = speeds_sent(bench)
    assert (message.param1, message.param2, message.param3) == (mavlink.SPEED_TYPE_GROUNDSPEED, 6.5, -1.0)


def test_no_speed_is_sent_to_a_vehicle_that_does_not_fly_its_mission():
    bench = copter().flying(OLD)
    bench.another_sets_mode("GUIDED")
    bench.run(3)
    assert "GUIDED" in bench.do("set_speed", partial(basic.set_speed, speed_m_s=6.5)).failure
    assert speeds_sent(bench) == []


def test_an_unanswered_speed_is_repeated_a_limited_number_of_times():
    bench = copter().flying(OLD)
    bench.block = lambda message: getattr(message, "command", None) == CHANGE_SPEED
    assert "no answer" in bench.do("set_speed", partial(basic.set_speed, speed_m_s=6.5)).failure
    assert [m.confirmation for m in speeds_sent(bench)] == [0, 1, 2, 3, 4]
